"""Find each move's least distance of the needle's shaft from ink written before it (compiled)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from gcode.errors import ClearanceError
from gcode.motion.state import Record, Records
from kernels import jit
from kernels.arrays import FloatArray, IntArray

# Input arrays of the shaft check kernels: written ink, moving tips, vessel joints.

LEFT, NEXT = 0, 1
"""Roles of a vessel for a piece of motion: written or left, and gone to."""


class Ink(NamedTuple):
    """Written pieces in the order of time, each a filament with a straight axis.

    Attributes
    ----------
    start, end : (n, 3) float64, mm
    radius : (n, 2) float64, mm
        At both.
    when : (n,) int64
        Piece of motion that wrote it.
    run : (n,) int64
        Pass that it is of.
    vessel : (n,) int64
        -1 for none.
    arc : (n, 2) float64, mm
        Path written in its pass before each end.
    along : (n, 2) float64, mm
        Of each end, along its vessel.
    """

    start: FloatArray
    end: FloatArray
    radius: FloatArray
    when: IntArray
    run: IntArray
    vessel: IntArray
    arc: FloatArray
    along: FloatArray


class Tips(NamedTuple):
    """Pieces of motion of every needle's tip.

    Attributes
    ----------
    start, end : (n, 3) float64, mm
    move : (n,) int64
        Which move each is of; those of one move stand together.
    when : (n,) int64
        Order in time.
    needle : (n,) int64
    run : (n,) int64
        Pass that it writes, or that this needle has written last; -1 for none.
    arc : (n, 2) float64, mm
        Path in that pass, and since its end, before each end.
    vessel : (n, 2) int64
        By role: written or left, and gone to; -1 for none.
    radius : (n, 2) float64, mm
        Of the filament, by role.
    along : (n, 2, 2) float64, mm
        By role, at each end: the place along that vessel.
    since : (n, 2, 2) float64, mm
        By role, at each end: way from the pass's end, or to the next one's start; 0 in a pass.
    """

    start: FloatArray
    end: FloatArray
    move: IntArray
    when: IntArray
    needle: IntArray
    run: IntArray
    arc: FloatArray
    vessel: IntArray
    radius: FloatArray
    along: FloatArray
    since: FloatArray


class Joints(NamedTuple):
    """Where vessels meet, those of vessel ``v`` in ``begin[v] : begin[v + 1]``.

    Attributes
    ----------
    begin : (v + 1,) int64
    other : (m,) int64
        The vessel met, ascending for each vessel; the same one where it meets itself.
    own, there : (m,) float64, mm
        Way along the vessel, ascending for each other, and along that one.
    wide : (m,) float64, mm
        How far the place itself reaches to either side: 0 for a node.
    gap : (m,) float64, mm
        Between the two axes: 0 for a node.
    radius_mm : float, mm
        The thinnest needle's at its tip, without its clearance.
    lumen_mm : (v,) float64, mm
        Radius of a lumen that is written as several strands: joints reach by it. 0 for others.
    length_mm : (v,) float64, mm
    """

    begin: IntArray
    other: IntArray
    own: FloatArray
    there: FloatArray
    wide: FloatArray
    gap: FloatArray
    radius_mm: float
    overlap_radii: float
    lumen_mm: FloatArray
    length_mm: FloatArray


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


# Kernel: clearance between a moving shaft and a written filament, excluding joints.
#
# A shaft S with its tip at the origin is a body of revolution about the upward axis. Its signed
# distance d_S (negative inside) is a 1-Lipschitz function of place. With the tip at b(s) on a move
# and the filament's axis at a(t), radius r(t), both linear, the approach is
#
# g(s, t) = d_S(a(t) - b(s)) - r(t),
#
# whose minimum over 0 <= s, t <= 1 is the nearest approach of the swept shaft to the filament, a
# union of balls. |dg/ds| is at most the move's length and |dg/dt| the filament's plus |r1 - r0|. So
# a rectangle of s and t with half sides hs and ht holds nothing below its middle's g less those
# slopes times hs and ht: `pair_approach` cuts rectangles in half and drops those that can't lie
# below what is found already. What it returns is attained, and not above the true minimum by more
# than `error_mm` (or `error_share` of it, where that is more). A joint's border is found within
# `deciding_error_mm` of arc length in the same way, since its slack is Lipschitz, too.


class SearchAccuracy(NamedTuple):
    """Accuracy of the shaft search."""

    error_mm: float = 0.002
    error_share: float = 0.05
    deciding_mm: float = 0.02
    # So small an error where the shaft is no deeper in ink than the first: there it decides what
    # crosses.
    deciding_error_mm: float = 0.0005


SEARCH: Final = SearchAccuracy()


@jit
def pair_approach(
    i: int,
    j: int,
    limit: float,
    joined: bool,
    tips: Tips,
    ink: Ink,
    joints: Joints,
    body: FloatArray,
    stack: FloatArray,
) -> tuple[float, float, float]:
    """Nearest approach of a piece of motion to a piece of ink outside joints.

    Parameters
    ----------
    limit : float, mm
        Only an approach below it counts.
    joined : bool
        As `related` says.
    stack : (64, 4) float64
        Scratch space.

    Returns
    -------
    value : float, mm
        ``limit`` where there is none.
    s, t : float
        Where, as shares of the two pieces.
    """
    best, best_s, best_t = limit, -1.0, -1.0
    move = span(tips.start[i], tips.end[i])
    way = span(ink.start[j], ink.end[j])
    fall = way + abs(ink.radius[j, 1] - ink.radius[j, 0])
    by_s = max(move, tip_slope(i, tips)) if joined else move
    by_t = max(fall, ink_slope(j, ink)) if joined else fall
    stack[0, 0], stack[0, 1], stack[0, 2], stack[0, 3] = 0.0, 1.0, 0.0, 1.0
    count = 1
    while count > 0:
        count -= 1
        s0, s1, t0, t1 = stack[count, 0], stack[count, 1], stack[count, 2], stack[count, 3]
        s, t, hs, ht = 0.5 * (s0 + s1), 0.5 * (t0 + t1), 0.5 * (s1 - s0), 0.5 * (t1 - t0)
        value = approach(i, j, s, t, tips, ink, body)
        error = max(SEARCH.error_mm, SEARCH.error_share * best)
        if -SEARCH.deciding_mm < best < 0.0:
            error = SEARCH.deciding_error_mm
        if value - hs * move - ht * fall >= best - error:
            continue
        if joined:
            slack, margin = slack_of(i, j, s, t, tips, ink, joints), hs * by_s + ht * by_t
            if slack > margin:
                continue
            if slack > 0.0 and margin <= SEARCH.deciding_error_mm:
                continue
            if slack <= 0.0 and value < best:
                best, best_s, best_t = value, s, t
        elif value < best:
            best, best_s, best_t = value, s, t
        if hs * by_s + ht * by_t <= 0.25 * SEARCH.deciding_error_mm:
            continue
        if hs * by_s >= ht * by_t:
            stack[count, 0], stack[count, 1], stack[count, 2], stack[count, 3] = s0, s, t0, t1
            stack[count + 1, 0], stack[count + 1, 1] = s, s1
            stack[count + 1, 2], stack[count + 1, 3] = t0, t1
        else:
            stack[count, 0], stack[count, 1], stack[count, 2], stack[count, 3] = s0, s1, t0, t
            stack[count + 1, 0], stack[count + 1, 1] = s0, s1
            stack[count + 1, 2], stack[count + 1, 3] = t, t1
        count += 2
    return best, best_s, best_t


@jit
def span(a: FloatArray, b: FloatArray) -> float:
    """Distance of two places, mm; spelt out, which compiles faster than array arithmetic."""
    x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    return float(np.sqrt(x * x + y * y + z * z))


@jit
def shaft_distance(x: float, y: float, z: float, body: FloatArray) -> float:
    """Signed distance of a place, from the tip, to the shaft, mm; negative inside.

    ``body`` is `NeedleBody.as_row`: radius, tip's radius, cone's height, length, hub's radius. In
    the half plane of radius and height the shaft (without hub) is convex: above 0, within the
    shaft's radius, within the cone's slant.
    """
    rho = np.sqrt(x * x + y * y)
    wide, tip, cone = body[0], body[1], body[2]
    if cone <= 0.0:
        out = _corner(rho - wide, -z)
    else:
        slant = np.sqrt(cone * cone + (wide - tip) ** 2)
        across = ((rho - tip) * cone - z * (wide - tip)) / slant
        inside = max(-z, rho - wide, across)
        if inside <= 0.0:
            out = inside
        else:
            # Nearest of tip's disc, slant and shaft.
            share = ((rho - tip) * (wide - tip) + z * cone) / (slant * slant)
            share = min(max(share, 0.0), 1.0)
            off, up = rho - tip - share * (wide - tip), z - share * cone
            square = off * off + up * up
            square = min(square, max(rho - tip, 0.0) ** 2 + z * z)
            square = min(square, (rho - wide) ** 2 + min(z - cone, 0.0) ** 2)
            out = np.sqrt(square)
    if body[3] < np.inf:
        out = min(out, _corner(rho - body[4], body[3] - z))
    return float(out)


@jit
def _corner(a: float, b: float) -> float:
    """Signed distance to a quadrant, from those to its two sides."""
    if a <= 0.0 or b <= 0.0:
        return float(max(a, b))
    return float(np.sqrt(a * a + b * b))


@jit
def approach(i: int, j: int, s: float, t: float, tips: Tips, ink: Ink, body: FloatArray) -> float:
    """g(s, t) of piece of motion i and of ink j, mm."""
    a, b, c, d = ink.start[j], ink.end[j], tips.start[i], tips.end[i]
    x = a[0] + t * (b[0] - a[0]) - c[0] - s * (d[0] - c[0])
    y = a[1] + t * (b[1] - a[1]) - c[1] - s * (d[1] - c[1])
    z = a[2] + t * (b[2] - a[2]) - c[2] - s * (d[2] - c[2])
    radius = ink.radius[j, 0] + t * (ink.radius[j, 1] - ink.radius[j, 0])
    return float(shaft_distance(x, y, z, body) - radius)


# Compute how deep ink lies inside a vessel joint, where shaft contact is allowed (compiled).
#
# A joint reaches J = sqrt(2) (R + r) + overlap from where the tip is, or from a place where two
# vessels meet (`gcode.clearance.network`): R the bare tip's radius, r the larger filament's, or
# the lumen's where a vessel is several filaments side by side.


class JointTolerance(NamedTuple):
    """Tolerances of a joint."""

    widest_mm: float = 0.025  # Reach of a place where vessels meet, to either side.
    past_mm: float = 0.002  # Rounding of a place at a vessel's end.


JOINT: Final = JointTolerance()


@jit
def _reach(i: int, j: int, role: int, tips: Tips, ink: Ink, joints: Joints) -> float:
    """J, mm: how far a joint goes."""
    radius = max(ink.radius[j, 0], ink.radius[j, 1], tips.radius[i, role])
    for vessel in (ink.vessel[j], tips.vessel[i, role]):
        if vessel >= 0:
            radius = max(radius, joints.lumen_mm[vessel])
    return float(np.sqrt(2.0) * (joints.radius_mm + radius) + joints.overlap_radii * radius)


@jit
def _mixed(pair: FloatArray, share: float) -> float:
    """A value between a piece's ends; inf stays inf."""
    if pair[0] == np.inf:
        return np.inf
    return float(pair[0] + share * (pair[1] - pair[0]))


@jit
def _past_far_end(v: int, place: float, near: float, joints: Joints) -> float:
    """How far a place lies past the end that is opposite to ``near``, mm; below 0 it doesn't.

    What lies past a vessel's end lies where another one is: it belongs to the joint there, and not
    to that at its own other end, however short the vessel is. Asked of each place, not of a row:
    one line of G-code may write a vessel and what goes on past it.
    """
    if near == 0.0:
        return float(place - joints.length_mm[v])
    return float(-place)


@jit
def _between(v: int, w: int, joints: Joints) -> tuple[int, int]:
    """Where the meetings of two vessels stand."""
    begin, end = joints.begin[v], joints.begin[v + 1]
    low = begin + np.searchsorted(joints.other[begin:end], w)
    high = low + np.searchsorted(joints.other[low:end], w + 1)
    return low, high


@jit
def slack_of(i: int, j: int, s: float, t: float, tips: Tips, ink: Ink, joints: Joints) -> float:
    """How far inside a joint, or not yet written, the ink is, mm; below 0 it isn't."""
    best, w = -np.inf, ink.vessel[j]
    if tips.run[i] >= 0 and tips.run[i] == ink.run[j]:
        behind = _mixed(tips.arc[i], s) - _mixed(ink.arc[j], t)
        if ink.when[j] == tips.when[i]:  # what the tip hasn't come to yet isn't written
            best = -behind
        if w < 0:
            best = _reach(i, j, LEFT, tips, ink, joints) - behind
    if w < 0:
        return float(best)
    place = _mixed(ink.along[j], t)
    for role in range(2):
        v = tips.vessel[i, role]
        if v < 0:
            continue
        reach = _reach(i, j, role, tips, ink, joints)
        left = reach - _mixed(tips.since[i, role], s)
        if left + JOINT.widest_mm <= best:
            continue
        at = _mixed(tips.along[i, role], s)
        if v == w:
            best = max(best, left - abs(place - at))
        low, high = _between(v, w, joints)
        most = reach + JOINT.widest_mm
        for m in range(low + np.searchsorted(joints.own[low:high], at - most), high):
            if joints.own[m] > at + most:
                break
            tip = left - abs(joints.own[m] - at) - joints.gap[m]
            here = min(tip, reach - abs(joints.there[m] - place)) + joints.wide[m]
            if joints.wide[m] == 0.0:
                past = _past_far_end(v, at, joints.own[m], joints)
                past = max(past, _past_far_end(w, place, joints.there[m], joints))
                here = min(here, JOINT.past_mm - past)
            best = max(best, here)
    return float(best)


@jit
def are_related(i: int, j: int, tips: Tips, ink: Ink, joints: Joints) -> bool:
    """Whether any rule of joints may concern this motion and this ink."""
    w = ink.vessel[j]
    if ink.when[j] == tips.when[i]:
        return True
    for role in range(2):
        v, since = tips.vessel[i, role], min(tips.since[i, role, 0], tips.since[i, role, 1])
        if since > _reach(i, j, role, tips, ink, joints) + JOINT.widest_mm:
            continue
        if w < 0 and role == LEFT and tips.run[i] >= 0 and tips.run[i] == ink.run[j]:
            return True
        if v < 0 or w < 0:
            continue
        low, high = _between(v, w, joints)
        if v == w or low < high:
            return True
    return False


@jit
def _change(pair: FloatArray) -> float:
    """How much a value changes along a piece; 0 where it isn't known at all."""
    return float(abs(pair[1] - pair[0])) if np.isfinite(pair[0]) else 0.0


@jit
def tip_slope(i: int, tips: Tips) -> float:
    """Most that `slack_of` changes along a piece of motion, mm."""
    out = _change(tips.arc[i])
    for role in range(2):
        out = max(out, _change(tips.along[i, role]) + _change(tips.since[i, role]))
    return float(out)


@jit
def ink_slope(j: int, ink: Ink) -> float:
    """Most that `slack_of` changes along a piece of ink, mm."""
    return max(_change(ink.arc[j]), _change(ink.along[j]))
