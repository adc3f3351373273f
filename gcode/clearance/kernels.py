"""Find each move's least distance of the needle's shaft from ink written before it (compiled)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from gcode.clearance.approach import pair_approach, shaft_distance, span
from gcode.clearance.arrays import Ink, Joints, Tips
from gcode.clearance.joints import are_related
from gcode.errors import ClearanceError
from gcode.motion.state import Record, Records
from kernels import jit
from kernels.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class NeedleBody:
    """A vertical needle, a body of revolution about the line above its tip.

    Attributes
    ----------
    radius_mm : float, mm
        Outer radius of the shaft.
    tip_radius_mm : float or None, mm
        Outer radius at the tip, at most the shaft's; None for a blunt tube.
    cone_mm : float, mm
        Height over which the one grows to the other; 0 for a blunt tube.
    length_mm : float, mm
        From the tip to the hub; inf where unknown.
    hub_radius_mm : float or None, mm
        Of the hub above the shaft; None where unknown: the shaft then goes on.
    clearance_mm : float, mm
        Between the shaft and what is written. Nearer is reported; touching is a crossing.

    Raises
    ------
    ClearanceError
        For lengths that are none, or a tip wider than the shaft.
    """

    radius_mm: float
    tip_radius_mm: float | None = None
    cone_mm: float = 0.0
    length_mm: float = math.inf
    hub_radius_mm: float | None = None
    clearance_mm: float = 0.0

    def __post_init__(self) -> None:
        for name, sound, limits in (
            ("radius_mm", self.radius_mm > 0, "more than 0"),
            ("length_mm", self.length_mm > 0, "more than 0"),
            ("cone_mm", 0 <= self.cone_mm < math.inf, "0 or more"),
            ("clearance_mm", 0 <= self.clearance_mm < math.inf, "0 or more"),
            ("tip_radius_mm", 0 <= self.tip_mm <= self.radius_mm, "0 to the shaft's radius_mm"),
            ("hub_radius_mm", self.widest_mm >= self.radius_mm, "the shaft's radius_mm or more"),
        ):
            if not sound:
                raise ClearanceError(f"needle: {name} is {getattr(self, name):g}; give {limits}")

    @property
    def tip_mm(self) -> float:
        """Outer radius at the tip, mm."""
        return self.radius_mm if self.tip_radius_mm is None else self.tip_radius_mm

    @property
    def widest_mm(self) -> float:
        """Largest radius anywhere, mm."""
        return self.radius_mm if self.hub_radius_mm is None else self.hub_radius_mm

    def as_row(self) -> FloatArray:
        """For `clearance.kernels.shaft_distance`: radius, tip, cone, length, hub."""
        tip, cone = self.tip_radius_mm, self.cone_mm
        if tip is None or cone == 0:
            tip, cone = self.radius_mm, 0.0
        length, hub = self.length_mm, self.hub_radius_mm
        if hub is None:
            length, hub = math.inf, self.radius_mm
        return np.array([self.radius_mm, tip, cone, length, hub], dtype=np.float64)


MOST_SQUARES: Final = 4_000_000
FOUND: Final = np.dtype(
    [
        ("value", "f8"),
        ("piece", "i8"),
        ("ink", "i8"),
        ("s", "f8"),
        ("t", "f8"),
        ("move", "i8"),
        ("vessel", "i8"),
    ],
    align=True,
)
"""An approach: how near, which pieces, where on them, of which move, to which vessel's ink."""


class Squares(NamedTuple):
    """Ink by squares of the plan, those of square k ``member[begin[k] : begin[k + 1]]``, in time.

    Attributes
    ----------
    origin : (2,) float64, mm
    pitch : float, mm
    shape : (2,) int64
    """

    origin: FloatArray
    pitch: float
    shape: IntArray
    begin: IntArray
    member: IntArray


def squares_of(ink: Ink, pitch_mm: float) -> Squares:
    """Sort ink by where its pieces' middles lie."""
    middle = (ink.start[:, :2] + ink.end[:, :2]) / 2
    origin = middle.min(axis=0)
    size = np.ptp(middle, axis=0)
    pitch = max(pitch_mm, float(np.sqrt(size.prod() / MOST_SQUARES)))
    pitch = max(pitch, float(size.max()) / MOST_SQUARES)
    place = np.floor((middle - origin) / pitch).astype(np.int64)
    shape = place.max(axis=0) + 1
    square = place[:, 0] * shape[1] + place[:, 1]
    begin = np.concatenate([[0], np.cumsum(np.bincount(square, minlength=int(shape.prod())))])
    return Squares(origin, pitch, shape, begin, np.argsort(square, kind="stable"))


@jit
def _middle(start: FloatArray, end: FloatArray) -> tuple[float, float, float]:
    return 0.5 * (start[0] + end[0]), 0.5 * (start[1] + end[1]), 0.5 * (start[2] + end[2])


@jit
def _balls_around(ink: Ink) -> tuple[FloatArray, FloatArray, float]:
    """Middle (n, 3) and radius (n,) of a ball around each piece of ink, the largest radius, mm."""
    count = len(ink.when)
    middle, radius, largest = np.empty((count, 3)), np.empty(count), 0.0
    for j in range(count):
        middle[j, 0], middle[j, 1], middle[j, 2] = _middle(ink.start[j], ink.end[j])
        radius[j] = 0.5 * span(ink.start[j], ink.end[j]) + max(ink.radius[j, 0], ink.radius[j, 1])
        largest = max(largest, radius[j])
    return middle, radius, largest


@jit
def _hit_of(hits: Records, first: int, used: int, vessel: int) -> int:
    """Which of a move's hits is that of ``vessel``; -1 for none yet."""
    for k in range(first, min(used, len(hits))):
        if hits[k].vessel == vessel:
            return k
    return -1


@jit
def _squares_within(at: float, reach: float, squares: Squares, axis: int) -> tuple[int, int]:
    """First and last column or row of squares within ``reach`` of ``at``, mm."""
    begin = (at - reach - squares.origin[axis]) / squares.pitch
    end = (at + reach - squares.origin[axis]) / squares.pitch
    return max(0, int(np.floor(begin))), min(squares.shape[axis] - 1, int(end))


@jit
def search(
    tips: Tips,
    ink: Ink,
    joints: Joints,
    bodies: FloatArray,
    squares: Squares,
    look: float,
    shown_mm: float,
    near: Records,
    apart: Records,
    hits: Records,
) -> int:
    """Find each move's nearest approach, and every vessel to which it comes too near.

    Parameters
    ----------
    bodies : (needles, 5) float64
        `NeedleBody.as_row` of each.
    look : float, mm
        Approaches above it aren't looked for.
    shown_mm : float, mm
        Nearer is a hit.
    near, apart : (moves,) of `FOUND`
        Filled: the nearest of all, and of ink with which no joint is meant; ``value`` must be
        ``look``, and stays where there is none.
    hits : (room,) of `FOUND`
        Filled as far as it reaches: the nearest of each move and vessel.

    Returns
    -------
    int
        How many hits there are.
    """
    middle, half, thick = _balls_around(ink)
    stack = np.empty((64, 4))
    used = first = 0
    for i in range(len(tips.move)):
        move, body, now = tips.move[i], bodies[tips.needle[i]], tips.when[i]
        if i > 0 and tips.move[i - 1] != move:
            first = used
        x, y, z = _middle(tips.start[i], tips.end[i])
        own = 0.5 * span(tips.start[i], tips.end[i])
        reach = max(body[0], body[4]) + thick + own + look
        x0, x1 = _squares_within(x, reach, squares, 0)
        y0, y1 = _squares_within(y, reach, squares, 1)
        for column in range(x0, x1 + 1):
            row = column * squares.shape[1]
            for m in range(squares.begin[row + y0], squares.begin[row + max(y0, y1 + 1)]):
                j = squares.member[m]
                if ink.when[j] > now or (ink.when[j] == now and ink.run[j] != tips.run[i]):
                    continue
                # Nothing of the pair is nearer than this.
                low = shaft_distance(middle[j, 0] - x, middle[j, 1] - y, middle[j, 2] - z, body)
                low -= own + half[j]
                if low >= look or low >= max(near[move].value, apart[move].value, shown_mm):
                    continue
                joined = are_related(i, j, tips, ink, joints)
                w = ink.vessel[j]
                hit = _hit_of(hits, first, used, w)
                limit = max(near[move].value, hits[hit].value if hit >= 0 else shown_mm)
                if not joined:
                    limit = max(limit, apart[move].value)
                if low >= limit:
                    continue
                value, s, t = pair_approach(i, j, limit, joined, tips, ink, joints, body, stack)
                if s < 0.0:
                    continue
                _keep_nearer(near[move], value, i, j, s, t, move, w)
                if not joined:
                    _keep_nearer(apart[move], value, i, j, s, t, move, w)
                if value >= shown_mm:
                    continue
                if hit < 0:
                    hit, used = used, used + 1
                    if hit < len(hits):
                        hits[hit].value = np.inf
                if hit < len(hits):
                    _keep_nearer(hits[hit], value, i, j, s, t, move, w)
    return used


@jit
def _keep_nearer(
    row: Record, value: float, piece: int, ink: int, s: float, t: float, move: int, vessel: int
) -> None:
    """Write an approach into ``row`` if it is nearer than the one there."""
    if value < row.value:
        row.value, row.piece, row.ink, row.s, row.t = value, piece, ink, s, t
        row.move, row.vessel = move, vessel
