"""Measure a lumen's widest open circle and open area at cross-sections between printed lines."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from kernels.arrays import FloatArray, IntArray
from printctl.checks.lumens.lines import WrittenLines
from printctl.checks.lumens.stations import SectionStations
from sim.gcode.lumens.ray_kernels import Slabs, list_cells, mark_needed
from sim.gcode.lumens.width_kernels import sections

CELL_MM: Final = 0.25
MOST_CELLS: Final = 60_000_000
RAY_SPACING_MM: Final = 0.025
"""Where rays meet the wall; a line's round end is several times as wide."""
LEAST_RAYS: Final = 96
MOST_RAYS: Final = 480
STEEP: Final = 0.5
"""Least rise of a vessel whose stations are moved to the middle of the layers."""


@dataclass(frozen=True)
class Openings:
    """What is open at each station.

    Attributes
    ----------
    diameter : (n,) float64, mm
        Of the widest circle in the plane across the lumen; 0 where ink covers it.
    centre : (n, 3) float64, mm
        Its centre.
    area : (n,) float64, mm²
        Open, as seen from there.
    """

    diameter: FloatArray
    centre: FloatArray
    area: FloatArray


def measure(lines: WrittenLines, stations: SectionStations) -> Openings:
    """Widest circle and open area of each station's section."""
    stations = _at_crests(stations, lines)
    slabs = slabs_near(lines, stations)
    diameter, centre, area = sections(
        slabs,
        stations.axis,
        stations.along,
        stations.radius,
        stations.window,
        stations.limit,
        _rays(stations),
    )
    return Openings(diameter, centre, area)


def _at_crests(stations: SectionStations, lines: WrittenLines) -> SectionStations:
    """Stations of steep vessels, moved along them to the middle of their layer.

    There lines are widest. Between two crests a level section would look into the notch of their
    round sides, which carries no flow.
    """
    height, rise = stations.axis[:, 2], stations.along[:, 2]
    layer = np.clip(np.searchsorted(lines.high, height), 0, len(lines.high) - 1)
    inside = (height >= lines.low[layer]) & (height <= lines.high[layer])
    moved = inside & (np.abs(rise) > STEEP)
    up = (lines.low + lines.high)[layer] / 2 - height
    way = np.where(moved, up / np.where(moved, rise, 1.0), 0.0)
    return replace(stations, axis=stations.axis + way[:, None] * stations.along)


def _rays(stations: SectionStations) -> IntArray:
    wanted = np.ceil(2 * np.pi * stations.radius / RAY_SPACING_MM)
    return np.clip(wanted, LEAST_RAYS, MOST_RAYS).astype(np.int64)


def _flanks(lines: WrittenLines) -> tuple[FloatArray, FloatArray]:
    """Depth and half height of each line's sides, half ellipses that leave its mean width, mm.

    A half ellipse fills π/4 of the box round it. Of round sides it is a half circle, of an ellipse
    all of it, of a rectangle nothing; a line that can't hold its sides so deep isn't as high as
    its layer.
    """
    thick = (lines.high - lines.low)[lines.layer]
    deep = np.minimum((lines.width - lines.mean) / (2 * (1 - np.pi / 4)), lines.width / 2)
    whole = deep >= lines.width / 2
    share = np.where(whole, lines.mean / (np.pi / 4 * np.maximum(lines.width, 1e-12)), 1.0)
    return deep, np.minimum(share, 1.0) * thick / 2


def slabs_near(lines: WrittenLines, stations: SectionStations) -> Slabs:
    """Sort the lines near the lumens into cells."""
    reach = (stations.limit + stations.window)[:, None] * np.sqrt(
        np.clip(1.0 - stations.along**2, 0.0, 1.0)
    )
    low = (stations.axis - reach).min(axis=0)[:2]
    high = (stations.axis + reach).max(axis=0)[:2]
    layers = len(lines.low)
    area = float(np.prod(high - low))
    cell = max(CELL_MM, float(np.median(lines.width)), (area * layers / MOST_CELLS) ** 0.5)
    nx, ny = (int(n) + 1 for n in np.ceil((high - low) / cell))
    needed = np.zeros((layers, ny, nx), dtype=np.bool_)
    corner = (float(low[0]), float(low[1]), cell)
    mark_needed(stations.axis, reach, lines.low, lines.high, *corner, needed)
    line = np.column_stack([lines.start, lines.end, lines.width / 2, *_flanks(lines)])
    first = np.zeros(needed.size + 1, dtype=np.int64)
    nothing = np.empty(0, dtype=np.int32)
    list_cells(line, lines.layer, needed, *corner, first, nothing, False)
    np.cumsum(first, out=first)
    item = np.empty(int(first[-1]), dtype=np.int32)
    cursor = first.copy()
    list_cells(line, lines.layer, needed, *corner, cursor, item, True)
    return Slabs(lines.low, lines.high, line, first, item, *corner, nx, ny)
