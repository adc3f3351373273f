"""Compute dye concentration over time at points in vessels after a dye step at the inlets.

No diffusion (Taylor 1953, doi 10.1098/rspa.1953.0139), flows that mix wholly at nodes. With T the
mean transit to a place in a tube, volume over flow, a step at its entrance gives there the area
mean 1 - T/2t, and the flux mean 1 - (T/2t)², from t = T/2 on: dye leaves with the distribution
E(t) = T²/2t³ (Danckwerts 1953, doi 10.1016/0009-2509(53)80001-1). Paths are convolutions of these,
and loops sums of paths; so both are done at once as products and sums of Laplace transforms, which
over that of the step are E₂(sT/2) and 2 E₃(sT/2), with the exponential integrals
Eₙ(z) = ∫₁^∞ exp(-zx)/xⁿ dx (Abramowitz & Stegun 5.1.4). It costs the same for any number of paths,
and nothing is binned, as streamlines sorted by their flow would be.
"""

from __future__ import annotations

from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import exp1

from design.hemodynamics.dye.transit_times import STILL, CarryingFlow, downstream_order, flow_ends
from design.network import VesselNetwork
from kernels.arrays import FloatArray, IntArray

ComplexArray = NDArray[np.complex128]
Mean = Literal["area", "flux"]
"""Of a section: by area, as a camera sees it, or by flow, as a cup at the outlet collects it."""

_STEPS: Final = 1024
_DAMPED: Final = 8.0


def dye_curves(
    network: VesselNetwork,
    flow: CarryingFlow,
    vessel: IntArray,
    share: FloatArray,
    until_s: float,
    mean: Mean = "area",
) -> tuple[FloatArray, FloatArray]:
    """Mean concentration at stations after a step at the inlets at time 0.

    Parameters
    ----------
    vessel, share : (s,)
        Of each station; the share of its vessel's volume before it in the flow's direction.
    until_s : float, s
        Of the time of 1 µL/s.
    mean : "area" or "flux"

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
    for k in downstream_order(network, flow.solution).tolist():
        here = np.flatnonzero(vessel == k)
        if len(here) == 0:
            continue
        first, _ = flow_ends(network, flow.solution, k)
        second, third = _integrals(np.outer(share[here] * flow.transit_s[k] / 2.0, s))
        passed = second if mean == "area" else 2.0 * third
        back = np.fft.irfft(passed * at_nodes[first] * window, axis=1)[:, :_STEPS]
        curves[here] = back * np.exp(damping * times)
    return times, np.asarray(np.maximum.accumulate(np.clip(curves, 0.0, 1.0), axis=1))


def _nodes(network: VesselNetwork, flow: CarryingFlow, s: ComplexArray) -> ComplexArray:
    """Flux mean at each node over that of the inlets' step, (m, frequencies)."""
    into = np.zeros(len(network.nodes))
    flux = np.zeros((len(network.nodes), len(s)), dtype=np.complex128)
    entering = flow.earliest_s == 0.0
    flux[entering] = 1.0
    # Falling pressure: all that enters a node is known before anything leaves it.
    for k in downstream_order(network, flow.solution).tolist():
        first, last = flow_ends(network, flow.solution, k)
        begun = flux[first] if entering[first] else flux[first] / into[first]
        passed = 2.0 * _integrals(s * flow.transit_s[k] / 2.0)[1]
        rate = abs(float(flow.solution.flow[k]))
        flux[last] += rate * begun * passed
        into[last] += rate
    scaled = np.where(entering, 1.0, np.maximum(into, STILL))
    return np.asarray(flux / scaled[:, None])


def _integrals(z: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """E₂ and E₃ by Eₙ₊₁(z) = (exp(-z) - z Eₙ(z))/n (Abramowitz & Stegun 5.1.14)."""
    z = np.where(np.abs(z) < 1e-9, 1e-9, z)
    fall = np.exp(-z)
    second = fall - z * exp1(z)
    return second, (fall - z * second) / 2.0
