"""Measure a lumen's open circle and area at cross-sections along its vessel."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from design.network import VesselNetwork
from kernels.arrays import BoolArray, FloatArray, IntArray, split_rows
from printctl.checks.lumens.lines import WrittenLines
from printctl.checks.lumens.width_kernels import Slabs, list_cells, mark_needed, sections


@dataclass(frozen=True)
class SectionStations:
    """Sections to be measured, lumen after lumen, in the printer's frame.

    Attributes
    ----------
    lumen : (n,) int64
        Ascending.
    axis, along : (n, 3) float64
        A point of the lumen (mm), and the unit vector of its way.
    designed_mm : (n,) float64, mm
        Widest circle of the designed section.
    radius : (n,) float64, mm
        Of the circle of the designed section's area.
    window, limit : (n,) float64, mm
        How far the middle of the open section may lie from the axis, and how far is looked.
    step_mm : (n,) float64, mm
        Length of lumen that the station stands for.
    own : (n,) bool
        Whether the section is this lumen's alone; at a fork it isn't, and what is more open than
        designed there says nothing of this lumen.
    names : tuple of str
        Of each lumen.
    """

    lumen: IntArray
    axis: FloatArray
    along: FloatArray
    designed_mm: FloatArray
    radius: FloatArray
    window: FloatArray
    limit: FloatArray
    step_mm: FloatArray
    own: BoolArray
    names: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.lumen)

    @property
    def count(self) -> int:
        """Number of lumens."""
        return len(self.names)

    @property
    def first(self) -> IntArray:
        """Where each lumen's stations begin, and the end, (count + 1,)."""
        return np.searchsorted(self.lumen, np.arange(self.count + 1)).astype(np.int64)


BEYOND: Final = 1.5
"""How far is looked, in designed radii, and `BEYOND_MM` more."""
BEYOND_MM: Final = 0.1


def network_lumens(
    network: VesselNetwork, place_mm: FloatArray, layer_mm: float, line_mm: float
) -> SectionStations:
    """Stations along each vessel.

    They stand so close that no line and no layer fits between two: at most half a line's width
    and half a radius apart, and one layer's thickness in height.

    Parameters
    ----------
    network : VesselNetwork
    place_mm : (3,) float64, mm
        The part's origin in the printer's frame.
    layer_mm, line_mm : float, mm
        Thickness of a layer, width of a line.
    """
    start, end, r0, r1, vessel = network.pieces()
    way = end - start
    length = np.linalg.norm(way, axis=1)
    kept = length > 0
    start, r0, r1, vessel = start[kept], r0[kept], r1[kept], vessel[kept]
    way, length = way[kept], length[kept]
    along = way / length[:, None]
    least = np.minimum(np.minimum(r0, r1) / 2, line_mm / 2)
    steps = np.minimum(least, layer_mm / np.maximum(np.abs(along[:, 2]), 1e-9))
    count = np.ceil(length / steps).astype(np.int64)
    piece, within = split_rows(count)
    share = (within + 0.5) / count[piece]
    radius = r0[piece] + share * (r1 - r0)[piece]
    return SectionStations(
        lumen=vessel[piece],
        axis=start[piece] + share[:, None] * way[piece] + place_mm,
        along=along[piece],
        designed_mm=2 * radius,
        radius=radius,
        window=radius,
        limit=BEYOND * radius + BEYOND_MM,
        step_mm=(length / count)[piece],
        own=_own(network, vessel, length, piece, share),
        names=tuple(str(k) for k in range(network.vessel_count)),
    )


def _own(
    network: VesselNetwork,
    vessel: np.ndarray,
    length: FloatArray,
    piece: np.ndarray,
    share: FloatArray,
) -> BoolArray:
    """Stations farther from each fork than the widest of the vessels that meet there."""
    begun = np.cumsum(length) - length
    first = np.searchsorted(vessel, np.arange(network.vessel_count))
    at = (begun - begun[first][vessel])[piece] + share * length[piece]
    total = network.lengths()
    of = vessel[piece]
    ends = np.stack([network.radius[network.offset[:-1]], network.radius[network.offset[1:] - 1]])
    widest = np.zeros(len(network.nodes))
    for side in (0, 1):
        np.maximum.at(widest, network.vessel_nodes[:, side], ends[side])
    zone = np.where(network.degree() > 1, widest, 0.0)[network.vessel_nodes]
    own: BoolArray = (at >= zone[of, 0]) & (total[of] - at >= zone[of, 1])
    return own


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
