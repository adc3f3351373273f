"""Find contacts of needle tip or shaft with written ink along given moves, in layers or a bath.

In layers the tip rides on the tops of its neighbours, as the job's own does; ink that stands
higher within the needle's outer diameter is in its way. In a bath the check is that of whole jobs,
`sim.gcode.clearance`: each written path is a vessel, and paths whose filaments overlap have a
joint.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from firmware_profiles import Needle
from kernels.arrays import BoolArray, FloatArray, IntArray
from printctl.observe.mending.held_print import WrittenPath
from printctl.observe.mending.laid_ink import LaidInk
from sim.gcode.clearance import (
    NeedleBody,
    NeedleMotion,
    ShaftContact,
    WrittenNetwork,
    check_clearance,
)
from sim.gcode.deposit.written import LEVEL_TOLERANCE_MM

OVERLAP_RADII: Final = 0.5
"""Of joints, as the embedded planner has it."""
_NODE_DECIMALS: Final = 4
_SAME_MM: Final = 1e-6
_HIGH_MM: Final = 50.0
"""Above all ink, where the needle comes from."""


def needle_body(needle: Needle, clearance_mm: float) -> NeedleBody:
    """Return the mounted needle's shape for the shaft check."""
    return NeedleBody(
        needle.outer_mm / 2,
        (needle.tip_outer_mm or needle.outer_mm) / 2,
        needle.cone_mm or 0.0,
        needle.length_mm,
        needle.hub_outer_mm / 2 if needle.hub_outer_mm else None,
        clearance_mm=clearance_mm,
    )


def under_higher_ink(
    places: FloatArray, ink: LaidInk, needle: Needle, clearance_mm: float
) -> BoolArray:
    """Which tip places (m, 3) the needle can't reach because ink of a higher layer lies there."""
    blocked = np.zeros(len(places), dtype=bool)
    if not len(places):
        return blocked
    wide = max(needle.outer_mm, needle.tip_outer_mm or 0.0) / 2 + clearance_mm
    top = np.maximum(ink.start[:, 2], ink.end[:, 2])
    low = places[:, :2].min(axis=0) - wide
    high = places[:, :2].max(axis=0) + wide
    half = ink.width_mm[:, None] / 2
    near = (np.minimum(ink.start, ink.end)[:, :2] - half <= high).all(axis=1)
    near &= (np.maximum(ink.start, ink.end)[:, :2] + half >= low).all(axis=1)
    near &= top > places[:, 2].min() + LEVEL_TOLERANCE_MM
    for k in np.flatnonzero(near):
        a, step = ink.start[k, :2], (ink.end[k] - ink.start[k])[:2]
        square = float(step @ step)
        share = np.clip((places[:, :2] - a) @ step / square, 0, 1) if square > 0 else 0.0
        away = np.linalg.norm(a + np.multiply.outer(share, step) - places[:, :2], axis=1)
        above = top[k] > places[:, 2] + LEVEL_TOLERANCE_MM
        blocked |= above & (away < wide + ink.width_mm[k] / 2)
    return blocked


@dataclass(frozen=True, eq=False)
class NeedleRows:
    """Moves of the needle that are to be checked, in their order.

    Attributes
    ----------
    tips : (n + 1, 3) float64, mm
        Place before the first move, and after each.
    volume_ul : (n,) float64, µL
        Laid by each; 0 for a travel.
    path : (n,) int64
        `WrittenPath` that each writes; -1 for a travel.
    """

    tips: FloatArray
    volume_ul: FloatArray
    path: IntArray


def shaft_contacts(
    rows: NeedleRows,
    ink: LaidInk,
    paths: Sequence[WrittenPath],
    needle: Needle,
    clearance_mm: float,
    stood_mm: FloatArray | None = None,
) -> tuple[tuple[int, ShaftContact], ...]:
    """Return crossings of the shaft with written ink: the row of each, from 0, and the contact.

    Parameters
    ----------
    rows : NeedleRows
    ink : LaidInk
        What lies there before the first row.
    paths : sequence of WrittenPath
    needle : Needle
    clearance_mm : float, mm
        Kept in planning; nearer alone is no crossing.
    stood_mm : (3,) float64, mm, or None
        Where the tip stands before the first row by the job's own way: ink that the shaft stands
        in there isn't met anew straight above that place.
    """
    if not len(rows.path):
        return ()
    past, volumes, which = _past(ink)
    bridge = _bridge(past[-1, 1] if len(past) else rows.tips[0], rows.tips[0], ink)
    own = np.stack([rows.tips[:-1], rows.tips[1:]], axis=1)
    tips = np.concatenate([past, bridge, own])
    vessel = np.concatenate([which, np.full(len(bridge), -1), rows.path]).astype(np.int64)
    volume = np.concatenate([volumes, np.zeros(len(bridge)), rows.volume_ul])
    count = len(tips)
    moved = np.linalg.norm(tips[:, 1] - tips[:, 0], axis=1) > 0
    motion = NeedleMotion(
        tips[None],
        np.zeros(count, np.int64),
        np.arange(1, count + 1, dtype=np.int64),
        np.where(moved, volume, 0.0),
        moved & (volume > 0),
        vessel,
    )
    body = needle_body(needle, clearance_mm)
    clearance = check_clearance(motion, network_of(paths), [body], OVERLAP_RADII)
    first = count - len(own) + 1
    contacts = ((one.line - first, one) for one in clearance.crossings if one.line >= first)
    joint = math.sqrt(2) * (body.radius_mm + float(ink.width_mm.max(initial=0.0)) / 2)
    return tuple(
        (row, one)
        for row, one in contacts
        if stood_mm is None
        or not (_stands(rows, row, stood_mm) and _known(one, stood_mm, first, joint))
    )


def _stands(rows: NeedleRows, row: int, stood_mm: FloatArray) -> bool:
    """Whether a row only rises from where the print is held, or comes back to it from above."""
    off = rows.tips[row : row + 2] - stood_mm
    return bool(np.abs(off[:, :2]).max() < _SAME_MM and off[:, 2].min() > -_SAME_MM)


def _known(contact: ShaftContact, held_mm: FloatArray, first: int, joint_mm: float) -> bool:
    """Whether the shaft stood in that ink already while the print was held, or in its joint."""
    near = np.linalg.norm(np.array(contact.place_mm) - held_mm) <= joint_mm
    return contact.crossed_line < first or bool(near)


def network_of(paths: Sequence[WrittenPath]) -> WrittenNetwork:
    """Return written paths as a network: a vessel each, nodes where ends meet."""
    ends = np.array([end for path in paths for end in (path.points[0], path.points[-1])])
    nodes, which = np.unique(ends.round(_NODE_DECIMALS), axis=0, return_inverse=True)
    count = [len(path.points) for path in paths]
    radius = [np.append(path.width_mm, path.width_mm[-1]) / 2 for path in paths]
    return WrittenNetwork(
        nodes,
        which.reshape(-1, 2).astype(np.int64),
        np.concatenate([[0], np.cumsum(count)]).astype(np.int64),
        np.concatenate([path.points for path in paths]),
        np.concatenate(radius),
    )


def _past(ink: LaidInk) -> tuple[FloatArray, FloatArray, IntArray]:
    """Written pieces as rows of motion, with a row between those that don't follow each other."""
    if not len(ink):
        return np.zeros((0, 2, 3)), np.zeros(0), np.zeros(0, np.int64)
    volume = np.pi / 4 * ink.width_mm**2 * ink.length_mm
    jumps = np.flatnonzero(np.linalg.norm(ink.start[1:] - ink.end[:-1], axis=1) > 1e-9) + 1
    rows = np.stack([ink.start, ink.end], axis=1)
    between = np.stack([ink.end[jumps - 1], ink.start[jumps]], axis=1)
    return (
        np.insert(rows, jumps, between, axis=0),
        np.insert(volume, jumps, 0.0),
        np.insert(ink.path, jumps, -1),
    )


def _bridge(start: FloatArray, end: FloatArray, ink: LaidInk) -> FloatArray:
    """Rows that bring the needle from one place to another above all ink, (k, 2, 3)."""
    high = max(ink.top_mm(layered=False), float(start[2]), float(end[2])) + _HIGH_MM
    corners = np.array([start, [*start[:2], high], [*end[:2], high], end])
    return np.stack([corners[:-1], corners[1:]], axis=1)
