"""Judge the outer faces reported as seen, by their distance error."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from benchmarks.scans.judge_pose import apply

NEAR_MM = 0.5
PATCH_MM = 0.8
FEWEST = 25
LEVEL = 0.85
FAR_UM = 50.0
STEPS_MM = np.arange(0.15, 0.61, 0.15)
RIM_MM = 0.1
NO_CYLINDER = (0.0, 0.0, 1e6)


def true_planes(truth: dict[str, Any]) -> np.ndarray:
    """Return the body's planes (n, 4), those of the box where the truth names none."""
    if truth.get("planes"):
        return np.array(truth["planes"], float)
    low, high = np.array(truth["block_mm"], float)
    return np.array(
        [[*np.eye(3)[k] * s, (high[k] if s > 0 else -low[k])] for k in range(3) for s in (1, -1)]
    )


def judge_faces(path: Path, report: dict[str, Any], truth: dict[str, Any]) -> list[dict[str, Any]]:
    """Return for each flat face the distance (um) of its measured surface from the true one.

    deviation.ply is carried back into the scan by the report's own pose and into the part by the
    true one, so that the pose's error doesn't count. `worst_um` is the largest median of a patch
    of 0.8 mm, `beyond_percent` the share of points beyond 50 um. Points that the report gives no
    deviation (NaN: not seen), that lie within 0.5 mm of an edge, near a leak, on a lumen's wall, or
    whose normal isn't the face's (a vessel's mouth) are left out.
    Swelling isn't taken off.
    """
    if not path.exists():
        return []
    mesh = trimesh.load(path, process=False)
    vertices, normals = np.asarray(mesh.vertices, float), np.asarray(mesh.vertex_normals)
    claimed = np.asarray(mesh.metadata["_ply_raw"]["vertex"]["data"]["deviation_um"], float)
    claimed = np.isfinite(claimed.reshape(-1))
    scan = apply(np.linalg.inv(np.array(report["scaled_scan_to_part"])), vertices)
    points = apply(np.linalg.inv(np.array(truth["transform_model_to_scan_mm"])), scan)
    scale, planes, out = np.array(truth["scale"]), true_planes(truth), []
    gaps = points @ planes[:, :3].T - planes[:, 3]
    for k, plane in enumerate(planes):
        others = np.delete(gaps, k, axis=1)
        near = (
            claimed
            & (np.abs(gaps[:, k]) < NEAR_MM)
            & (others < -NEAR_MM).all(axis=1)
            & away(points, truth)
            & off_lumens(points, report)
            & (np.abs(normals @ plane[:3]) > LEVEL)
        )
        if near.sum() < FEWEST:
            out.append({"face": plane[:3].round(3).tolist(), "seen": False})
            continue
        length = 1 / np.linalg.norm(plane[:3] / scale)
        error = 1e3 * gaps[near, k] * length
        worst = patches(points[near], plane[:3], error)
        out.append(
            {
                "face": plane[:3].round(3).tolist(),
                "seen": True,
                "median_um": float(np.median(error)),
                "worst_um": worst,
                "beyond_percent": float(100 * (np.abs(error) > FAR_UM).mean()),
            }
        )
    return out


def away(points: np.ndarray, truth: dict[str, Any]) -> np.ndarray:
    """Whether points are within a drum's rim and 1.5 mm off planted leaks and bridges."""
    x, y, radius = truth.get("cylinder") or NO_CYLINDER
    keep = np.hypot(points[:, 0] - x, points[:, 1] - y) < radius - NEAR_MM
    for planted in truth["defects"]:
        if planted["kind"] in ("leak", "bridge"):
            keep &= np.linalg.norm(points - planted["center_mm"], axis=1) > 1.5
    return keep


def off_lumens(points: np.ndarray, report: dict[str, Any]) -> np.ndarray:
    """Whether points are off lumens' walls: one that leaves aslant faces as the face does."""
    keep = np.ones(len(points), bool)
    for row in report["vessels"]:
        axis = np.array(row.get("place_mm") or [], float).reshape(-1, 3)
        if len(axis) < 2:
            continue
        out = [axis[k] - axis[j] for k, j in ((0, 1), (-1, -2))]
        beyond = [axis[k] + np.outer(STEPS_MM, unit(v)) for k, v in zip((0, -1), out, strict=True)]
        line = np.vstack([axis, *beyond])
        wide = 1.2 * max(row["designed_along_um"]) / 2e3 + RIM_MM
        keep &= cKDTree(line).query(points, distance_upper_bound=wide)[0] > wide
    return keep


def unit(vector: np.ndarray) -> np.ndarray:
    """Return a vector's direction."""
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-9))


def patches(points: np.ndarray, normal: np.ndarray, error: np.ndarray) -> float:
    """Return the largest magnitude of a patch's median, um."""
    sides = np.linalg.svd(normal[None])[2][1:]
    cells = np.floor(points @ sides.T / PATCH_MM).astype(int)
    _, which = np.unique(cells, axis=0, return_inverse=True)
    medians = [
        np.median(error[which == c]) for c in range(which.max() + 1) if (which == c).sum() >= FEWEST
    ]
    return float(np.abs(medians).max()) if medians else float(abs(np.median(error)))
