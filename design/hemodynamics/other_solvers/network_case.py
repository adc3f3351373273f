"""Ends, joints, waves and outlets of a network in cm, g, s, as other solvers' files name them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from design.errors import FlowError
from design.hemodynamics.conditions import (
    Outlet,
    PressureOutlet,
    PulsatileConditions,
    ResistanceOutlet,
    outlets_by_node,
)
from design.hemodynamics.waveforms import Waveform, cycle_times
from design.hemodynamics.zero_d.boundary import checked_ends, refuse_supplies
from design.network import VesselNetwork
from design.units import CM3_PER_UL, DYN_CM2_PER_PA, DYN_S_CM5_PER_PA_S_UL
from kernels.arrays import FloatArray


class CgsUnits(NamedTuple):
    """What takes our units to cm, g, s."""

    poise_per_pa_s: float = 10.0
    g_cm3_per_pa_s2_mm2: float = 1e3
    cm_per_mm: float = 0.1


CGS: Final = CgsUnits()

Joint = tuple[list[int], list[int]]
"""Vessels that enter a node, and vessels that leave it."""


@dataclass(frozen=True)
class NetworkCase:
    """What a lumped or 1D solver's file says of a network's nodes.

    Attributes
    ----------
    inlets : list of int
    outlets : dict of node to Outlet
    joints : dict of node to Joint
        Nodes where vessels meet, rising.
    ends : dict of node to Joint
        Inlets and outlets, rising; one vessel each.
    period_s : float, s
        1 where nothing changes.
    inlet_scale : float
        Takes the inlet's waveform to cm³/s or dyn/cm².
    """

    inlets: list[int]
    outlets: dict[int, Outlet]
    joints: dict[int, Joint]
    ends: dict[int, Joint]
    period_s: float
    inlet_scale: float


def network_case(
    network: VesselNetwork, conditions: PulsatileConditions, solver: str
) -> NetworkCase:
    """Sort a network's nodes into ends and joints; ``solver`` is named in messages.

    Raises
    ------
    FlowError
        What neither lumped nor 1D files can say: supplies, an end where not exactly one vessel
        begins or ends, a node that vessels only enter or leave.
    """
    refuse_supplies(conditions.supplies, solver)
    inlets, outlets = checked_ends(network, conditions)
    every: list[Joint] = [([], []) for _ in network.nodes]
    for vessel, (first, last) in enumerate(network.vessel_nodes.tolist()):
        every[first][1].append(vessel)
        every[last][0].append(vessel)
    at_ends = {*inlets.tolist(), *outlets.tolist()}
    ends = {node: joint for node, joint in enumerate(every) if node in at_ends}
    joints = {node: joint for node, joint in enumerate(every) if node not in at_ends}
    for node, (into, out) in ends.items():
        if len(into) + len(out) != 1:
            raise FlowError(
                f"{len(into) + len(out)} vessels meet at end {node}; {solver} takes one vessel a "
                "boundary condition: lead them together by a short vessel"
            )
    for node, (into, out) in joints.items():
        if not (into and out):
            raise FlowError(
                f"node {node} has vessels that only {'enter' if into else 'leave'}; turn one "
                f"round for {solver}"
            )
    return NetworkCase(
        inlets=inlets.tolist(),
        outlets=outlets_by_node(conditions.outlet, outlets),
        joints=joints,
        ends=ends,
        period_s=conditions.inlet.period_s or 1.0,
        inlet_scale=CM3_PER_UL if conditions.inlet_is == "flow" else DYN_CM2_PER_PA,
    )


def closed_cycle(
    wave: Waveform, period_s: float, steps: int, scale: float
) -> tuple[FloatArray, FloatArray]:
    """Return times, s, and scaled values of a cycle whose last value is the first, (steps + 1,)."""
    times = cycle_times(period_s, steps, closed=True)
    values = wave.at(times) * scale
    values[-1] = values[0]
    return times, values


def constant_pressure(outlet: PressureOutlet) -> float | None:
    """Return an outlet's pressure, dyn/cm², or None where it changes."""
    if outlet.waveform.period_s is not None:
        return None
    return float(outlet.waveform.at(np.zeros(1))[0]) * DYN_CM2_PER_PA


def outlet_values(outlet: Outlet) -> dict[str, float]:
    """Return R and Pd, or Rp, C, Rd and Pd: dyn·s/cm⁵, cm⁵/dyn, dyn/cm²; none of a pressure."""
    if isinstance(outlet, PressureOutlet):
        return {}
    distal = outlet.distal_pa * DYN_CM2_PER_PA
    if isinstance(outlet, ResistanceOutlet):
        return {"R": outlet.resistance * DYN_S_CM5_PER_PA_S_UL, "Pd": distal}
    return {
        "Rp": outlet.proximal * DYN_S_CM5_PER_PA_S_UL,
        "C": outlet.compliance / DYN_S_CM5_PER_PA_S_UL,
        "Rd": outlet.distal * DYN_S_CM5_PER_PA_S_UL,
        "Pd": distal,
    }
