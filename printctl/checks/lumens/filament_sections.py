"""Measure the diameter and area of the lumen that washed-out filaments leave along each vessel.

A filament is taken to be sacrificial: the space that it fills is the lumen once it is washed out. A
section across the vessel cuts each filament near it in a disc; the widest circle is the widest disc
whose middle lies on the vessel, or wider where several overlap.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from kernels.arrays import FloatArray, IntArray
from printctl.checks.lumens.filaments import in_short_pieces
from printctl.checks.lumens.measure import Openings
from printctl.checks.lumens.stations import SectionStations
from sim.gcode.deposit.strands import Strands

RAYS: Final = 32
STATIONS_AT_ONCE: Final = 20_000
PASSES: Final = 6
"""Discs that a ray may go through one after another."""
TOUCH_MM: Final = 1e-6


def measure_filaments(strands: Strands, stations: SectionStations) -> Openings:
    """Widest circle and written area of each station's section; 0 where nothing is written.

    Parameters
    ----------
    strands : Strands
    stations : SectionStations
        Of the designed vessels, in the printer's frame.
    """
    pieces = in_short_pieces(strands)
    middle = (pieces.start + pieces.end) / 2
    half = np.linalg.norm(pieces.end - pieces.start, axis=1) / 2
    reach = float((half + pieces.radius).max()) if len(pieces) else 0.0
    tree = cKDTree(middle) if len(pieces) else None
    diameter, area = np.zeros(len(stations)), np.zeros(len(stations))
    centre = stations.axis.copy()
    for rows in _chunks(len(stations)):
        if tree is None:
            break
        near = tree.query_ball_point(stations.axis[rows], reach + stations.limit[rows])
        count = np.array([len(some) for some in near])
        piece = np.concatenate([np.asarray(some, np.int64) for some in near])
        of = np.repeat(np.arange(len(rows)), count)
        discs = _discs(pieces, piece, stations, rows[of])
        diameter[rows], area[rows], centre[rows] = _widest(*discs, of, stations, rows)
    return Openings(diameter, centre, area)


def _chunks(count: int) -> Iterator[IntArray]:
    for first in range(0, count, STATIONS_AT_ONCE):
        yield np.arange(first, min(first + STATIONS_AT_ONCE, count))


def _discs(
    pieces: Strands, piece: IntArray, stations: SectionStations, row: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Disc in which each piece cuts its station's plane: middle (m, 3) from the axis, radius.

    Of the balls that make up the piece, the one where it passes the plane, or comes nearest to it.
    A piece along the plane is cut where it is nearest to the axis.
    """
    along = stations.along[row]
    begin = pieces.start[piece] - stations.axis[row]
    way = pieces.end[piece] - pieces.start[piece]
    off, rise = (begin * along).sum(axis=1), (way * along).sum(axis=1)
    flat = np.abs(rise) < TOUCH_MM
    square = np.maximum((way * way).sum(axis=1), TOUCH_MM**2)
    share = np.where(flat, -(begin * way).sum(axis=1) / square, -off / np.where(flat, 1.0, rise))
    share = np.clip(share, 0.0, 1.0)
    away = off + share * rise
    middle = begin + share[:, None] * way - away[:, None] * along
    return middle, np.sqrt(np.maximum(pieces.radius[piece] ** 2 - away**2, 0.0))


def _widest(
    middle: FloatArray,
    radius: FloatArray,
    of: IntArray,
    stations: SectionStations,
    rows: IntArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Diameter, area and centre of each station's open space."""
    offset = np.linalg.norm(middle, axis=1)
    on_axis = (radius > 0) & (offset <= stations.window[rows[of]])
    size = np.where(on_axis, radius, 0.0)
    best = np.lexsort((-offset, size, of))
    last = np.searchsorted(of[best], np.arange(len(rows)), side="right") - 1
    chosen = best[np.maximum(last, 0)] if len(best) else np.zeros(len(rows), np.int64)
    there = np.zeros(len(rows), bool)
    if len(best):
        there = (last >= 0) & (of[chosen] == np.arange(len(rows))) & on_axis[chosen]
    if not there.any():
        return np.zeros(len(rows)), np.zeros(len(rows)), stations.axis[rows]
    core = np.where(there[:, None], middle[chosen], 0.0)
    first = np.where(there, radius[chosen], 0.0)
    reach = _reaches(middle, radius, of, core, first, stations, rows)
    wide = np.where(there, 2 * np.maximum(first, reach.min(axis=1)), 0.0)
    area = np.where(there, np.pi * (reach**2).mean(axis=1), 0.0)
    return wide, area, stations.axis[rows] + core


def _reaches(
    middle: FloatArray,
    radius: FloatArray,
    of: IntArray,
    core: FloatArray,
    first: FloatArray,
    stations: SectionStations,
    rows: IntArray,
) -> FloatArray:
    """How far each ray from the core goes through overlapping discs, (k, RAYS), mm."""
    reach = np.repeat(first[:, None], RAYS, axis=1)
    others = np.flatnonzero((radius > 0) & ((middle != core[of]).any(axis=1)))
    if not len(others):
        return reach
    across, up = _axes(stations.along[rows])
    angle = 2 * np.pi * np.arange(RAYS) / RAYS
    who = of[others]
    gap = middle[others] - core[who]
    x, y = (gap * across[who]).sum(axis=1), (gap * up[who]).sum(axis=1)
    ahead = np.outer(x, np.cos(angle)) + np.outer(y, np.sin(angle))
    half = radius[others, None] ** 2 - (x**2 + y**2)[:, None] + ahead**2
    chord = np.sqrt(np.maximum(half, 0.0))
    enters, leaves = np.where(half > 0, ahead - chord, np.inf), ahead + chord
    most = stations.limit[rows]
    for _ in range(PASSES):
        before = reach.copy()
        goes_on = (enters <= reach[who] + TOUCH_MM) & (leaves > reach[who])
        np.maximum.at(reach, who, np.where(goes_on, leaves, 0.0))
        if np.array_equal(reach, before):
            break
    # An open neighbour's length isn't this vessel's width.
    capped: FloatArray = np.minimum(reach, np.maximum(most, first)[:, None])
    return capped


def _axes(along: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors across each way (k, 3)."""
    helper: NDArray[np.float64] = np.where(np.abs(along[:, 2:]) < 0.9, [0.0, 0.0, 1.0], [1.0, 0, 0])
    across = np.cross(along, helper)
    across /= np.linalg.norm(across, axis=1)[:, None]
    return across, np.cross(along, across)
