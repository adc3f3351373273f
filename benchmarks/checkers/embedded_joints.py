"""Check that ink overlaps at every joint. Shares no code with the product.

At a node of the network, and wherever a vessel is cut between two passes, all that meets there must
hold together: two visits of the needle do where the path of one runs at least half the thinner
radius (less `SLACK`) inside the ink of the other, whose ends are taken as flat. Passes of one
vessel side by side hold together where their beads overlap over a radius' length.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from benchmarks.checkers.embedded_ink import Axes, Ink
from benchmarks.checkers.read_gcode import Moves

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Side = tuple[int, float]
"""A vessel, and the arc length at which its ink is looked for."""

SLACK = 0.05
FLAT_MM = 0.01
"""How far beyond its end a filament is taken to reach: the G-code's rounding and a little."""
AT_NODE = 1.25
"""Passes that end within so many radii of a node end in its joint."""


@dataclass(frozen=True)
class Joint:
    """A place (3,) where ink must hold together, radius of the widest vessel there, mm.

    ``node`` is -1 for a cut inside a vessel.
    """

    place: FloatArray
    radius: float
    sides: list[Side]
    node: int


@dataclass(frozen=True)
class _Visit:
    """A stay of one pass near a joint: points ``(k, 3)`` with corners ``path``, radius."""

    points: FloatArray
    step: float
    path: FloatArray
    radius: float


def joints_of(axes: Axes) -> list[Joint]:
    """All nodes at which vessels meet."""
    sides: dict[int, list[tuple[int, int]]] = {}
    for vessel, ends in enumerate(axes.ends.tolist()):
        for end, node in enumerate(ends):
            sides.setdefault(node, []).append((vessel, end))
    found = []
    for node, meet in sorted(sides.items()):
        if len(meet) < 2:
            continue
        radius = max(float(axes.lines[v][-e, 3]) for v, e in meet)
        found.append(
            Joint(axes.node[node], radius, [_side(axes, v, e, radius) for v, e in meet], node)
        )
    return found


def _side(axes: Axes, vessel: int, end: int, radius: float) -> Side:
    length = float(axes.length[vessel])
    arc = min(1.5 * radius, 0.5 * length)
    return vessel, length - arc if end else arc


def pass_ends(axes: Axes, ink: Ink) -> list[tuple[int, FloatArray]]:
    """Vessel and place of each end of a pass that stands off the vessel's own nodes.

    By more than three quarters of its radius there: what is nearer is a joint's overlap.
    """
    found = []
    for k in _ends(ink).tolist():
        vessel = int(ink.vessel[k])
        gap = np.linalg.norm(axes.node[axes.ends[vessel]] - ink.point[k], axis=1).min()
        if gap > 0.75 * ink.design_radius[k]:
            found.append((vessel, ink.point[k]))
    return found


def _ends(ink: Ink) -> IntArray:
    """First and last stretch of each pass, those beside the network left out."""
    first = np.flatnonzero(np.diff(ink.stroke, prepend=-1))
    at = np.concatenate([first, np.append(first[1:], len(ink.stroke)) - 1])
    return at[ink.vessel[at] >= 0]


def cuts_of(axes: Axes, ink: Ink) -> list[Joint]:
    """Places inside vessels, apart from their nodes, where passes begin or end."""
    at = _ends(ink)
    widest = np.zeros(len(axes.node))
    for k in (0, 1):
        np.maximum.at(widest, axes.ends[:, k], [line[-k, 3] for line in axes.lines])
    gap = KDTree(axes.node).query(ink.point[at])
    inner = at[gap[0] > AT_NODE * widest[gap[1]] + 0.02]
    found: list[Joint] = []
    done: dict[int, list[float]] = {}
    for k in inner[np.lexsort((ink.vessel_arc[inner], ink.vessel[inner]))].tolist():
        vessel, arc = int(ink.vessel[k]), float(ink.vessel_arc[k])
        radius = float(ink.design_radius[k])
        if any(abs(arc - other) < 1.5 * radius for other in done.get(vessel, [])):
            continue
        done.setdefault(vessel, []).append(arc)
        back = min(1.5 * radius, 0.5 * arc)
        on = min(1.5 * radius, 0.5 * (float(axes.length[vessel]) - arc))
        place = axes.at(vessel, arc)[:3]
        found.append(Joint(place, radius, [(vessel, arc - back), (vessel, arc + on)], -1))
    return found


def open_joints(
    joints: list[Joint], axes: Axes, moves: Moves, ink: Ink
) -> tuple[list[dict[str, Any]], int]:
    """The joints at which something doesn't hold together, named; and how many were looked at.

    A cut that one pass runs through is none.
    """
    if not len(ink.point):
        return [_named(joint, "nothing is written") for joint in joints], len(joints)
    tree, looked, found = KDTree(ink.point), 0, []
    reach = float(ink.length.max())
    for joint in joints:
        ball = 2.5 * joint.radius + 0.1
        near = np.array(tree.query_ball_point(joint.place, ball + reach), dtype=np.int64)
        visits = _visits(moves, ink, np.sort(near), joint.place, ball)
        at = [_at(axes, side, visits) for side in joint.sides]
        if joint.node < 0 and any(set(at[0]) & set(at[1])):
            continue
        looked += 1
        why = _why_open(at, visits, joint)
        if why:
            found.append(_named(joint, why))
    return found, looked


def _named(joint: Joint, why: str) -> dict[str, Any]:
    place = [round(float(x), 3) for x in joint.place]
    kind = {"node": joint.node} if joint.node >= 0 else {"cut": True}
    return kind | {"vessels": [side[0] for side in joint.sides], "at_mm": place, "why": why}


def _visits(moves: Moves, ink: Ink, near: IntArray, place: FloatArray, ball: float) -> list[_Visit]:
    """Stays of passes within the ball, in order of time."""
    if not len(near):
        return []
    found = []
    move, index = np.unique(ink.move[near], return_index=True)
    stroke = ink.stroke[near][index]
    # Between two moves of a pass only the plunger may have moved.
    nth = np.cumsum(moves.writes)[move]
    for group in np.split(
        np.arange(len(move)), np.flatnonzero((np.diff(nth) > 1) | (np.diff(stroke) != 0)) + 1
    ):
        inside = np.isin(ink.move[near], move[group])
        radius = float(ink.radius[near][inside].mean())
        path = np.vstack([moves.start[move[group]], moves.end[move[group][-1:]]])
        step = radius / 40
        points = _sampled(path, step, place, ball)
        if len(points):
            found.append(_Visit(points, step, path, radius))
    return found


def _sampled(path: FloatArray, step: float, place: FloatArray, ball: float) -> FloatArray:
    """Points along a path within a ball."""
    parts = []
    for start, end in pairwise(path):
        way = end - start
        length = float(np.linalg.norm(way))
        middle = float((place - start) @ way) / length
        low, high = max(0.0, middle - ball), min(length, middle + ball)
        if high <= low:
            continue
        at = np.arange(low, high, step) + step / 2
        parts.append(start + at[at < high][:, None] * (way / length))
    points: FloatArray = np.concatenate(parts) if parts else np.zeros((0, 3))
    within: NDArray[np.bool_] = np.linalg.norm(points - place, axis=1) <= ball
    return points[within]


def _at(axes: Axes, side: Side, visits: list[_Visit]) -> list[int]:
    """Which visits wrote a vessel on one side of a joint."""
    x, y, z, radius = axes.at(*side)
    gap = [np.linalg.norm(v.points - (x, y, z), axis=1).min() for v in visits]
    close = [k for k, g in enumerate(gap) if g <= max(0.3 * radius, 0.03)]
    return close or [k for k, g in enumerate(gap) if g <= radius]


def _why_open(at: list[list[int]], visits: list[_Visit], joint: Joint) -> str:
    bare = [side[0] for side, own in zip(joint.sides, at, strict=True) if not own]
    if bare:
        return f"nothing is written of vessel {bare[0]} there"
    same = list(range(len(visits)))

    def root(k: int) -> int:
        while same[k] != k:
            k = same[k]
        return k

    for late in range(len(visits)):
        for early in range(late):
            if root(early) != root(late) and _hold(visits[early], visits[late], joint.node < 0):
                same[root(late)] = root(early)
    apart = {root(k) for own in at for k in own}
    if len(apart) == 1:
        return ""
    pairs = [(a, b) for b in range(len(visits)) for a in range(b)]
    inside = max((_overlap(visits[a], visits[b]) for a, b in pairs), default=0.0)
    return f"{len(apart)} parts don't hold together; the longest overlap is {inside:.3f} mm"


def _hold(early: _Visit, late: _Visit, one_vessel: bool) -> bool:
    need = 0.5 * min(early.radius, late.radius)
    if _overlap(early, late) >= (1 - SLACK) * need - late.step:
        return True
    reach = 0.95 * (early.radius + late.radius)
    return one_vessel and _inside(early, late, reach) >= 2 * need


def _overlap(one: _Visit, other: _Visit) -> float:
    return max(_inside(one, other, one.radius), _inside(other, one, other.radius))


def _inside(early: _Visit, late: _Visit, reach: float) -> float:
    """Length of the later path within ``reach`` of the earlier one, whose ends are flat, mm."""
    start, way = early.path[:-1], np.diff(early.path, axis=0)
    size = np.linalg.norm(way, axis=1)
    offset = late.points[:, None, :] - start
    along = np.einsum("ijk,jk->ij", offset, way) / size
    held = along.clip(0.0, size)
    gap = np.linalg.norm(offset - (held / size)[..., None] * way, axis=2)
    beyond = np.zeros_like(gap, dtype=bool)
    beyond[:, 0] |= along[:, 0] < -FLAT_MM
    beyond[:, -1] |= along[:, -1] > size[-1] + FLAT_MM
    within: FloatArray = ((gap <= reach) & ~beyond).any(axis=1)
    return float(within.sum() * late.step)
