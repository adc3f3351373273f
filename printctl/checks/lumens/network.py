"""Place measuring sections along a network's vessels, for the lumen check."""

from __future__ import annotations

from typing import Final

import numpy as np

from design.network import VesselNetwork
from kernels.arrays import BoolArray, FloatArray
from printctl.checks.lumens.stations import SectionStations

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
    piece = np.repeat(np.arange(len(count)), count)
    within = np.arange(len(piece)) - np.repeat(np.cumsum(count) - count, count)
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
