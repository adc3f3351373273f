"""A network cut into short straight elements: what the planner orders and the needle writes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from design.network import VesselNetwork
from design.toolpath.toolpath import FloatArray, IntArray

TAPER_STEP = 0.05
"""An element's radii differ by at most about this part."""
STRAIGHT_MM = 0.002
"""Points of a polyline that stand off a straight line by less are left out."""


class Elements(NamedTuple):
    """Short pieces of vessels, those of a vessel together and in its order.

    Attributes
    ----------
    point : (p, 3) float64, mm
        Where elements end; the network's nodes come first.
    end : (n, 2) int64
        The points at which each begins and ends.
    radius : (n, 2) float64, mm
        There.
    length : (n,) float64, mm
    arc : (n,) float64, mm
        Way along the vessel to where each begins.
    vessel : (n,) int64
    first : (v + 1,) int64
        Vessel ``v`` has the elements ``first[v]`` to ``first[v + 1] - 1``.
    """

    point: FloatArray
    end: IntArray
    radius: FloatArray
    length: FloatArray
    arc: FloatArray
    vessel: IntArray
    first: IntArray


def elements_of(network: VesselNetwork, longest_mm: float) -> Elements:
    """Cut every vessel into elements no longer than `longest_mm`, and straight within 2 µm."""
    points, radii, ends, first = [network.nodes], [], [], [0]
    count = len(network.nodes)
    for (tail, head), (line, radius) in zip(
        network.vessel_nodes.tolist(), network.polylines(), strict=True
    ):
        line, radius = subdivided(
            *straightened(*_without_repeats(line, radius)), longest_mm, TAPER_STEP
        )
        inner = np.arange(count, count + len(line) - 2)
        number = np.concatenate([[tail], inner, [head]])
        count += len(inner)
        points.append(line[1:-1])
        radii.append(np.column_stack([radius[:-1], radius[1:]]))
        ends.append(np.column_stack([number[:-1], number[1:]]))
        first.append(first[-1] + len(line) - 1)
    point, end = np.concatenate(points), np.concatenate(ends).astype(np.int64)
    offset = np.array(first, dtype=np.int64)
    length = np.linalg.norm(point[end[:, 1]] - point[end[:, 0]], axis=1)
    vessel = np.repeat(np.arange(len(first) - 1), np.diff(offset))
    along = np.cumsum(length) - length
    arc = along - along[offset[:-1]][vessel]
    return Elements(point, end, np.concatenate(radii), length, arc, vessel, offset)


def _without_repeats(line: FloatArray, radius: FloatArray) -> tuple[FloatArray, FloatArray]:
    moves = np.linalg.norm(np.diff(line, axis=0), axis=1) > 1e-9
    keep = np.concatenate([[True], moves])
    if keep.sum() == 1:
        keep[-1] = True
    return line[keep], radius[keep]


def straightened(line: FloatArray, radius: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Leave out points near the chord of those kept (Douglas & Peucker 1973), radii included."""
    keep = np.zeros(len(line), dtype=np.bool_)
    keep[[0, -1]] = True
    values = np.column_stack([line, radius])
    stack = [(0, len(line) - 1)]
    while stack:
        low, high = stack.pop()
        if high - low < 2:
            continue
        chord = values[high] - values[low]
        inner = values[low + 1 : high] - values[low]
        share = np.clip(inner[:, :3] @ chord[:3] / max(chord[:3] @ chord[:3], 1e-18), 0.0, 1.0)
        away = np.linalg.norm(inner - share[:, None] * chord, axis=1)
        if away.max() > STRAIGHT_MM:
            middle = low + 1 + int(away.argmax())
            keep[middle] = True
            stack += [(low, middle), (middle, high)]
    return line[keep], radius[keep]


def subdivided(
    line: FloatArray, radius: FloatArray, longest_mm: float, taper_step: float
) -> tuple[FloatArray, FloatArray]:
    """Insert points where a stretch is long, or its radius changes much."""
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    taper = np.abs(np.diff(np.log(radius))) / taper_step
    count = np.ceil(np.maximum(steps / longest_mm, taper)).astype(int).clip(min=1)
    place = np.concatenate([k + np.arange(n) / n for k, n in enumerate(count)])
    place = np.append(place, len(line) - 1)
    whole = np.arange(len(line))
    finer = np.column_stack([np.interp(place, whole, line[:, axis]) for axis in range(3)])
    return finer, np.interp(place, whole, radius)
