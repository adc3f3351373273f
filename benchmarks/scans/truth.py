"""Truth of a scan: pose, defects, and diameters along every vessel."""

from __future__ import annotations

import argparse
from typing import Any

import numba as nb
import numpy as np

from benchmarks.scans import geometry
from benchmarks.scans.defects import Lumens
from benchmarks.scans.designs import Design
from benchmarks.scans.pose import Pose

SECTION_STEP_MM = 0.05
RAYS = 90
ROUGH_STEP_MM = 0.0025


@nb.njit(cache=True)
def lumen(p, pieces, radius, plugs, only, but, scratch):
    """Return the distance to the wall of one vessel (`only`), or of all but one (`but`)."""
    best = geometry.FAR
    for c in range(len(pieces)):
        if (only < 0 or int(pieces[c, 8]) == only) and int(pieces[c, 8]) != but:
            best = min(best, geometry.wall(p, pieces, c, radius, plugs, scratch))
    return best


@nb.njit(cache=True)
def section(at, first, second, pieces, radius, plugs, only, reach, rough, seed):
    """Return the areas (mm2) of a vessel's section through a point: smooth, and walls as rough.

    The smooth wall by bisection along rays; rough ones, which may overhang, by what is free of
    gel along each ray in steps.
    """
    p, scratch, smooth, free = np.zeros(3), np.zeros(3), 0.0, 0.0
    for ray in range(RAYS):
        c, s = np.cos(2 * np.pi * ray / RAYS), np.sin(2 * np.pi * ray / RAYS)
        low, high = 0.0, reach
        for _ in range(24):
            middle = (low + high) / 2
            for a in range(3):
                p[a] = at[a] + middle * (c * first[a] + s * second[a])
            if lumen(p, pieces, radius, plugs, only, -1, scratch) < 0:
                low = middle
            else:
                high = middle
        smooth += low * low * np.pi / RAYS
        if rough[0] == 0 or low == 0.0:
            free += low * low * np.pi / RAYS
            continue
        inner = max(low - geometry.ROUGH_WITHIN_MM, 0.0)
        free += inner * inner * np.pi / RAYS
        for step in range(int((low + geometry.ROUGH_WITHIN_MM - inner) / ROUGH_STEP_MM)):
            there = inner + (step + 0.5) * ROUGH_STEP_MM
            for a in range(3):
                p[a] = at[a] + there * (c * first[a] + s * second[a])
            away = lumen(p, pieces, radius, plugs, only, -1, scratch)
            if away + geometry.roughness(p, rough, seed) < 0:
                free += there * ROUGH_STEP_MM * 2 * np.pi / RAYS
    return smooth, free


def sections(
    design: Design, lumens: Lumens, pose: Pose, asked: argparse.Namespace
) -> list[dict[str, Any]]:
    """Return each vessel's places (mm), diameters as printed (um), what is clear and in view.

    `diameter_um` is that of smooth walls, `rough_diameter_um` that of the walls as they are.
    """
    rough = np.array([asked.roughness_um / 1e3, asked.grain_um / 1e3])
    none, scratch, out = np.zeros((0, 3)), np.zeros(3), []
    ways = lumens.pieces[lumens.pieces[:, 8] < len(design.vessels)]
    for number, vessel in enumerate(design.vessels):
        length = vessel.along[-1]
        along = np.linspace(0, length, max(int(length / SECTION_STEP_MM), 2) + 1)
        smooth, made, clear, in_view = list[float](), list[float](), list[bool](), list[bool]()
        for s in along:
            point = vessel.at(s)
            axis = vessel.at(min(s + 0.02, length)) - vessel.at(max(s - 0.02, 0))
            axis /= np.linalg.norm(axis)
            first, second = np.linalg.svd(axis[None])[2][1:]
            wide = float(vessel.radius_at(s))
            args = (ways, lumens.radius, lumens.plugs, number, 3 * wide)
            areas = np.zeros(2)
            if number not in asked.missing:
                areas[:] = section(point, first, second, *args, rough, asked.seed)
            enlarge = pose.scale.prod() / np.linalg.norm(pose.scale * axis)
            for kept, area in zip((smooth, made), areas, strict=True):
                kept.append(round(float(2e3 * np.sqrt(area * enlarge / np.pi)), 2))
            others = lumen(point, lumens.pieces, lumens.radius, none, -1, number, scratch)
            clear.append(bool(others > 1.3 * wide and design.body.depth(point[None])[0] < -0.15))
            seen = pose.transform[:3, :3] @ point + pose.transform[:3, 3]
            in_view.append(bool(((seen > 0) & (seen < pose.extent)).all()))
        designed = (2e3 * vessel.radius_at(along)).round(2).tolist()
        found = {"vessel": number, "along_mm": along.round(4).tolist(), "diameter_um": smooth}
        found |= {"rough_diameter_um": made, "designed_um": designed}
        out.append(found | {"clear": clear, "in_view": in_view})
    return out


def truth(design: Design, lumens: Lumens, pose: Pose, asked: argparse.Namespace) -> dict[str, Any]:
    """Return the truth in make_scan.py's form, with more about the body."""
    body = design.body
    return {
        "transform_model_to_scan_mm": (
            np.diag([1, 1, asked.index / 1.333, 1]) @ pose.transform
        ).tolist(),
        "scale": pose.scale.tolist(),
        "block_mm": [[0.0, 0.0, 0.0], body.size.tolist()],
        "planes": body.planes.tolist(),
        "cylinder": list(body.cylinder),
        "mirrored": bool(asked.mirror),
        "whole_in_view": not asked.half_field,
        "defects": lumens.defects,
        "vessels": sections(design, lumens, pose, asked),
    }
