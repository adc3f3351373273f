"""Divide a network into short straight elements, the units that embedded planning orders."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from design.geometry.polyline import arc_lengths, places_along
from design.network import VesselNetwork
from kernels import jit
from kernels.arrays import BoolArray, FloatArray, IntArray


class _Cutting(NamedTuple):
    """How vessels are cut into elements."""

    taper_step: float = 0.05  # part by which an element's radii differ at most, about
    straight_mm: float = 0.002  # points that stand off a straight line by less are left out
    fine_elements: int = 20_000  # of half the tip's radius; a larger network's are longer
    squares: int = 4_000_000  # of a plan in which they are looked up, at most


CUTTING: Final = _Cutting()


class Elements(NamedTuple):
    """Short pieces of vessels, those of a vessel together and in its order."""

    point: FloatArray  # (p, 3), mm, where elements end; the network's nodes come first
    end: IntArray  # (n, 2), the points at which each begins and ends
    radius: FloatArray  # (n, 2), mm, at both ends
    length: FloatArray  # (n,), mm
    arc: FloatArray  # (n,), mm, way along the vessel's elements to where each begins
    # (n, 2), mm, way along the vessel itself to both ends: a curve is longer than its chords.
    along: FloatArray
    vessel: IntArray  # (n,)
    first: IntArray  # (v + 1,), vessel ``v`` has the elements ``first[v]`` to ``first[v + 1] - 1``


def longest_mm(network: VesselNetwork, tip_mm: float) -> float:
    """Of an element: half the radius that is kept free at the tip, or all of it of a large network.

    Then five places along an element tell of all of it (`rules.TIPS`). Shorter ones leave more
    places for a cut, longer ones a quarter of the pairs to be looked at.
    """
    half = tip_mm / 2
    return half if float(network.lengths().sum()) <= CUTTING.fine_elements * half else tip_mm


def elements_of(network: VesselNetwork, longest_mm: float) -> Elements:
    """Cut every vessel into elements no longer than `longest_mm`, and straight within 2 µm."""
    points, radii, ends, ways, first = [network.nodes], [], [], [], [0]
    count = len(network.nodes)
    for (tail, head), (line, radius) in zip(
        network.vessel_nodes.tolist(), network.polylines(), strict=True
    ):
        line, radius = _without_repeats(line, radius)
        way = arc_lengths(line)
        keep = off_chords(np.column_stack([line, radius]))
        line, radius, way = line[keep], radius[keep], way[keep]
        place = finer_places(line, radius, longest_mm, CUTTING.taper_step)
        values = np.column_stack([line, radius, way])
        values = places_along(values, np.arange(len(line), dtype=np.float64), place)
        line, radius, way = values[:, :3], values[:, 3], values[:, 4]
        inner = np.arange(count, count + len(line) - 2)
        number = np.concatenate([[tail], inner, [head]])
        count += len(inner)
        points.append(line[1:-1])
        radii.append(np.column_stack([radius[:-1], radius[1:]]))
        ways.append(np.column_stack([way[:-1], way[1:]]))
        ends.append(np.column_stack([number[:-1], number[1:]]))
        first.append(first[-1] + len(line) - 1)
    point, end = np.concatenate(points), np.concatenate(ends).astype(np.int64)
    offset = np.array(first, dtype=np.int64)
    length = np.linalg.norm(point[end[:, 1]] - point[end[:, 0]], axis=1)
    vessel = np.repeat(np.arange(len(first) - 1), np.diff(offset))
    along = np.cumsum(length) - length
    arc = along - along[offset[:-1]][vessel]
    radius, way = np.concatenate(radii), np.concatenate(ways)
    return Elements(point, end, radius, length, arc, way, vessel, offset)


def _without_repeats(line: FloatArray, radius: FloatArray) -> tuple[FloatArray, FloatArray]:
    moves = np.linalg.norm(np.diff(line, axis=0), axis=1) > 1e-9
    keep = np.concatenate([[True], moves])
    if keep.sum() == 1:
        keep[-1] = True
    return line[keep], radius[keep]


@jit
def off_chords(values: FloatArray) -> BoolArray:
    """Which of (n, 4) points and radii stand off the chords of those kept, (n,).

    Douglas and Peucker (1973), Cartographica 10, 112.
    """
    keep = np.zeros(len(values), dtype=np.bool_)
    keep[0] = keep[-1] = True
    stack = [(0, len(values) - 1)]
    while stack:
        low, high = stack.pop()
        most, farthest = CUTTING.straight_mm, -1
        for k in range(low + 1, high):
            away = _from_chord(values[k], values[low], values[high])
            if away > most:
                most, farthest = away, k
        if farthest > 0:
            keep[farthest] = True
            stack.append((low, farthest))
            stack.append((farthest, high))
    return keep


@jit
def _from_chord(value: FloatArray, low: FloatArray, high: FloatArray) -> float:
    """How far a place (and its radius) is from a chord."""
    along, length2 = 0.0, 0.0
    for axis in range(3):
        along += (value[axis] - low[axis]) * (high[axis] - low[axis])
        length2 += (high[axis] - low[axis]) ** 2
    share = min(max(along / max(length2, 1e-18), 0.0), 1.0)
    away2 = 0.0
    for axis in range(4):
        away2 += (value[axis] - low[axis] - share * (high[axis] - low[axis])) ** 2
    return float(np.sqrt(away2))


def finer_places(
    line: FloatArray, radius: FloatArray, longest_mm: float, taper_step: float
) -> FloatArray:
    """Places along a polyline, counted in its points: more where it is long or tapers much."""
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    taper = np.abs(np.diff(np.log(radius))) / taper_step
    count = np.ceil(np.maximum(steps / longest_mm, taper)).astype(int).clip(min=1)
    place = np.concatenate([k + np.arange(n) / n for k, n in enumerate(count)])
    return np.append(place, len(line) - 1)


def nearest_along(elements: Elements, vessel: int, place: FloatArray) -> float:
    """Way along a vessel to what is nearest to a place (3,) on its axis, mm.

    Past an end it counts on: below 0, or above the vessel's length.
    """
    own = slice(int(elements.first[vessel]), int(elements.first[vessel + 1]))
    begin, end = (elements.point[elements.end[own, side]] for side in (0, 1))
    step = end - begin
    square = np.maximum((step**2).sum(axis=1), 1e-300)
    straight = ((place - begin) * step).sum(axis=1) / square
    share = np.clip(straight, 0.0, 1.0)
    best = int(np.argmin(np.linalg.norm(begin + share[:, None] * step - place, axis=1)))
    if (best == 0 and share[0] == 0.0) or (best == len(share) - 1 and share[best] == 1.0):
        share[best] = straight[best]
    low, high = elements.along[own][best]
    return float(low + share[best] * (high - low))


class Squares(NamedTuple):
    """Stretches by squares of the plan, those of square s in ``member[begin[s]:begin[s + 1]]``.

    What lies within the pitch of a place is found in the nine squares about it.
    """

    origin: FloatArray
    pitch: float
    shape: IntArray
    begin: IntArray
    member: IntArray
    # Of each member x and y of its middle, its top, how far its ink reaches from the middle, mm:
    # in the members' order, so that a search runs along memory.
    around: FloatArray  # (n, 4)


def squares_of(elements: Elements, shaft_mm: float) -> Squares:
    """Sort elements for searches within a shaft of each other."""
    start, end = elements.point[elements.end[:, 0]], elements.point[elements.end[:, 1]]
    widest = float(elements.radius.max())
    return sort_stretches(start, end, elements.radius, max(shaft_mm, widest))


def sort_stretches(
    start: FloatArray, end: FloatArray, radius: FloatArray, room_mm: float
) -> Squares:
    """Sort stretches by their middles, for searches within ``room_mm`` of their surfaces.

    Parameters
    ----------
    start, end : (n, 3) float64, mm
    radius : (n, 2) float64, mm
        At both ends.
    room_mm : float, mm
    """
    middle = ((start + end) / 2)[:, :2]
    origin, size = middle.min(axis=0), np.ptp(middle, axis=0)
    thick, length = radius.max(axis=1), np.linalg.norm(end - start, axis=1)
    reach = room_mm + float(thick.max()) + float(length.max())
    pitch = max(reach, float(np.sqrt(size.prod() / CUTTING.squares)))
    place = np.floor((middle - origin) / pitch).astype(np.int64)
    shape = place.max(axis=0) + 1
    square = place[:, 0] * shape[1] + place[:, 1]
    begin = np.concatenate([[0], np.cumsum(np.bincount(square, minlength=int(shape.prod())))])
    member = np.argsort(square, kind="stable")
    top = np.maximum(start[:, 2], end[:, 2]) + thick
    around = np.column_stack([middle, top, thick + length / 2])
    return Squares(origin, pitch, shape, begin, member, np.ascontiguousarray(around[member]))


@jit
def near(squares: Squares, place: FloatArray, k: int) -> tuple[int, int]:
    """Range of `Squares.member` in the ``k``-th (0..2) of three rows of squares about a place."""
    x = int(np.floor((place[0] - squares.origin[0]) / squares.pitch)) - 1 + k
    y = int(np.floor((place[1] - squares.origin[1]) / squares.pitch))
    low, high = max(0, y - 1), min(squares.shape[1], y + 2)
    if x < 0 or x >= squares.shape[0] or low >= high:
        return 0, 0
    return squares.begin[x * squares.shape[1] + low], squares.begin[x * squares.shape[1] + high]
