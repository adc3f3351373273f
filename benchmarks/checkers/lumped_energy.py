"""Viscous power loss of a network, by independent integrals."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.network import FloatArray, VesselNetwork

_INTERVALS = 128


def along(network: VesselNetwork, power: int) -> FloatArray:
    """∫ r^power ds of each vessel by Simpson's rule, piece by piece, (v,)."""
    weight = np.ones(_INTERVALS + 1)
    weight[1:-1:2], weight[2:-1:2] = 4.0, 2.0
    weight /= 3.0 * _INTERVALS
    at = np.linspace(0.0, 1.0, _INTERVALS + 1)
    found = np.zeros(network.vessel_count)
    for vessel in range(network.vessel_count):
        low, high = network.offset[vessel], network.offset[vessel + 1]
        for k in range(low, high - 1):
            length = float(np.sqrt(((network.points[k + 1] - network.points[k]) ** 2).sum()))
            radius = network.radius[k] + (network.radius[k + 1] - network.radius[k]) * at
            found[vessel] += length * float(weight @ radius**power)
    return found


def resistance(network: VesselNetwork, viscosity_pa_s: float) -> FloatArray:
    """8 μ/π ∫ ds/r⁴, (v,), Pa·s/µL."""
    return 8.0 * viscosity_pa_s / np.pi * along(network, -4)


def mass(network: VesselNetwork, leaving: NDArray[Any], entering: NDArray[Any]) -> float:
    """Greatest net flow at an inner node over the flow through it.

    ``leaving`` and ``entering`` (v,) are flows at vessels' first and last ends, real or complex.
    """
    net = np.zeros(len(network.nodes), dtype=np.complex128)
    through = np.zeros(len(network.nodes))
    for column, flow, sign in ((0, leaving, 1.0), (1, entering, -1.0)):
        np.add.at(net, network.vessel_nodes[:, column], sign * flow)
        np.add.at(through, network.vessel_nodes[:, column], np.abs(flow))
    inner = network.degree() > 1
    return float((np.abs(net[inner]) / through[inner]).max())


def steady_energy(
    network: VesselNetwork, resists: FloatArray, pressure: FloatArray, flow: FloatArray
) -> float:
    """Power in at the ends less R Q² over all vessels, relative to the latter."""
    first, last = network.vessel_nodes.T
    lost = float(resists @ flow**2)
    return abs(_power(network, pressure[first], pressure[last], flow, flow) - lost) / lost


def pulsatile_energy(
    network: VesselNetwork,
    resists: FloatArray,
    compliance: FloatArray,
    waves: tuple[FloatArray, FloatArray, FloatArray],
    rate: FloatArray,
) -> float:
    """The same over a cycle, of waves at evenly spaced times.

    Parameters
    ----------
    resists, compliance : (v,)
        Half of the compliance lies at each end of a vessel.
    waves : (t, m), (t, v), (t, v)
        Pressure at nodes, flow into vessels at their first ends, and out at their last.
    rate : (t, m)
        Of pressures, Pa/s.
    """
    pressure, enters, leaves = waves
    first, last = network.vessel_nodes.T
    amid = enters - compliance / 2.0 * rate[:, first]
    lost = float((resists * amid**2).sum() / len(amid))
    given = [
        _power(network, p[first], p[last], q0, q1)
        for p, q0, q1 in zip(pressure, enters, leaves, strict=True)
    ]
    return abs(float(np.mean(given)) - lost) / lost


def _power(
    network: VesselNetwork, p0: FloatArray, p1: FloatArray, q0: FloatArray, q1: FloatArray
) -> float:
    ends = network.degree() == 1
    first, last = network.vessel_nodes.T
    return float(p0[ends[first]] @ q0[ends[first]] - p1[ends[last]] @ q1[ends[last]])
