"""Compute a dye front's arrival times in each vessel; classify vessels by diffusion's effect.

The tip runs on the axis at twice the mean speed, so that it is through a vessel in T/2; the mean
takes T. Both add up along a way, since flows mix at nodes and some of what comes goes on along the
axis.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from design.hemodynamics.dye.curves import dye_curves
from design.hemodynamics.dye.transit_times import STILL, CarryingFlow, downstream_order, flow_ends
from design.network import VesselNetwork
from kernels.arrays import FloatArray

DYE_DIFFUSIVITY: Final = 4e-4
"""mm²/s; fluorescein in water at 25 °C has 4.25e-4 (Culbertson et al. 2002,
doi 10.1016/S0039-9140(01)00602-6)."""

CARRIED_BELOW: Final = 0.01
DISPERSED_ABOVE: Final = 0.8
"""Transit times D/r²: below the first, dye is carried as if it didn't diffuse; above the second its
section is even and the front is Taylor's, a bell that runs with the mean (Ananthakrishnan, Gill &
Barduhn 1965, AIChE J 11, 1063, for Péclet numbers above some hundreds)."""

_SPAN: Final = 4.0
"""Curves run to so many mean ages of the slowest place: of one tube they are at 7/8 by then."""


@dataclass(frozen=True)
class DyeFront:
    """When a step of dye at the inlets comes to each vessel; times from the inlets, s.

    All arrays (v,); NaN where nothing flows or dye doesn't lead.

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
            [self.fourier < CARRIED_BELOW, self.fourier <= DISPERSED_ABOVE, self.fourier > 0.0],
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
    network : VesselNetwork
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
    """Mean time that what flows by each node has taken from the inlets, at 1 µL/s, (m,), s.

    Ages mix by flow. Inf at a node that nothing flows to; 0 at the inlets.
    """
    solution = carried.solution
    total, into = np.zeros((2, len(network.nodes)))
    entering = carried.earliest_s == 0.0
    age = np.where(entering, 0.0, np.inf)
    for k in downstream_order(network, solution).tolist():
        first, last = flow_ends(network, solution, k)
        rate = abs(float(solution.flow[k]))
        total[last] += rate * (age[first] + carried.transit_s[k])
        into[last] += rate
        if not entering[last]:
            age[last] = total[last] / max(into[last], STILL)
    return age


def _begins(network: VesselNetwork, carried: CarryingFlow) -> NDArray[np.int64]:
    forward = carried.solution.flow >= 0.0
    return np.where(forward, network.vessel_nodes[:, 0], network.vessel_nodes[:, 1])


def _half(network: VesselNetwork, carried: CarryingFlow, moves: NDArray[np.bool_]) -> FloatArray:
    """When the area mean at each vessel's end is one half, at 1 µL/s, (v,), s.

    Vessel by vessel in classes of like ages, so that an early one isn't read off steps that are
    fit for the latest.
    """
    half_due = np.full(network.vessel_count, np.nan)
    age = mean_age(network, carried)[_begins(network, carried)] + carried.transit_s
    ready = np.flatnonzero(moves & np.isfinite(age))
    octave = np.floor(np.log2(age[ready]))
    for level in np.unique(octave):
        here = ready[octave == level]
        until = _SPAN * 2.0 ** (float(level) + 1.0)
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
