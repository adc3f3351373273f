"""Judge a `printctl register` report against a synthetic scan's truth."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from benchmarks.common import Row

OPENING = ("leak", "bridge")
BROKEN = ("occlusion", "missing", "leak", "bridge")
MATCHING = {
    "stenosis": ("stenosis", "occlusion"),
    "narrowed": ("stenosis", "narrowed"),
    "bulge": ("bulge",),
    "widened": ("bulge", "widened"),
    "leak": OPENING,
    "bridge": OPENING,
    "occlusion": ("occlusion", "missing", "stenosis"),
    "missing": ("missing", "occlusion"),
}
NEAR_MM = 0.5
PATCH_MM = 0.8
FEWEST = 25
LEVEL = 0.85
FAR_UM = 50.0
STEPS_MM = np.arange(0.15, 0.61, 0.15)
RIM_MM = 0.1
NO_CYLINDER = (0.0, 0.0, 1e6)


def judge(folder: Path, truth: Row, tolerance: float) -> Row:
    """Return the judgement; diameters and faces only where the pose is near the truth."""
    whole = json.loads((folder / "registration.json").read_text())
    report = whole["registration"]
    pose = judge_pose(report, truth)
    placed = pose["tre_rms_um"] < 300
    return {
        "pose": pose,
        "verdict": judge_verdict(whole, truth, tolerance),
        "planted": judge_defects(report, truth, tolerance),
        "sections": judge_sections(report, truth) if placed else [],
        "vessels": judge_vessels(report, truth) if placed else [],
        "faces": judge_faces(folder / "deviation.ply", report, truth) if placed else [],
    }


def apply(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Move points (n, 3) by a 4x4 matrix."""
    return np.asarray(points @ matrix[:3, :3].T + matrix[:3, 3])


def judge_pose(report: Row, truth: Row, landed_um: float = 50.0, wrong_um: float = 100.0) -> Row:
    """Return the target registration error; whether landed, flagged, or silently wrong."""
    low, high = np.array(truth["block_mm"], float)
    share = np.stack(np.meshgrid(*[np.linspace(0, 1, 5)] * 3), axis=-1).reshape(-1, 3)
    points = low + share[((share == 0) | (share == 1)).any(axis=1)] * (high - low)
    found = np.linalg.inv(np.array(report["scaled_scan_to_part"], float))
    true = np.array(truth["transform_model_to_scan_mm"])
    error = 1e3 * np.linalg.norm(apply(found, points) - apply(true, points), axis=1)
    rms, mirrored = float(np.sqrt((error**2).mean())), bool(truth["mirrored"])
    flagged = bool(report["ambiguity"]["flag"])
    wrong = not flagged and (rms > wrong_um or mirrored)
    landed = rms <= landed_um and not mirrored
    return {"tre_rms_um": rms, "landed": landed, "flagged": flagged, "silently_wrong": wrong}


def true_at(section: Row, along: np.ndarray, rough: bool = False) -> np.ndarray:
    """Return true diameters (um) at places; NaN near junctions and out of view.

    `rough`: of the walls as they are, where the truth has that; else of smooth ones.
    """
    usable = np.array(section["clear"]) & np.array(section["in_view"])
    known = section["diameter_um"]
    if rough:
        known = section.get("rough_diameter_um", known)
    value = np.where(usable, [np.nan if d is None else d for d in known], np.nan)
    return np.asarray(np.interp(along, section["along_mm"], value, left=np.nan, right=np.nan))


def true_errors(section: Row) -> np.ndarray:
    """Return the known true errors of a vessel's sections, percent of the design."""
    real = true_at(section, np.array(section["along_mm"]))
    error = 100 * (real / np.array(section["designed_um"]) - 1)
    return np.asarray(error[np.isfinite(error)])


def visible(planted: Row, truth: Row) -> bool:
    """Whether a planted defect's place is in view."""
    section = truth["vessels"][planted["vessel"]]
    seen = np.array(section["in_view"], float)
    return bool(np.interp(planted["at_mm"], section["along_mm"], seen) > 0.5)


def place_error(planted: Row, listed: Row) -> float:
    """Return the distance (mm) of a listed defect from the planted one."""
    out = np.inf
    if listed.get("point_mm"):
        out = float(np.linalg.norm(np.subtract(listed["point_mm"], planted["center_mm"])))
    if listed.get("at_mm") is not None and listed["vessel"] == planted["vessel"]:
        below, above = planted["from_mm"] - listed["at_mm"], listed["at_mm"] - planted["to_mm"]
        out = min(out, max(below, above, 0.0))
    return out


def is_found(planted: Row, listed: Row, reach: float) -> bool:
    """Whether a listed defect is the planted one by kind and place."""
    if listed["kind"] not in MATCHING.get(planted["kind"], (planted["kind"],)):
        return False
    if planted.get("whole_vessel") or planted["kind"] == "missing":
        return bool(listed["vessel"] == planted["vessel"])
    return place_error(planted, listed) <= reach


def judge_defects(report: Row, truth: Row, tolerance: float, reach: float = 0.7) -> list[Row]:
    """Return what was planted in view, and whether it was found.

    A change of a whole vessel counts as found too where the vessel's mean is beyond tolerance.
    """
    listed = report.get("defects") or []
    off = {r["vessel"] for r in report["vessels"] if abs(r.get("error_percent") or 0) > tolerance}
    rows = []
    for planted in truth["defects"]:
        if not visible(planted, truth):
            continue
        found = any(is_found(planted, d, reach) for d in listed)
        found |= bool(planted.get("whole_vessel")) and planted["vessel"] in off
        worst = float(np.abs(true_errors(truth["vessels"][planted["vessel"]])).max(initial=0))
        known = {"kind": planted["kind"], "vessel": planted["vessel"]}
        rows.append(known | {"true_worst_percent": worst, "found": found})
    return rows


def judge_verdict(whole: Row, truth: Row, tolerance: float, guard: float = 1.5) -> Row:
    """Return the verdict and whether it passes what mustn't pass.

    bad: broken, or a section beyond the tolerance and 1 %. `false_pass`: passes though a section is
    beyond `guard` times the tolerance, a vessel is broken, or not all is in view.
    """
    passed, in_view = bool(whole["verdict"]["passed"]), truth["whole_in_view"]
    worst = max((np.abs(true_errors(v)).max(initial=0) for v in truth["vessels"]), default=0.0)
    broken = any(d["kind"] in BROKEN and visible(d, truth) for d in truth["defects"])
    bad = broken or worst > tolerance + 1
    good = not bad and worst < tolerance - 1 and in_view
    false_pass = passed and bool(broken or worst > guard * tolerance or not in_view)
    named = "bad" if bad else "good" if good else "marginal"
    return {"passed": passed, "truth": named, "false_pass": false_pass}


def judge_sections(report: Row, truth: Row) -> list[bool]:
    """Return whether each section's 95 % interval holds its true diameter, roughness included."""
    out: list[bool] = []
    for row in report["vessels"]:
        if not row.get("along_mm") or not row.get("diameter_um"):
            continue
        section = truth["vessels"][row["vessel"]]
        real = true_at(section, np.array(row["along_mm"], float), rough=True)
        value, half = (numbers(row[key]) for key in ("diameter_um", "interval_95_um"))
        known = np.isfinite(value) & np.isfinite(half) & (np.nan_to_num(real) > 0)
        out += (np.abs(value - real) <= half)[known].tolist()
    return out


def numbers(values: list[float | None] | None) -> np.ndarray:
    """Return numbers of which some are unknown, NaN there."""
    return np.array([np.nan if one is None else one for one in values or []], float)


def judge_vessels(report: Row, truth: Row) -> list[Row]:
    """Return each vessel's decision, whether a defect touches it, its worst true error, U there."""
    planted = truth["defects"]
    touched = {d["vessel"] for d in planted} | {d.get("other") for d in planted}
    out = []
    for row in report["vessels"]:
        section = truth["vessels"][row["vessel"]]
        worst = float(np.abs(true_errors(section)).max(initial=0))
        known = {"vessel": row["vessel"], "decision": row.get("decision"), "worst_percent": worst}
        more = {"touched": row["vessel"] in touched, "u_percent": u_there(row, section)}
        out.append(known | more)
    return out


def u_there(row: Row, section: Row) -> float | None:
    """Return U of the section that truly errs most, percent of the design; None without one."""
    along, half = numbers(row.get("along_mm")), numbers(row.get("interval_95_um"))
    if not len(along) or len(half) != len(along):
        return None
    designed = np.interp(along, section["along_mm"], section["designed_um"])
    error = np.abs(true_at(section, along) / designed - 1)
    known = np.isfinite(error) & np.isfinite(half)
    if not known.any():
        return None
    k = int(np.argmax(np.where(known, error, -1)))
    return float(100 * half[k] / designed[k])


def true_planes(truth: Row) -> np.ndarray:
    """Return the body's planes (n, 4), those of the box where the truth names none."""
    if truth.get("planes"):
        return np.array(truth["planes"], float)
    low, high = np.array(truth["block_mm"], float)
    return np.column_stack([np.vstack([np.eye(3), -np.eye(3)]), np.append(high, -low)])


def judge_faces(path: Path, report: Row, truth: Row) -> list[float]:
    """Return the largest error, um, of each flat face that is seen: median of a patch of 0.8 mm.

    deviation.ply is carried back into the scan by the report's own pose and into the part by the
    true one, so that the pose's error doesn't count. Points that the report gives no deviation
    (NaN: not seen), that lie within 0.5 mm of an edge, near a leak, on a lumen's wall, or whose
    normal isn't the face's (a vessel's mouth) are left out. Swelling isn't taken off.
    """
    if not path.exists():
        return []
    mesh = trimesh.load(path, process=False)
    vertices, normals = np.asarray(mesh.vertices, float), np.asarray(mesh.vertex_normals)
    claimed = np.asarray(mesh.metadata["_ply_raw"]["vertex"]["data"]["deviation_um"], float)
    scan = apply(np.linalg.inv(np.array(report["scaled_scan_to_part"])), vertices)
    points = apply(np.linalg.inv(np.array(truth["transform_model_to_scan_mm"])), scan)
    usable = np.isfinite(claimed.reshape(-1)) & away(points, truth) & off_lumens(points, report)
    scale, planes, out = np.array(truth["scale"]), true_planes(truth), []
    gaps = points @ planes[:, :3].T - planes[:, 3]
    for k, plane in enumerate(planes):
        near = usable & (np.abs(gaps[:, k]) < NEAR_MM) & (np.abs(normals @ plane[:3]) > LEVEL)
        near &= (np.delete(gaps, k, axis=1) < -NEAR_MM).all(axis=1)
        if near.sum() >= FEWEST:
            error = 1e3 * gaps[near, k] / np.linalg.norm(plane[:3] / scale)
            out.append(patches(points[near], plane[:3], error))
    return out


def away(points: np.ndarray, truth: Row) -> np.ndarray:
    """Whether points are within a drum's rim and 1.5 mm off planted leaks and bridges."""
    x, y, radius = truth.get("cylinder") or NO_CYLINDER
    keep = np.hypot(points[:, 0] - x, points[:, 1] - y) < radius - NEAR_MM
    for planted in truth["defects"]:
        if planted["kind"] in ("leak", "bridge"):
            keep &= np.linalg.norm(points - planted["center_mm"], axis=1) > 1.5
    return keep


def off_lumens(points: np.ndarray, report: Row) -> np.ndarray:
    """Whether points are off lumens' walls: one that leaves aslant faces as the face does."""
    keep = np.ones(len(points), bool)
    for row in report["vessels"]:
        axis = np.array(row.get("place_mm") or [], float).reshape(-1, 3)
        if len(axis) < 2:
            continue
        out = [axis[k] - axis[j] for k, j in ((0, 1), (-1, -2))]
        out = [v / max(float(np.linalg.norm(v)), 1e-9) for v in out]
        beyond = [axis[k] + np.outer(STEPS_MM, v) for k, v in zip((0, -1), out, strict=True)]
        line = np.vstack([axis, *beyond])
        wide = 1.2 * max(row["designed_along_um"]) / 2e3 + RIM_MM
        keep &= cKDTree(line).query(points, distance_upper_bound=wide)[0] > wide
    return keep


def patches(points: np.ndarray, normal: np.ndarray, error: np.ndarray) -> float:
    """Return the largest magnitude of a patch's median, um."""
    sides = np.linalg.svd(normal[None])[2][1:]
    cells = np.floor(points @ sides.T / PATCH_MM).astype(int)
    _, which = np.unique(cells, axis=0, return_inverse=True)
    medians = [
        np.median(error[which == c]) for c in range(which.max() + 1) if (which == c).sum() >= FEWEST
    ]
    return float(np.abs(medians).max()) if medians else float(abs(np.median(error)))
