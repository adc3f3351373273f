"""Judge an embedded print by its G-code alone; shares no code with the product.

The shaft is a cylinder of the needle's outer radius R, without clearance, from the tip upward
without end. It may touch what a joint means it to touch, within

    J = sqrt(2) (R + r) + r / 2, r the larger radius of the two that meet:

- ink of the same pass, written within J of way before;
- ink within J of a node that its vessel shares with the vessel being written, the tip within J too;
- ink of the vessel being written within J of a place where that was cut, the tip within J too.

Two vessels overlap, and count as one body, where their axes come nearer than the sum of their
radii, one of the two places further than J from every node that they share; a vessel overlaps
itself where that happens further apart along it than J.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from benchmarks.checkers.compiled import compiled
from benchmarks.checkers.embedded_ink import (
    BIN_MM,
    WINDOW_MM,
    Axes,
    Ink,
    overlap_ul,
    read_axes,
    vessels_of_passes,
    written_ink,
)
from benchmarks.checkers.embedded_joints import cuts_of, joints_of, open_joints, pass_ends
from benchmarks.checkers.read_gcode import Moves, read_moves

FloatArray = NDArray[np.float64]


def overlaps_near(
    axes: Axes, one: int, other: int, places: FloatArray, needle_outer_mm: float
) -> bool:
    """Whether two vessels overlap, away from their nodes, within J of one of the places (k, 3)."""
    if one < 0 or other < 0:
        return False
    a, b = _dense(axes, one), _dense(axes, other)
    thick = max(a[:, 3].max(), b[:, 3].max())
    reach = np.sqrt(2.0) * (needle_outer_mm / 2 + thick) + thick / 2
    a, b = _near(a, places, reach), _near(b, places, reach)
    if not len(a) or not len(b):
        return False
    gap = np.linalg.norm(a[:, None, :3] - b[None, :, :3], axis=2)
    touch = gap < a[:, None, 3] + b[None, :, 3]
    if one == other:
        return bool((touch & (np.abs(a[:, None, 4] - b[None, :, 4]) > reach)).any())
    for node in set(axes.ends[one].tolist()) & set(axes.ends[other].tolist()):
        far = [np.linalg.norm(part[:, :3] - axes.node[node], axis=1) > reach for part in (a, b)]
        touch &= far[0][:, None] | far[1][None, :]
    return bool(touch.any())


def _dense(axes: Axes, vessel: int) -> FloatArray:
    """Points, radius and arc length along a vessel, (n, 5)."""
    own = np.flatnonzero(axes.vessel == vessel)
    return np.column_stack([np.asarray(axes.tree.data)[own], axes.radius[own], axes.arc[own]])


def _near(dense: FloatArray, places: FloatArray, reach: float) -> FloatArray:
    gap, _ = KDTree(places).query(dense[:, :3])
    return dense[gap <= reach]


IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class Tips:
    """Places of the tip, ``point`` (n, 3), mm, in order of time.

    ``before``: how many stretches of ink are there by then. ``last``, ``next``: stretch of ink
    whose vessel the needle is at: while writing both that being written; on a travel the one just
    written and the one that follows; -1 where there is none.
    """

    point: FloatArray
    move: IntArray
    before: IntArray
    last: IntArray
    next: IntArray


@dataclass(frozen=True)
class Bad:
    """Moves (n,) of which the shaft enters ink, in order.

    ``through``: stretch of ink that is entered deepest; ``depth_mm``: how deep, radially, at most.
    """

    move: IntArray
    through: IntArray
    depth_mm: FloatArray


def tips_of(moves: Moves, ink: Ink, step_mm: float) -> Tips:
    """Places to look at; a move straight up or down counts at its lowest point, which holds all."""
    goes = ~moves.stands
    travels = np.flatnonzero(goes & ~moves.writes)
    way = moves.end[travels] - moves.start[travels]
    flat = np.linalg.norm(way[:, :2], axis=1)
    count = np.where(flat < 1e-9, 1, np.ceil(moves.length[travels] / step_mm) + 1).astype(np.int64)
    of = np.repeat(np.arange(len(travels)), count)
    nth = np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)
    part = nth / np.maximum(count[of] - 1, 1)
    point = moves.start[travels][of] + part[:, None] * way[of]
    upright = flat[of] < 1e-9
    lowest = np.where(way[:, 2] < 0, moves.end[travels, 2], moves.start[travels, 2])
    point[upright, 2] = lowest[of][upright]
    before = np.searchsorted(ink.move, travels)[of]
    writing = np.arange(len(ink.point))
    move = np.concatenate([ink.move, travels[of]])
    order = np.argsort(move, kind="stable")
    return Tips(
        np.concatenate([ink.tip, point])[order],
        move[order],
        np.concatenate([writing + 1, before])[order],
        np.concatenate([writing, before - 1])[order],
        np.concatenate([writing, np.where(before < len(writing), before, -1)])[order],
    )


def bad_moves(
    moves: Moves,
    ink: Ink,
    axes: Axes,
    cuts: list[tuple[int, FloatArray]],
    needle_outer_mm: float,
    graze_mm: float = 0.005,
) -> Bad:
    """Find moves that drive the shaft deeper than ``graze_mm`` into ink that no joint excuses.

    ``cuts``: vessel and place (3,) off its nodes where a pass begins or ends.
    """
    shaft = needle_outer_mm / 2
    tips = tips_of(moves, ink, shaft / 3)
    member, begin, shape, low, pitch = _grid(ink, shaft)
    offset = np.zeros(len(axes.ends) + 1, dtype=np.int64)
    by_vessel = sorted(cuts, key=lambda cut: cut[0])
    np.add.at(offset, np.array([cut[0] for cut in by_vessel], dtype=np.int64) + 1, 1)
    places = np.array([cut[1] for cut in by_vessel]).reshape(-1, 3)
    depth, through = _enter(
        tips.point, tips.before, tips.last, tips.next, ink.point, ink.radius, ink.vessel,
        ink.stroke, ink.arc, axes.ends, axes.node, np.cumsum(offset), places, member, begin,
        shape, low, pitch, shaft, graze_mm,
    )  # fmt: skip
    hit = np.flatnonzero(depth > 0)
    move, first, samples = np.unique(tips.move[hit], return_index=True, return_counts=True)
    deepest = [
        hit[low : low + n][np.argmax(depth[hit[low : low + n]])]
        for low, n in zip(first, samples, strict=True)
    ]
    at = np.array(deepest, dtype=np.int64)
    return Bad(move, through[at], depth[at])


def _grid(ink: Ink, shaft: float) -> tuple[Any, ...]:
    """Ink by squares of the plan, in order of writing within each."""
    low = ink.point[:, :2].min(axis=0)
    size = np.ptp(ink.point[:, :2], axis=0)
    pitch = max(shaft + float(ink.radius.max()), float(np.sqrt(size.prod() / 1e6)), 1e-3)
    place = np.floor((ink.point[:, :2] - low) / pitch).astype(np.int64)
    shape = place.max(axis=0) + 1
    square = place[:, 0] * shape[1] + place[:, 1]
    begin = np.concatenate([[0], np.cumsum(np.bincount(square, minlength=int(shape.prod())))])
    return np.argsort(square, kind="stable"), begin, shape, low, pitch


@compiled
def _apart(a: Any, b: Any) -> Any:
    return np.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@compiled
def _excused(
    tip: Any, at: Any, other: Any, point: Any, radius: Any, vessel: Any, stroke: Any, arc: Any,
    ends: Any, node: Any, offset: Any, places: Any, shaft: float,
) -> Any:  # fmt: skip
    """Whether ink ``other`` is meant to be touched by a needle at the ink ``at``."""
    r = max(radius[at], radius[other])
    reach = np.sqrt(2.0) * (shaft + r) + 0.5 * r
    if (
        stroke[at] == stroke[other]
        and abs(arc[at] - arc[other]) <= reach
        and _apart(tip, point[at]) <= reach
    ):
        return True
    u, v = vessel[at], vessel[other]
    if u < 0 or v < 0:
        return False
    for i in range(2):
        for j in range(2):
            if ends[u, i] == ends[v, j]:
                corner = node[ends[u, i]]
                if _apart(point[other], corner) <= reach and _apart(tip, corner) <= reach:
                    return True
    if u == v:
        for k in range(offset[u], offset[u + 1]):
            if _apart(point[other], places[k]) <= reach and _apart(tip, places[k]) <= reach:
                return True
    return False


@compiled
def _enter(
    tip: Any, before: Any, last: Any, following: Any, point: Any, radius: Any, vessel: Any,
    stroke: Any, arc: Any, ends: Any, node: Any, offset: Any, places: Any, member: Any, begin: Any,
    shape: Any, low: Any, pitch: float, shaft: float, graze: float,
) -> Any:  # fmt: skip
    """Deepest entry at each place of the tip, mm, and the ink that is entered."""
    n = len(tip)
    depth, through = np.zeros(n), np.zeros(n, np.int64)
    top, seen = -1e30, 0
    for t in range(n):
        while seen < before[t]:
            top = max(top, point[seen, 2] + radius[seen])
            seen += 1
        if tip[t, 2] >= top:
            continue
        column = int(np.floor((tip[t, 0] - low[0]) / pitch))
        row = int(np.floor((tip[t, 1] - low[1]) / pitch))
        for x in range(max(0, column - 1), min(shape[0], column + 2)):
            for y in range(max(0, row - 1), min(shape[1], row + 2)):
                square = x * shape[1] + y
                for m in range(begin[square], begin[square + 1]):
                    i = member[m]
                    if i >= before[t]:
                        break
                    across = np.sqrt(
                        (point[i, 0] - tip[t, 0]) ** 2 + (point[i, 1] - tip[t, 1]) ** 2
                    )
                    below = max(0.0, tip[t, 2] - point[i, 2])
                    gap = np.sqrt(max(0.0, across - shaft) ** 2 + below**2)
                    entered = radius[i] - gap
                    if entered <= max(graze, depth[t]):
                        continue
                    at, to = last[t], following[t]
                    if at >= 0 and _excused(
                        tip[t], at, i, point, radius, vessel, stroke, arc, ends, node, offset,
                        places, shaft,
                    ):  # fmt: skip
                        continue
                    if to >= 0 and to != at and _excused(
                        tip[t], to, i, point, radius, vessel, stroke, arc, ends, node, offset,
                        places, shaft,
                    ):  # fmt: skip
                        continue
                    depth[t], through[t] = entered, i
    return depth, through


SYRINGE_MM = 4.61
"""Bore of the product's default syringe, which says what E pushes."""


def judge(
    gcode_path: Path | str,
    network_csv_path: Path | str,
    needle_outer_mm: float,
    *,
    place_mm: tuple[float, float, float] = (0.0, 0.0, 0.0),
    syringe_bore_mm: float = SYRINGE_MM,
    flow_factor: float = 1.0,
    graze_mm: float = 0.005,
    named: int = 20,
) -> dict[str, Any]:
    """Read G-code and network (mm), and count what is wrong with the print.

    ``place_mm`` is where the network's origin lies in the G-code's frame; 1 mm of E pushes
    pi / 4 bore² × factor. ``bad`` and ``open`` name some moves and joints (line, vessels, place in
    the network's frame); ``bad_moves_elsewhere`` than where the network overlaps itself.
    """
    axes, moves = read_axes(Path(network_csv_path)), read_moves(Path(gcode_path).read_text())
    moves = replace(moves, start=moves.start - place_mm, end=moves.end - place_mm)
    ul_per_e = float(np.pi / 4 * syringe_bore_mm**2 * flow_factor)
    return judge_moves(
        moves, axes, needle_outer_mm, ul_per_e=ul_per_e, graze_mm=graze_mm, named=named
    )


def judge_moves(
    moves: Moves,
    axes: Axes,
    needle_outer_mm: float,
    *,
    ul_per_e: float,
    graze_mm: float = 0.005,
    named: int = 20,
    window_mm: float = WINDOW_MM,
) -> dict[str, Any]:
    """Count what is wrong with a print's moves, in the network's frame; as `judge`.

    ``window_mm``: way over which what is pushed tells the ink's radius (`written_ink`).
    """
    ink = written_ink(moves, axes, ul_per_e, window_mm=window_mm)
    if not len(ink.point):
        raise ValueError("no move writes ink")
    cuts = cuts_of(axes, ink)
    bad = bad_moves(moves, ink, axes, pass_ends(axes, ink), needle_outer_mm, graze_mm)
    unclosed, joints = open_joints(joints_of(axes), axes, moves, ink)
    uncut, cut = open_joints(cuts, axes, moves, ink)
    return {
        **_crossings(bad, moves, ink, axes, needle_outer_mm, named),
        "joints": joints,
        "joints_open": len(unclosed),
        "cuts": cut,
        "cuts_open": len(uncut),
        "open": (unclosed + uncut)[:named],
        **_written(moves, written_ink(moves, axes, ul_per_e, 0.5 * BIN_MM), axes),
    }


def _crossings(
    bad: Bad, moves: Moves, ink: Ink, axes: Axes, needle_outer_mm: float, named: int
) -> dict[str, Any]:
    first = np.searchsorted(ink.move, bad.move)
    writes = moves.writes[bad.move]
    # A travel belongs to the pass that it leads to, a lift to the one that it follows.
    rises = ~writes & (moves.end[bad.move, 2] > moves.start[bad.move, 2])
    at = np.clip(first - rises, 0, len(ink.stroke) - 1)
    share = np.linspace(0.0, 1.0, 33)[:, None, None]
    start, end = moves.start[bad.move], moves.end[bad.move]
    ways = (start + share * (end - start)).transpose(1, 0, 2)
    # An overlap past a node is its own vessel's and, by its place, another's.
    both = np.column_stack([ink.vessel, vessels_of_passes(ink, axes)])
    own = [
        any(overlaps_near(axes, *pair, way, needle_outer_mm) for pair in product(one, other))
        for one, other, way in zip(both[at].tolist(), both[bad.through].tolist(), ways, strict=True)
    ]
    deepest = np.lexsort((-bad.depth_mm, np.array(own)))[:named]
    return {
        "bad_moves": len(bad.move),
        "bad_moves_elsewhere": len(own) - sum(own),
        "bad_travels": int((~writes).sum()),
        "bad_passes": len(np.unique(ink.stroke[at])),
        "bad": [
            {
                "line": int(moves.line[bad.move[k]]),
                "kind": "writing" if writes[k] else "travel",
                "vessel": int(ink.vessel[at[k]]),
                "through": int(ink.vessel[bad.through[k]]),
                "depth_mm": round(float(bad.depth_mm[k]), 4),
                "at_own_overlap": own[k],
                "at_mm": np.round(moves.end[bad.move[k]], 3).tolist(),
            }
            for k in sorted(deepest)
        ],
    }


def _written(moves: Moves, ink: Ink, axes: Axes) -> dict[str, Any]:
    volume = ink.volume_ul
    beside = float(volume[ink.vessel < 0].sum())
    written = float(volume.sum()) - beside
    overlap = overlap_ul(ink, axes)
    speed = moves.speed[moves.writes]
    return {
        "passes": int(ink.stroke.max()) + 1,
        "speed_least_mm_s": round(float(speed.min()), 4),
        "speed_most_mm_s": round(float(speed.max()), 4),
        "design_ul": axes.volume_ul,
        "written_ul": written,
        "beside_ul": beside,
        "overlap_ul": overlap,
        "volume_error_percent": 100 * ((written - overlap) / axes.volume_ul - 1),
    }
