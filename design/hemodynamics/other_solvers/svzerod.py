"""Write networks as svZeroDSolver's JSON input, in cm, g, s.

Not in SI: its default absolute tolerance, 1e-8, would take flows in m³/s for converged zeros.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from design.errors import FlowError
from design.files import write_text
from design.hemodynamics.conditions import (
    PressureOutlet,
    PulsatileConditions,
    ResistanceOutlet,
)
from design.hemodynamics.other_solvers.network_case import (
    closed_cycle,
    network_case,
    outlet_values,
)
from design.hemodynamics.vessel_coefficients import PARABOLIC, plug_inertance, vessel_resistance
from design.hemodynamics.waveforms import Waveform
from design.network import VesselNetwork
from design.units import DYN_CM2_PER_PA, DYN_S_CM5_PER_PA_S_UL


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
    if conditions.profile == "womersley":
        raise FlowError("svZeroDSolver has no Womersley impedance; choose the poiseuille profile")
    case = network_case(network, conditions, "svZeroDSolver")
    flow = conditions.inlet_is == "flow"
    if flow and len(case.inlets) > 1:
        raise FlowError(
            f"{len(case.inlets)} inlets share one flow, which svZeroDSolver can't say; give them a "
            "pressure, or join them by a vessel"
        )

    def wave(name: str, waveform: Waveform, kind: str, scale: float) -> dict[str, Any]:
        time, value = closed_cycle(waveform, case.period_s, steps, scale)
        values = {"Q" if kind == "FLOW" else "P": value.tolist(), "t": time.tolist()}
        return {"bc_name": name, "bc_type": kind, "bc_values": values}

    at = {node: f"INLET_{node}" for node in case.inlets}
    at |= {node: f"OUTLET_{node}" for node in case.outlets}
    kind = "FLOW" if flow else "PRESSURE"
    blocks = [wave(at[n], conditions.inlet, kind, case.inlet_scale) for n in case.inlets]
    for node, outlet in case.outlets.items():
        if isinstance(outlet, PressureOutlet):
            blocks.append(wave(at[node], outlet.waveform, "PRESSURE", DYN_CM2_PER_PA))
        else:
            kind = "RESISTANCE" if isinstance(outlet, ResistanceOutlet) else "RCR"
            blocks.append(
                {"bc_name": at[node], "bc_type": kind, "bc_values": outlet_values(outlet)}
            )
    return {
        "simulation_parameters": {
            "number_of_cardiac_cycles": cycles,
            "number_of_time_pts_per_cardiac_cycle": steps + 1,
            "output_all_cycles": False,
        },
        "boundary_conditions": blocks,
        "junctions": [
            {
                "junction_name": f"J{node}",
                "junction_type": "NORMAL_JUNCTION",
                "inlet_vessels": into,
                "outlet_vessels": out,
            }
            for node, (into, out) in case.joints.items()
        ],
        "vessels": _vessels(network, conditions, at),
    }


def _vessels(
    network: VesselNetwork, conditions: PulsatileConditions, at: Mapping[int, str]
) -> list[dict[str, Any]]:
    """Blocks of vessels; ``at`` names the boundary conditions by node."""
    lengths = network.lengths() / 10.0
    resistance = vessel_resistance(network, conditions.viscosity_pa_s) * DYN_S_CM5_PER_PA_S_UL
    inertance = PARABOLIC * plug_inertance(network, conditions.density) * DYN_S_CM5_PER_PA_S_UL
    compliance = conditions.wall.compliance(network) / DYN_S_CM5_PER_PA_S_UL
    vessels = []
    for k, ends in enumerate(network.vessel_nodes.tolist()):
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
        sides = zip(("inlet", "outlet"), ends, strict=True)
        named = {side: at[node] for side, node in sides if node in at}
        vessels.append(vessel | ({"boundary_conditions": named} if named else {}))
    return vessels
