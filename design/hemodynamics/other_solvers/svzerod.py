"""Write a network with pulsatile conditions as svZeroDSolver's JSON input, in cm, g, s.

Not in SI: its default absolute tolerance, 1e-8, would take flows in m³/s for converged zeros.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from design.errors import FlowError
from design.files import write_text
from design.hemodynamics.vessel_coefficients import PARABOLIC, plug_inertance, vessel_resistance
from design.hemodynamics.waveforms import Waveform, cycle_times
from design.hemodynamics.zero_d.boundary import boundary_nodes, check_parts, refuse_supplies
from design.hemodynamics.zero_d.pulsatile.conditions import (
    Outlet,
    PressureOutlet,
    PulsatileConditions,
    ResistanceOutlet,
)
from design.network import VesselNetwork

CM3_PER_UL: Final = 1e-3
DYN_CM2_PER_PA: Final = 10.0
_R: Final = DYN_CM2_PER_PA / CM3_PER_UL


def write_svzerod(
    path: Path,
    network: VesselNetwork,
    conditions: PulsatileConditions,
    steps: int = 100,
    cycles: int = 10,
) -> None:
    """Write `svzerod_input` as JSON.

    Raises
    ------
    FlowError
        As `svzerod_input`.
    OSError
        When the file can't be written.
    """
    write_text(path, json.dumps(svzerod_input(network, conditions, steps, cycles), indent=1) + "\n")


def svzerod_input(
    network: VesselNetwork, conditions: PulsatileConditions, steps: int = 100, cycles: int = 10
) -> dict[str, Any]:
    """The input file's content.

    Its vessels are R, C, L in this order, ours a Π; they agree as vessels get short.

    Raises
    ------
    FlowError
        What the format can't say: an inlet or outlet where not exactly one vessel begins or
        ends, several inlets on one flow, Womersley's impedance.
    """
    refuse_supplies(conditions.supplies, "svZeroDSolver")
    inlets, outlets = boundary_nodes(network, conditions)
    check_parts(network, inlets, outlets)
    if conditions.profile == "womersley":
        raise FlowError("svZeroDSolver has no Womersley impedance; choose the poiseuille profile")
    if conditions.inlet_is == "flow" and len(inlets) > 1:
        raise FlowError(
            f"{len(inlets)} inlets share one flow, which svZeroDSolver can't say; give them a "
            "pressure, or join them by a vessel"
        )
    period = conditions.inlet.period_s or 1.0
    waves: list[dict[str, Any]] = []
    at: dict[int, str] = {}
    for node in inlets.tolist():
        at[node] = f"INLET_{node}"
        flow = conditions.inlet_is == "flow"
        waves.append(_wave(at[node], conditions.inlet, period, steps, flow=flow))
    for node in outlets.tolist():
        at[node] = f"OUTLET_{node}"
        waves.append(_outlet(at[node], _of(conditions.outlet, node), period, steps))
    return {
        "simulation_parameters": {
            "number_of_cardiac_cycles": cycles,
            "number_of_time_pts_per_cardiac_cycle": steps + 1,
            "output_all_cycles": False,
        },
        "boundary_conditions": waves,
        "junctions": _junctions(network, set(at)),
        "vessels": _vessels(network, conditions, at),
    }


def _of(given: Outlet | Mapping[int, Outlet], node: int) -> Outlet:
    if not isinstance(given, Mapping):
        return given
    if node not in given:
        raise FlowError(f"outlet {node} has no condition; give it one")
    return given[node]


def _wave(name: str, wave: Waveform, period: float, steps: int, *, flow: bool) -> dict[str, Any]:
    time = cycle_times(period, steps, closed=True)
    value = wave.at(time) * (CM3_PER_UL if flow else DYN_CM2_PER_PA)
    value[-1] = value[0]
    return {
        "bc_name": name,
        "bc_type": "FLOW" if flow else "PRESSURE",
        "bc_values": {"Q" if flow else "P": value.tolist(), "t": time.tolist()},
    }


def _outlet(name: str, outlet: Outlet, period: float, steps: int) -> dict[str, Any]:
    if isinstance(outlet, PressureOutlet):
        return _wave(name, outlet.waveform, period, steps, flow=False)
    distal = outlet.distal_pa * DYN_CM2_PER_PA
    if isinstance(outlet, ResistanceOutlet):
        values = {"R": outlet.resistance * _R, "Pd": distal}
        return {"bc_name": name, "bc_type": "RESISTANCE", "bc_values": values}
    values = {
        "Rp": outlet.proximal * _R,
        "C": outlet.compliance / _R,
        "Rd": outlet.distal * _R,
        "Pd": distal,
    }
    return {"bc_name": name, "bc_type": "RCR", "bc_values": values}


def _junctions(network: VesselNetwork, ends: set[int]) -> list[dict[str, Any]]:
    entering: list[list[int]] = [[] for _ in network.nodes]
    leaving: list[list[int]] = [[] for _ in network.nodes]
    for vessel, (first, last) in enumerate(network.vessel_nodes.tolist()):
        leaving[first].append(vessel)
        entering[last].append(vessel)
    junctions = []
    for node, (into, out) in enumerate(zip(entering, leaving, strict=True)):
        if node in ends:
            if len(into) + len(out) != 1:
                raise FlowError(
                    f"{len(into) + len(out)} vessels meet at end {node}; svZeroDSolver takes one "
                    "vessel a boundary condition: lead them together by a short vessel"
                )
            continue
        if not (into and out):
            raise FlowError(
                f"node {node} has vessels that only {'enter' if into else 'leave'}; turn one "
                "round for svZeroDSolver"
            )
        junctions.append(
            {
                "junction_name": f"J{node}",
                "junction_type": "NORMAL_JUNCTION",
                "inlet_vessels": into,
                "outlet_vessels": out,
            }
        )
    return junctions


def _vessels(
    network: VesselNetwork, conditions: PulsatileConditions, at: dict[int, str]
) -> list[dict[str, Any]]:
    lengths = network.lengths() / 10.0
    resistance = vessel_resistance(network, conditions.viscosity_pa_s) * _R
    inertance = PARABOLIC * plug_inertance(network, conditions.density) * _R
    compliance = conditions.wall.compliance(network) / _R
    vessels = []
    for k, (first, last) in enumerate(network.vessel_nodes.tolist()):
        named = {"inlet": at.get(first), "outlet": at.get(last)}
        conditions_here = {side: name for side, name in named.items() if name is not None}
        vessel: dict[str, Any] = {
            "vessel_id": k,
            "vessel_name": f"branch{k}_seg0",
            "vessel_length": float(lengths[k]),
            "zero_d_element_type": "BloodVessel",
            "zero_d_element_values": {
                "R_poiseuille": float(resistance[k]),
                "C": float(compliance[k]),
                "L": float(inertance[k]),
            },
        }
        if conditions_here:
            vessel["boundary_conditions"] = conditions_here
        vessels.append(vessel)
    return vessels
