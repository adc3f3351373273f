"""Plant defects in the lumens of a synthetic scan, and record them in its truth."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.scans.designs import Design

STEP_MM = 0.01


@dataclass
class Lumens:
    """Pieces of lumen as the kernels take them; part frame, mm.

    ``pieces`` (n, 9): start, end, length along the vessel at start and at end, row of `radius`.
    ``radius`` (m, k): every `STEP_MM` along each vessel; rows beyond the vessels' are leaks.
    ``plugs`` (p, 3): row of `radius`, centre along it, half length.
    """

    pieces: np.ndarray
    radius: np.ndarray
    plugs: np.ndarray
    defects: list[dict[str, Any]]


def plant(design: Design, asked: argparse.Namespace) -> Lumens:
    """Return the lumens as printed with the defects asked for."""
    longest = max(v.along[-1] for v in design.vessels)
    places = np.arange(int(longest / STEP_MM) + 200) * STEP_MM
    radius = [v.radius_at(places) for v in design.vessels]
    defects, kept = widths(design, asked, places, radius), range(len(design.vessels))
    plugs = []
    for number, share, size in asked.plug:
        at = share * design.vessels[int(number)].along[-1]
        plugs.append([number, at, size / 2])
        more = {"length_um": 1e3 * size}
        defects.append(entry(design, "occlusion", int(number), at, size / 2, **more))
    pieces = [row for k in kept if k not in asked.missing for row in chain(design, k)]
    for number in asked.missing:
        half = design.vessels[number].along[-1] / 2
        defects.append(entry(design, "missing", number, half, half))
    for given in asked.leak:
        start, end, noted = leak(design, given)
        pieces.append([*start, *end, 0.0, float(np.linalg.norm(end - start)), len(radius)])
        radius.append(np.full(len(places), given[2] / 2))
        defects.append(noted)
    table, closed = np.array(pieces, float).reshape(-1, 9), np.array(plugs, float).reshape(-1, 3)
    return Lumens(table, np.array(radius), closed, defects)


def chain(design: Design, number: int) -> list[list[float]]:
    """Return a vessel's pieces, an open end carried 0.4 mm beyond the body."""
    vessel = design.vessels[number]
    points, along = vessel.points.copy(), vessel.along.copy()
    for is_open, end, inner in zip(design.open_ends(number), (0, -1), (1, -2), strict=True):
        if is_open:
            outwards = points[end] - points[inner]
            points[end] += 0.4 * outwards / np.linalg.norm(outwards)
            along[end] += 0.4 if end else -0.4
    return [
        [*points[k], *points[k + 1], along[k], along[k + 1], number] for k in range(len(points) - 1)
    ]


def entry(
    design: Design, kind: str, vessel: int, at: float, half: float, **more: Any
) -> dict[str, Any]:
    """Return a defect's entry in the truth."""
    centre = design.vessels[vessel].at(at).tolist()
    place = {"at_mm": at, "from_mm": at - half, "to_mm": at + half, "center_mm": centre}
    return {"kind": kind, "vessel": vessel, **place, **more}


def widths(
    design: Design, asked: argparse.Namespace, places: np.ndarray, radius: list[np.ndarray]
) -> list[dict[str, Any]]:
    """Apply bulges, stenoses and changes of whole vessels to `radius`; return their entries."""
    out = []
    for number, amount in asked.radius_change:
        vessel, half = int(number), design.vessels[int(number)].along[-1] / 2
        radius[vessel] = radius[vessel] + amount
        kind = "narrowed" if amount < 0 else "widened"
        out.append(entry(design, kind, vessel, half, half, whole_vessel=True))
    for number, share, sigma, amount in asked.bulge:
        vessel, at = int(number), share * design.vessels[int(number)].along[-1]
        radius[vessel] = radius[vessel] + amount * np.exp(-(((places - at) / sigma) ** 2) / 2)
        kind = "stenosis" if amount < 0 else "bulge"
        out.append(entry(design, kind, vessel, at, 2 * sigma))
    return out


def leak(design: Design, given: list[float]) -> tuple[np.ndarray, np.ndarray, dict[str, Any]]:
    """Return a way's ends and entry: to the nearest face, or to another vessel (a bridge)."""
    vessel, at = int(given[0]), given[1] * design.vessels[int(given[0])].along[-1]
    start = design.vessels[vessel].at(at)
    other = int(given[3]) if len(given) > 3 else None
    if other is None:
        body = design.body
        gaps = body.planes[:, 3] - body.planes[:, :3] @ start
        face = int(gaps.argmin())
        end = start + (gaps[face] + 0.2) * body.planes[face, :3]
    else:
        line = design.vessels[other].at(np.linspace(0, design.vessels[other].along[-1], 400))
        end = line[np.linalg.norm(line - start, axis=1).argmin()]
    kind = "leak" if other is None else "bridge"
    noted = entry(design, kind, vessel, at, given[2], other=other)
    noted["center_mm"] = ((start + end) / 2).tolist()
    return start, end, noted
