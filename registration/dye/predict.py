"""Dye at the stations by the 0D solution: how a step at the inlets is carried along the vessels.

Poiseuille's profile, no diffusion (Taylor 1953, doi 10.1098/rspa.1953.0139), flows that mix wholly
at nodes. With T the mean transit to a place in a tube, volume over flow, a step at its entrance
gives there the area mean 1 - T/2t, and the flux mean 1 - (T/2t)², from t = T/2 on. Their Laplace
transforms over that of the step are E₂(sT/2) and 2 E₃(sT/2), with the exponential integrals
Eₙ(z) = ∫₁^∞ exp(-zx)/xⁿ dx (Abramowitz & Stegun 5.1.4).
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import exp1

from design.hemodynamics import FlowConditions, FlowSolution, solve_flow
from design.network import VesselNetwork
from registration.dye.beside import Nodes, left_open, solve_beside
from registration.dye.marks import FloatArray

ComplexArray = NDArray[np.complex128]
_STEPS, _DAMPED, _WATER, _STILL = 1024, 8.0, 1e-3, 1e-9


@dataclass(frozen=True)
class Carried:
    """The steady flow that carries dye, at 1 µL/s into the network.

    Attributes
    ----------
    solution : FlowSolution
    volume : (v,) float64, µL
    transit_s : (v,) float64, s
        Volume over flow; inf where nothing flows.
    earliest_s : (m,) float64, s
        Least sum of mean transits from an inlet to each node; inf where none leads.
    """

    solution: FlowSolution
    volume: FloatArray
    transit_s: FloatArray
    earliest_s: FloatArray

    def moves(self) -> NDArray[np.bool_]:
        """Vessels that carry flow by design, (v,)."""
        return np.isfinite(self.transit_s)


def carried(network: VesselNetwork, inlet: int | None) -> Carried:
    """Solve the flow of 1 µL/s.

    Raises
    ------
    FlowError
        When the network has no such flow.
    """
    inlets, outlets = _ends(network, inlet)
    conditions = FlowConditions(_WATER, inlet_flow_ul_s=1.0, inlets=inlets, outlets=outlets)
    return _carried_by(network, solve_flow(network, conditions), inlets)


def carried_beside(
    network: VesselNetwork, inlet: int | None, closed: Collection[int]
) -> Carried | None:
    """Solve the flow of 1 µL/s without the vessels that are closed.

    They are taken out whole: a closure that leaks isn't told from one that doesn't.

    Returns
    -------
    Carried or None
        Of the whole network, at rest in the closed vessels and in what they cut off; None where
        nothing is left that leads from an inlet to an outlet.
    """
    inlets, outlets = _ends(network, inlet)
    left = left_open(network, inlets, outlets, closed)
    if not left.any():
        return None
    return _carried_by(network, solve_beside(network, _WATER, inlets, outlets, left), inlets)


def _carried_by(network: VesselNetwork, solution: FlowSolution, inlets: Nodes) -> Carried:
    start, end, a, b, vessel = network.pieces()
    frustum = np.pi / 3.0 * np.linalg.norm(end - start, axis=1) * (a * a + a * b + b * b)
    volume: FloatArray = np.asarray(
        np.bincount(vessel, weights=frustum, minlength=network.vessel_count), dtype=np.float64
    )
    flow = np.abs(solution.flow)
    transit = np.where(flow > _STILL, volume / np.maximum(flow, _STILL), np.inf)
    earliest: FloatArray = np.full(len(network.nodes), np.inf)
    earliest[list(inlets)] = 0.0
    for k in downstream(network, solution):
        first, last = ends_along(network, solution, int(k))
        earliest[last] = min(earliest[last], earliest[first] + transit[k])
    return Carried(solution, volume, transit, earliest)


def _ends(network: VesselNetwork, inlet: int | None) -> tuple[Nodes, Nodes]:
    """Nodes that dye enters and leaves by."""
    if inlet is None:
        return tuple(network.inlets().tolist()), tuple(network.outlets().tolist())
    return (inlet,), _opposite(network, inlet)


def _opposite(network: VesselNetwork, inlet: int) -> Nodes:
    """Open ends that dye let in at ``inlet`` leaves by; from a designed outlet, by all others."""
    starts, ends = network.inlets().tolist(), network.outlets().tolist()
    return tuple(node for node in (*starts, *ends) if node != inlet) if inlet in ends else (*ends,)


def downstream(network: VesselNetwork, solution: FlowSolution) -> NDArray[np.int64]:
    """Vessels that flow, by falling pressure at their beginning."""
    begins = solution.pressure[network.vessel_nodes].max(axis=1)
    order = np.argsort(-begins, kind="stable")
    return np.asarray(order[np.abs(solution.flow[order]) > _STILL])


def ends_along(network: VesselNetwork, solution: FlowSolution, vessel: int) -> tuple[int, int]:
    """Nodes a vessel's flow runs from and to."""
    first, last = network.vessel_nodes[vessel].tolist()
    return (first, last) if solution.flow[vessel] >= 0.0 else (last, first)


def dye_curves(
    network: VesselNetwork,
    flow: Carried,
    vessel: NDArray[np.int64],
    share: FloatArray,
    until_s: float,
) -> tuple[FloatArray, FloatArray]:
    """Mean concentration at stations after a step at the inlets at time 0.

    Parameters
    ----------
    vessel, share : (s,)
        Of each station; the share of its vessel's volume before it in the flow's direction.
    until_s : float, s
        Of the time of 1 µL/s.

    Returns
    -------
    (n,) float64, s, and (s, n) float64
        Times and concentrations, 0 to 1, that never fall.
    """
    # Inverse transform on twice the span, damped so that what wraps around has died away.
    step = until_s / _STEPS
    times: FloatArray = step * np.arange(_STEPS, dtype=np.float64)
    damping = _DAMPED / (2.0 * until_s)
    s = np.asarray(damping + 2j * np.pi * np.fft.rfftfreq(2 * _STEPS, step), dtype=np.complex128)
    # Lanczos' factors keep the ends of the spectrum from ringing.
    window = np.sinc(np.arange(len(s)) / len(s)) / (s * step)
    at_nodes = _nodes(network, flow, s)
    curves: FloatArray = np.zeros((len(vessel), _STEPS))
    for k in downstream(network, flow.solution).tolist():
        here = np.flatnonzero(vessel == k)
        if len(here) == 0:
            continue
        first, _ = ends_along(network, flow.solution, k)
        passed = _integrals(np.outer(share[here] * flow.transit_s[k] / 2.0, s))[0]
        back = np.fft.irfft(passed * at_nodes[first] * window, axis=1)[:, :_STEPS]
        curves[here] = back * np.exp(damping * times)
    return times, np.asarray(np.maximum.accumulate(np.clip(curves, 0.0, 1.0), axis=1))


def _nodes(network: VesselNetwork, flow: Carried, s: ComplexArray) -> ComplexArray:
    """Flux mean at each node over that of the inlets' step, (m, frequencies)."""
    into = np.zeros(len(network.nodes))
    found = np.zeros((len(network.nodes), len(s)), dtype=np.complex128)
    entering = flow.earliest_s == 0.0
    found[entering] = 1.0
    # Falling pressure: all that enters a node is known before anything leaves it.
    for k in downstream(network, flow.solution).tolist():
        first, last = ends_along(network, flow.solution, k)
        begun = found[first] if entering[first] else found[first] / into[first]
        passed = 2.0 * _integrals(s * flow.transit_s[k] / 2.0)[1]
        rate = abs(float(flow.solution.flow[k]))
        found[last] += rate * begun * passed
        into[last] += rate
    scaled = np.where(entering, 1.0, np.maximum(into, _STILL))
    return np.asarray(found / scaled[:, None])


def _integrals(z: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """E₂ and E₃ by Eₙ₊₁(z) = (exp(-z) - z Eₙ(z))/n (Abramowitz & Stegun 5.1.14)."""
    z = np.where(np.abs(z) < 1e-9, 1e-9, z)
    fall = np.exp(-z)
    second = fall - z * exp1(z)
    return second, (fall - z * second) / 2.0
