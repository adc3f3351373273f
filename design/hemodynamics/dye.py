"""Predict dye arrival times and concentrations in a network; check a video's frame interval.

Goes in: a network and its steady flow. Comes out: arrival times and concentration curves.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import exp1

from design.hemodynamics.vessel_coefficients import integral_of_power
from design.hemodynamics.zero_d.steady import FlowSolution
from design.network import VesselNetwork
from kernels.arrays import FloatArray, IntArray

DYE_DIFFUSIVITY: Final = 4e-4
"""mm²/s; fluorescein in water at 25 °C has 4.25e-4 (Culbertson et al. 2002,
doi 10.1016/S0039-9140(01)00602-6)."""


class DyeLimits(NamedTuple):
    """Where a vessel counts as still, dispersed or filmed too slowly."""

    still_ul_s: float = 1e-9
    """Of 1 µL/s into the network: nothing flows below it."""
    carried_below: float = 0.01
    """Transit times D/r², below which dye is carried as if it didn't diffuse."""
    dispersed_above: float = 0.8
    """Transit times D/r², above which the section is even and the front is Taylor's, a bell that
    runs with the mean (Ananthakrishnan, Gill & Barduhn 1965, AIChE J 11, 1063, for Péclet numbers
    above some hundreds)."""
    frames_in_vessel: float = 2.0
    """While the tip runs through a vessel, so that arrivals at its two ends differ."""
    frames_in_all: float = 10.0
    """While the tip runs from the inlet to where it leaves last."""


class CurveSampling(NamedTuple):
    """How `dye_curves` are inverted and read."""

    steps: int = 1024
    """In time."""
    damping: float = 8.0
    """What wraps around on twice the span is damped by exp(-8)."""
    mean_ages: float = 4.0
    """Length of a curve for its half: one tube's is at 7/8 by then."""


LIMITS: Final = DyeLimits()
SAMPLING: Final = CurveSampling()


@dataclass(frozen=True)
class CarryingFlow:
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

    @property
    def entering(self) -> NDArray[np.bool_]:
        """Whether each node is an inlet of dye, (m,)."""
        return self.earliest_s == 0.0

    def moves(self) -> NDArray[np.bool_]:
        """Vessels that carry flow, (v,)."""
        return np.isfinite(self.transit_s)


def steady_transit(
    network: VesselNetwork, solution: FlowSolution, inlets: tuple[int, ...]
) -> CarryingFlow:
    """Return transits of a flow of 1 µL/s that dye enters at ``inlets``."""
    volume = np.pi * integral_of_power(network, 2)
    flow, still = np.abs(solution.flow), LIMITS.still_ul_s
    transit = np.where(flow > still, volume / np.maximum(flow, still), np.inf)
    earliest: FloatArray = np.full(len(network.nodes), np.inf)
    earliest[list(inlets)] = 0.0
    for k, first, last in _downstream(network, solution):
        earliest[last] = min(earliest[last], earliest[first] + transit[k])
    return CarryingFlow(solution, volume, transit, earliest)


def downstream_order(network: VesselNetwork, solution: FlowSolution) -> IntArray:
    """Return vessels that flow, by falling pressure at their beginning."""
    begins = solution.pressure[network.vessel_nodes].max(axis=1)
    order = np.argsort(-begins, kind="stable")
    return np.asarray(order[np.abs(solution.flow[order]) > LIMITS.still_ul_s])


def flow_ends(network: VesselNetwork, solution: FlowSolution, vessel: int) -> tuple[int, int]:
    """Return the nodes that a vessel's flow runs from and to."""
    first, last = network.vessel_nodes[vessel].tolist()
    return (first, last) if solution.flow[vessel] >= 0.0 else (last, first)


def _downstream(network: VesselNetwork, solution: FlowSolution) -> Iterator[tuple[int, int, int]]:
    """Vessels that flow and their ends; all that enters a node comes before what leaves it."""
    for k in downstream_order(network, solution).tolist():
        yield k, *flow_ends(network, solution, k)


@dataclass(frozen=True)
class DyeFront:
    """Arrival of a step of dye at each vessel; times from the inlets, s.

    All arrays (v,); NaN where nothing flows or dye doesn't lead.

    The tip runs on the axis at twice the mean speed, so that it is through a vessel in T/2; the
    mean takes T. Both add up along a way, since flows mix at nodes and some of what comes goes on
    along the axis.

    Attributes
    ----------
    flow_ul_s : float
        Into the network.
    tip_enters_s, tip_leaves_s : float64
        Of the first dye, on the axis of the fastest way.
    mean_enters_s, mean_leaves_s : float64
        Of the mean over all that flows there: the age of the fluid.
    half_leaves_s : float64
        When the section's mean at the vessel's end reaches one half.
    transit_s : float64
        Mean, of the vessel alone.
    peclet : float64
        d U/D of the vessel.
    fourier : float64
        T D/r²: how far diffusion across the vessel has come in its mean transit.
    """

    flow_ul_s: float
    tip_enters_s: FloatArray
    tip_leaves_s: FloatArray
    mean_enters_s: FloatArray
    mean_leaves_s: FloatArray
    half_leaves_s: FloatArray
    transit_s: FloatArray
    peclet: FloatArray
    fourier: FloatArray

    def regime(self) -> NDArray[np.str_]:
        """``carried``, ``between``, ``dispersed`` or ``still`` of each vessel."""
        words = np.select(
            [
                self.fourier < LIMITS.carried_below,
                self.fourier <= LIMITS.dispersed_above,
                self.fourier > 0.0,
            ],
            ["carried", "between", "dispersed"],
            "still",
        )
        return np.asarray(words, dtype=np.str_)


def dye_front(
    network: VesselNetwork,
    carried: CarryingFlow,
    flow_ul_s: float,
    diffusivity_mm2_s: float = DYE_DIFFUSIVITY,
) -> DyeFront:
    """Find tip and mean of the front in each vessel.

    Parameters
    ----------
    carried : CarryingFlow
        Of 1 µL/s; all its times go with 1 over the flow.
    flow_ul_s : float, µL/s
        Into the network.
    diffusivity_mm2_s : float, mm²/s
        Of the dye, for the verdict on diffusion alone: the front itself has none.
    """
    begin = _begins(network, carried)
    moves = carried.moves() & np.isfinite(carried.earliest_s[begin])
    transit = np.where(moves, carried.transit_s, np.nan) / flow_ul_s
    tip = carried.earliest_s[begin] / 2.0 / flow_ul_s
    age = mean_age(network, carried)[begin] / flow_ul_s
    radius = network.mean_radius()
    speed = np.where(moves, np.abs(carried.solution.velocity), np.nan) * flow_ul_s
    return DyeFront(
        flow_ul_s=flow_ul_s,
        tip_enters_s=np.where(moves, tip, np.nan),
        tip_leaves_s=tip + transit / 2.0,
        mean_enters_s=np.where(moves, age, np.nan),
        mean_leaves_s=age + transit,
        half_leaves_s=_half(network, carried, moves) / flow_ul_s,
        transit_s=transit,
        peclet=2.0 * radius * speed / diffusivity_mm2_s,
        fourier=transit * diffusivity_mm2_s / radius**2,
    )


def mean_age(network: VesselNetwork, carried: CarryingFlow) -> FloatArray:
    """Return the mean age of what flows by each node since the inlets, at 1 µL/s, (m,), s.

    Ages mix by flow. Inf at a node that nothing flows to; 0 at the inlets.
    """
    total, into = np.zeros((2, len(network.nodes)))
    entering = carried.entering
    age = np.where(entering, 0.0, np.inf)
    for k, first, last in _downstream(network, carried.solution):
        rate = abs(float(carried.solution.flow[k]))
        total[last] += rate * (age[first] + carried.transit_s[k])
        into[last] += rate
        if not entering[last]:
            age[last] = total[last] / max(into[last], LIMITS.still_ul_s)
    return age


def _begins(network: VesselNetwork, carried: CarryingFlow) -> NDArray[np.int64]:
    forward = carried.solution.flow >= 0.0
    return np.where(forward, network.vessel_nodes[:, 0], network.vessel_nodes[:, 1])


def _half(network: VesselNetwork, carried: CarryingFlow, moves: NDArray[np.bool_]) -> FloatArray:
    """Return when the area mean at each vessel's end is one half, at 1 µL/s, (v,), s.

    Vessels of like ages share a curve's length, so that early ones have steps short enough.
    """
    half_due = np.full(network.vessel_count, np.nan)
    age = mean_age(network, carried)[_begins(network, carried)] + carried.transit_s
    ready = np.flatnonzero(moves & np.isfinite(age))
    octave = np.floor(np.log2(age[ready]))
    for level in np.unique(octave):
        here = ready[octave == level]
        until = SAMPLING.mean_ages * 2.0 ** (float(level) + 1.0)
        times, curves = dye_curves(network, carried, here, np.ones(len(here)), until)
        after = np.clip(np.argmax(curves >= 0.5, axis=1), 1, None)
        row = np.arange(len(here))
        low, high = curves[row, after - 1], curves[row, after]
        part = np.clip((0.5 - low) / np.maximum(high - low, 1e-12), 0.0, 1.0)
        due = times[after - 1] + part * (times[1] - times[0])
        half_due[here] = np.where(curves.max(axis=1) >= 0.5, due, np.nan)
    return half_due


def front_table(network: VesselNetwork, front: DyeFront) -> dict[str, NDArray[np.generic]]:
    """Columns of a per-vessel table, each (v,)."""
    return {
        "vessel": np.arange(network.vessel_count),
        "kind": network.kind_names(),
        "length_mm": network.lengths(),
        "diameter_mm": 2.0 * network.mean_radius(),
        "tip_enters_s": front.tip_enters_s,
        "tip_leaves_s": front.tip_leaves_s,
        "mean_enters_s": front.mean_enters_s,
        "mean_leaves_s": front.mean_leaves_s,
        "half_leaves_s": front.half_leaves_s,
        "transit_s": front.transit_s,
        "peclet": front.peclet,
        "fourier": front.fourier,
        "regime": front.regime(),
    }


# No diffusion (Taylor 1953, doi 10.1098/rspa.1953.0139), flows that mix wholly at nodes. With T the
# mean transit to a place in a tube, volume over flow, a step at its entrance gives there the area
# mean 1 - T/2t, and the flux mean 1 - (T/2t)², from t = T/2 on: dye leaves with the distribution
# E(t) = T²/2t³ (Danckwerts 1953, doi 10.1016/0009-2509(53)80001-1). Paths are convolutions of
# these, and loops sums of paths; so both are done at once as products and sums of Laplace
# transforms, which over that of the step are E₂(sT/2) and 2 E₃(sT/2), with the exponential
# integrals Eₙ(z) = ∫₁^∞ exp(-zx)/xⁿ dx (Abramowitz & Stegun 5.1.4). It costs the same for any
# number of paths, and nothing is binned, as streamlines sorted by their flow would be.
ComplexArray = NDArray[np.complex128]
Mean = Literal["area", "flux"]
"""Of a section: by area, as a camera sees it, or by flow, as a cup at the outlet collects it."""


def dye_curves(
    network: VesselNetwork,
    flow: CarryingFlow,
    vessel: IntArray,
    share: FloatArray,
    until_s: float,
    mean: Mean = "area",
) -> tuple[FloatArray, FloatArray]:
    """Return the mean concentration at stations after a step at the inlets at time 0.

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
    steps = SAMPLING.steps
    step = until_s / steps
    times: FloatArray = step * np.arange(steps, dtype=np.float64)
    damping = SAMPLING.damping / (2.0 * until_s)
    s = np.asarray(damping + 2j * np.pi * np.fft.rfftfreq(2 * steps, step), dtype=np.complex128)
    # Lanczos' factors keep the ends of the spectrum from ringing.
    window = np.sinc(np.arange(len(s)) / len(s)) / (s * step)
    at_nodes = _nodes(network, flow, s)
    curves: FloatArray = np.zeros((len(vessel), steps))
    for k, first, _ in _downstream(network, flow.solution):
        here = np.flatnonzero(vessel == k)
        if len(here) == 0:
            continue
        second, third = _integrals(np.outer(share[here] * flow.transit_s[k] / 2.0, s))
        passed = second if mean == "area" else 2.0 * third
        back = np.fft.irfft(passed * at_nodes[first] * window, axis=1)[:, :steps]
        curves[here] = back * np.exp(damping * times)
    return times, np.asarray(np.maximum.accumulate(np.clip(curves, 0.0, 1.0), axis=1))


def _nodes(network: VesselNetwork, flow: CarryingFlow, s: ComplexArray) -> ComplexArray:
    """Flux mean at each node over that of the inlets' step, (m, frequencies)."""
    into = np.zeros(len(network.nodes))
    flux = np.zeros((len(network.nodes), len(s)), dtype=np.complex128)
    entering = flow.entering
    flux[entering] = 1.0
    for k, first, last in _downstream(network, flow.solution):
        begun = flux[first] if entering[first] else flux[first] / into[first]
        passed = 2.0 * _integrals(s * flow.transit_s[k] / 2.0)[1]
        rate = abs(float(flow.solution.flow[k]))
        flux[last] += rate * begun * passed
        into[last] += rate
    scaled = np.where(entering, 1.0, np.maximum(into, LIMITS.still_ul_s))
    return np.asarray(flux / scaled[:, None])


def _integrals(z: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """E₂ and E₃ by Eₙ₊₁(z) = (exp(-z) - z Eₙ(z))/n (Abramowitz & Stegun 5.1.14)."""
    z = np.where(np.abs(z) < 1e-9, 1e-9, z)
    fall = np.exp(-z)
    second = fall - z * exp1(z)
    return second, (fall - z * second) / 2.0


@dataclass(frozen=True)
class FrameCheck:
    """Result of checking a video's frame interval against the dye front.

    Attributes
    ----------
    interval_s : float, s
        Between frames.
    quick : (k,) int64
        Vessels that the tip runs through in less than `DyeLimits.frames_in_vessel` frames.
    needed_per_s : float, 1/s
        Frames a second that would show half of the vessels, and the whole.
    frames : float
        From the tip at the inlet to the tip where it leaves last.
    warning : str
        Empty where frames are near enough.
    """

    interval_s: float
    quick: IntArray
    needed_per_s: float
    frames: float
    warning: str


def check_frames(front: DyeFront, interval_s: float) -> FrameCheck:
    """Hold a film's interval against the front's tip.

    It warns where more than half of the vessels are too quick, or the whole is.
    """
    tips, frames_in_vessel = front.transit_s / 2.0, LIMITS.frames_in_vessel
    known = np.isfinite(tips)
    quick = np.flatnonzero(known & (tips < frames_in_vessel * interval_s))
    whole = float(np.nanmax(front.tip_leaves_s))
    needed = max(frames_in_vessel / float(np.median(tips[known])), LIMITS.frames_in_all / whole)
    frames = whole / interval_s
    warning = ""
    if 1.0 / interval_s < needed * (1.0 - 1e-9):
        warning = (
            f"frames {interval_s:.3g} s apart are too far apart: dye's tip runs through "
            f"{len(quick)} of {int(known.sum())} vessels in less than {frames_in_vessel:g} "
            f"frames, and through the whole in {frames:.3g}; film {np.ceil(needed):g} frames a "
            f"second or more, or lower the flow ({front.flow_ul_s * 0.06:.3g} mL/min)"
        )
    return FrameCheck(interval_s, quick, needed, frames, warning)
