"""Interpolate pressure along vessels from their end pressures."""

from __future__ import annotations

import numpy as np

from design.geometry.polyline import arc_lengths
from design.network import VesselNetwork
from kernels.arrays import FloatArray


def point_pressure(
    network: VesselNetwork, first: FloatArray | None, last: FloatArray | None
) -> FloatArray | None:
    """Pressure at each point of the polylines from that at the vessels' ends, (p,).

    It falls evenly along a vessel of even diameter; a taper's curve is drawn straight.

    Returns
    -------
    (p,) float64 or None
        None when no vessel has both pressures.
    """
    if first is None or last is None or not np.isfinite(first + last).any():
        return None
    along = arc_lengths(network.points)
    vessel = np.repeat(np.arange(network.vessel_count), np.diff(network.offset))
    begin, end = along[network.offset[:-1]], along[network.offset[1:] - 1]
    part = (along - begin[vessel]) / (end - begin)[vessel]
    return np.asarray(first[vessel] + part * (last - first)[vessel], dtype=np.float64)
