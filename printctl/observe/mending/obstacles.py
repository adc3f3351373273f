"""Obstacles of a mend: designed voids that stay open, and written ink in the needle's way.

In layers the tip rides on the tops of its neighbours, as the job's own does; ink that stands
higher within the needle's outer diameter is in its way. In a bath the check is that of whole jobs,
`gcode.clearance`: each written path is a vessel, and paths whose filaments overlap have a
joint.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from design.network import VesselNetwork
from firmware_profiles import Needle
from gcode.clearance.check import ShaftContact, check_clearance
from gcode.clearance.kernels import NeedleBody
from gcode.clearance.motion import NeedleMotion
from gcode.clearance.network import WrittenNetwork
from gcode.deposit.written import LEVEL_TOLERANCE_MM
from kernels.arrays import BoolArray, FloatArray, IntArray
from printctl.observe.mending.held_print import HeldPrint, MendError, WrittenPath, written_paths
from printctl.observe.mending.laid_ink import LaidInk, laid_ink

_RIM_PLACES = 16
"""Places on the rim of a line that are checked."""


@dataclass(frozen=True, eq=False)
class Voids:
    """Straight, tapered tubes without ink, in the printer's frame.

    Attributes
    ----------
    start, end : (n, 3) float64, mm
    radius : (n, 2) float64, mm
        At both ends.

    Raises
    ------
    MendError
        When the arrays don't belong together.
    """

    start: FloatArray
    end: FloatArray
    radius: FloatArray

    def __post_init__(self) -> None:
        count = len(self.start)
        if self.start.shape != (count, 3) or self.end.shape != (count, 3):
            raise MendError("voids: start and end are (n, 3), mm")
        if self.radius.shape != (count, 2) or not (np.isfinite(self.radius).all()):
            raise MendError("voids: radius is (n, 2), mm, at both ends")

    @staticmethod
    def none() -> Voids:
        """Return an empty set of voids."""
        return Voids(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 2)))

    @staticmethod
    def from_network(network: VesselNetwork, place_mm: ArrayLike) -> Voids:
        """Return a network's lumens, moved by ``place_mm`` from the part's frame."""
        inner = np.ones(len(network.points) - 1, dtype=bool)
        inner[network.offset[1:-1] - 1] = False
        begin = np.flatnonzero(inner)
        points = network.points + np.asarray(place_mm, dtype=np.float64)
        radius = np.column_stack([network.radius[begin], network.radius[begin + 1]])
        return Voids(points[begin], points[begin + 1], radius)

    def __len__(self) -> int:
        return len(self.start)

    def near(self, low: FloatArray, high: FloatArray) -> Voids:
        """Return the voids that reach into a box, corners (3,) mm."""
        wide = self.radius.max(axis=1, initial=0.0)[:, None]
        below = np.minimum(self.start, self.end) - wide <= high
        above = np.maximum(self.start, self.end) + wide >= low
        return self.where((below & above).all(axis=1))

    def where(self, rows: BoolArray) -> Voids:
        """Return the voids of a mask."""
        return Voids(self.start[rows], self.end[rows], self.radius[rows])

    def depth_mm(self, places: FloatArray) -> FloatArray:
        """Return how deep places (m, 3) lie in the nearest void, (m,), mm; below 0 outside.

        Of a tapered tube the radius beside the place's foot on the axis counts: exact for
        straight tubes, to (Δr / length)² / 2 of the radius for others.
        """
        depth = np.full(len(places), -np.inf)
        for a, b, (r0, r1) in zip(self.start, self.end, self.radius, strict=True):
            step = b - a
            square = float(step @ step)
            share = np.zeros(len(places))
            if square > 0:
                share = np.clip((places - a) @ step / square, 0.0, 1.0)
            away = np.linalg.norm(a + share[:, None] * step - places, axis=1)
            np.maximum(depth, r0 + share * (r1 - r0) - away, out=depth)
        return depth


def ink_in_voids_mm(
    voids: Voids,
    places: FloatArray,
    width_mm: FloatArray,
    height_mm: FloatArray,
    *,
    layered: bool,
) -> FloatArray:
    """Return how deep ink around tip places reaches into a void, (m,), mm; below 0 for none.

    A line of a layer is checked in the middle of its height, where the design's layers are cut
    (`design.toolpath.fresh.section`), as a disc of its width; a filament as a ball.

    Parameters
    ----------
    voids : Voids
    places : (m, 3) float64, mm
        Of the tip.
    width_mm, height_mm : (m,) float64, mm
    layered : bool
    """
    reach = width_mm.max(initial=0.0) / 2 + height_mm.max(initial=0.0)
    if not len(places):
        return np.zeros(0)
    close = voids.near(places.min(axis=0) - reach, places.max(axis=0) + reach)
    if not layered:
        return close.depth_mm(places) + width_mm / 2
    middle = places - np.array([0.0, 0.0, 0.5]) * height_mm[:, None]
    deepest = close.depth_mm(middle)
    for angle in np.linspace(0.0, 2 * np.pi, _RIM_PLACES, endpoint=False):
        side = np.array([np.cos(angle), np.sin(angle), 0.0])
        np.maximum(deepest, close.depth_mm(middle + width_mm[:, None] / 2 * side), out=deepest)
    return deepest


_MAX_AXIS_OFFSET_RADII: Final = 0.5
"""Share of a void's radius within which a written axis is the void's own."""


def open_voids(voids: Voids, held_print: HeldPrint, places: FloatArray, reach_mm: float) -> Voids:
    """Return the voids near places (m, 3), mm, that ink must keep out of.

    An embedded print writes sacrificial ink where its lumens are to be, so a network's vessels are
    voids to it only where no path of the job, written or to come, goes along them.
    """
    if held_print.layered or not len(voids) or not len(places):
        return voids
    close = voids.near(places.min(axis=0) - reach_mm, places.max(axis=0) + reach_mm)
    planned = laid_ink(written_paths(held_print, len(held_print.lines)))
    own = np.ones(len(close), dtype=bool)
    for share in (0.1, 0.5, 0.9):
        axis = close.start + share * (close.end - close.start)
        own &= planned.nearest(axis)[1] <= _MAX_AXIS_OFFSET_RADII * close.radius.mean(axis=1)
    return close.where(~own)


OVERLAP_RADII: Final = 0.5
"""Of joints, as the embedded planner has it."""
_NODE_DECIMALS: Final = 4
_SAME_PLACE_MM: Final = 1e-6
_APPROACH_HEIGHT_MM: Final = 50.0
"""Height above all ink of a travel to the held position."""


def under_higher_ink(
    places: FloatArray, ink: LaidInk, needle: Needle, clearance_mm: float
) -> BoolArray:
    """Return the mask of tip places (m, 3) that ink of a higher layer blocks."""
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
    past, volumes, which = _past_rows(ink)
    bridge = _bridge_rows(past[-1, 1] if len(past) else rows.tips[0], rows.tips[0], ink)
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
    body = NeedleBody(
        needle.outer_mm / 2, (needle.tip_outer_mm or needle.outer_mm) / 2, needle.cone_mm or 0.0,
        needle.length_mm, needle.hub_outer_mm / 2 if needle.hub_outer_mm else None,
        clearance_mm=clearance_mm,
    )  # fmt: skip
    clearance = check_clearance(motion, _network_of(paths), [body], OVERLAP_RADII)
    first = count - len(own) + 1
    contacts = ((one.line - first, one) for one in clearance.crossings if one.line >= first)
    joint = math.sqrt(2) * (body.radius_mm + float(ink.width_mm.max(initial=0.0)) / 2)
    return tuple(
        (row, one)
        for row, one in contacts
        if stood_mm is None
        or not (_is_at_hold(rows, row, stood_mm) and _was_in_ink(one, stood_mm, first, joint))
    )


def _is_at_hold(rows: NeedleRows, row: int, stood_mm: FloatArray) -> bool:
    """Return whether a row only rises from the held position, or descends to it."""
    off = rows.tips[row : row + 2] - stood_mm
    return bool(np.abs(off[:, :2]).max() < _SAME_PLACE_MM and off[:, 2].min() > -_SAME_PLACE_MM)


def _was_in_ink(contact: ShaftContact, held_mm: FloatArray, first: int, joint_mm: float) -> bool:
    """Return whether the shaft stood in that ink, or in its joint, while the print was held."""
    near = np.linalg.norm(np.array(contact.place_mm) - held_mm) <= joint_mm
    return contact.crossed_line < first or bool(near)


def _network_of(paths: Sequence[WrittenPath]) -> WrittenNetwork:
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


def _past_rows(ink: LaidInk) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return written pieces as rows of motion, with travel rows between separate ones."""
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


def _bridge_rows(start: FloatArray, end: FloatArray, ink: LaidInk) -> FloatArray:
    """Return travel rows from one place to another above all ink, (k, 2, 3)."""
    high = max(ink.top_mm(layered=False), float(start[2]), float(end[2])) + _APPROACH_HEIGHT_MM
    corners = np.array([start, [*start[:2], high], [*end[:2], high], end])
    return np.stack([corners[:-1], corners[1:]], axis=1)
