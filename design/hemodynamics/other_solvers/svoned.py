"""Write a network with pulsatile conditions as an svOneDSolver input file, in cm, g, s.

The cards are those of its input file guide (SimVascular/svOneDSolver on GitHub,
docs/source/content/inputFileGuide.rst). What differs there, read from its sources
(cvOneDMaterialOlufsen.cxx, cvOneDOptionsLegacySerializer.cxx):

- its wall is p = p₀ + (4/3)(E h/r₀)(1 - √(A₀/A)), of the same compliance as ours at rest and softer
  when wide; the material `OLUFSEN` with k₁ = 0 gives each vessel the k₃ = E h/r₀ of ours,
  k₃ = ¾ K. `LINEAR` wants 4/3 of it in some versions, so it isn't used;
- its profile has the exponent that ours has, its vessels taper in straight lines;
- its joints are placed by their order, the first joint at the first node and so on: nodes where
  vessels meet are written first;
- it knows no reflecting outlet, no viscous wall, and one inlet.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

import numpy as np

from design.errors import FlowError
from design.files import write_text
from design.hemodynamics.conditions import (
    Outlet,
    PressureOutlet,
    PulsatileConditions,
    ResistanceOutlet,
    outlet_of,
)
from design.hemodynamics.one_d.grid import (
    OneDOptions,
    check_compliant,
    external_pressure,
    stiffness,
)
from design.hemodynamics.vessel_coefficients import VesselWalls
from design.hemodynamics.waveforms import Waveform, cycle_times
from design.hemodynamics.zero_d.boundary import boundary_nodes, check_parts, refuse_supplies
from design.network import VesselNetwork
from design.units import CM3_PER_UL, DYN_CM2_PER_PA, DYN_S_CM5_PER_PA_S_UL

_CELLS: Final = 20
_STEPS: Final = 1000
_SAVED: Final = 10
_CYCLES: Final = 10


def write_svoned(
    path: Path,
    network: VesselNetwork,
    conditions: PulsatileConditions,
    options: OneDOptions | None = None,
) -> None:
    """Write `svoned_input`.

    Raises
    ------
    FlowError
        As `svoned_input`.
    OSError
        When the file can't be written.
    """
    write_text(path, svoned_input(network, conditions, options, name=path.stem))


def svoned_input(
    network: VesselNetwork,
    conditions: PulsatileConditions,
    options: OneDOptions | None = None,
    name: str = "network",
) -> str:
    """The input file's text, for ten cycles of a thousand steps.

    Raises
    ------
    FlowError
        What the format can't say: several inlets, an end where not exactly one vessel ends, a
        node that vessels only enter or leave, a reflection, a viscous wall, a rigid one.
    """
    options = options or OneDOptions()
    check_compliant(network, conditions.wall)
    if external_pressure(conditions.wall, network.vessel_count).any() or options.alpha is not None:
        raise FlowError(
            "svOneDSolver has no pressure outside vessels, and alpha follows the profile; leave "
            "these out"
        )
    refuse_supplies(conditions.supplies, "svOneDSolver")
    inlets, outlets = boundary_nodes(network, conditions)
    check_parts(network, inlets, outlets)
    wall = conditions.wall
    viscous = isinstance(wall, VesselWalls) and wall.viscous is not None and wall.viscous.any()
    if options.reflection or options.wall_viscosity_pa_s or viscous:
        raise FlowError("svOneDSolver has no reflecting outlet and no viscous wall; leave them out")
    if len(inlets) != 1:
        raise FlowError(f"{len(inlets)} inlets; svOneDSolver takes one: join them by a vessel")
    joints = _joints(network, set(inlets.tolist()), set(outlets.tolist()))
    # Joints are placed by their order, so their nodes come first.
    order = [*joints, *(n for n in range(len(network.nodes)) if n not in joints)]
    number = {node: k for k, node in enumerate(order)}
    lines = [f"MODEL {''.join(c if c.isalnum() else '_' for c in name)}_", ""]
    for node in order:
        x, y, z = (network.nodes[node] / 10.0).tolist()
        lines.append(f"NODE {number[node]} {x!r} {y!r} {z!r}")
    for node, (into, out) in joints.items():
        lines.append(f"JOINT J{number[node]} {number[node]} IN{number[node]} OUT{number[node]}")
        for what, vessels in (("INLET IN", into), ("OUTLET OUT", out)):
            listed = " ".join(map(str, [len(vessels), *vessels]))
            lines.append(f"JOINT{what}{number[node]} {listed}")
    lines += _segments(network, conditions, number, set(outlets.tolist()))
    lines += _materials(network, conditions, options)
    lines += _outlet_tables(conditions, outlets.tolist())
    period = conditions.inlet.period_s or 1.0
    flow = conditions.inlet_is == "flow"
    lines += _table("INLET", conditions.inlet, period, CM3_PER_UL if flow else DYN_CM2_PER_PA)
    step = period / _STEPS
    kind = "FLOW" if flow else "PRESSURE_WAVE"
    total = _STEPS * _CYCLES
    lines.append(f"SOLVEROPTIONS {step!r} {_SAVED} {total} 2 INLET {kind} 1.0e-8 1 1")
    return "\n".join([*lines, "OUTPUT TEXT", ""])


def _joints(
    network: VesselNetwork, inlets: set[int], outlets: set[int]
) -> dict[int, tuple[list[int], list[int]]]:
    """Vessels that enter and that leave each inner node."""
    joints: dict[int, tuple[list[int], list[int]]] = {}
    for vessel, (first, last) in enumerate(network.vessel_nodes.tolist()):
        joints.setdefault(first, ([], []))[1].append(vessel)
        joints.setdefault(last, ([], []))[0].append(vessel)
    for node in sorted(inlets | outlets):
        into, out = joints.pop(node)
        right = (0, 1) if node in inlets else (1, 0)
        if (len(into), len(out)) != right:
            raise FlowError(
                f"{len(into)} vessels enter end {node} and {len(out)} leave it; svOneDSolver "
                "takes one vessel an end, that leaves an inlet or enters an outlet"
            )
    for node, (into, out) in joints.items():
        if not (into and out):
            raise FlowError(
                f"node {node} has vessels that only {'enter' if into else 'leave'}; turn one "
                "round for svOneDSolver"
            )
    return dict(sorted(joints.items()))


def _segments(
    network: VesselNetwork,
    conditions: PulsatileConditions,
    number: Mapping[int, int],
    outlets: set[int],
) -> Iterator[str]:
    lengths = (network.lengths() / 10.0).tolist()
    for k, (first, last) in enumerate(network.vessel_nodes.tolist()):
        radius = network.polyline(k)[1] / 10.0
        top, bottom = (float(np.pi * r * r) for r in (radius[0], radius[-1]))
        ending = "NOBOUND NONE"
        if last in outlets:
            ending = f"{_kind(outlet_of(conditions.outlet, last))} END{last}"
        yield (
            f"SEGMENT V{k} {k} {lengths[k]!r} {_CELLS} {number[first]} {number[last]} {top!r} "
            f"{bottom!r} 0.0 M{k} NONE 0.0 0 0 {ending}"
        )


def _materials(
    network: VesselNetwork, conditions: PulsatileConditions, options: OneDOptions
) -> Iterator[str]:
    radius = network.mean_radius()
    vessels = np.arange(network.vessel_count)
    stiff = stiffness(network, conditions.wall, vessels, radius**2, radius**3) * DYN_CM2_PER_PA
    density = conditions.density * 1e3
    viscosity = conditions.viscosity_pa_s * 10.0
    exponents = options.exponents(network.vessel_count).tolist()
    for k, value in enumerate((0.75 * stiff).tolist()):
        yield (
            f"MATERIAL M{k} OLUFSEN {density!r} {viscosity!r} 0.0 {exponents[k]!r} "
            f"0.0 0.0 {value!r}"
        )


def _kind(outlet: Outlet) -> str:
    if isinstance(outlet, PressureOutlet):
        return "PRESSURE"
    return "RESISTANCE" if isinstance(outlet, ResistanceOutlet) else "RCR"


def _outlet_tables(conditions: PulsatileConditions, outlets: list[int]) -> Iterator[str]:
    for node in outlets:
        outlet = outlet_of(conditions.outlet, node)
        if isinstance(outlet, PressureOutlet):
            if outlet.waveform.period_s is not None:
                raise FlowError(f"outlet {node}'s pressure changes; svOneDSolver holds it")
            values = [float(outlet.waveform.at(np.zeros(1))[0]) * DYN_CM2_PER_PA]
        elif isinstance(outlet, ResistanceOutlet):
            values = [outlet.resistance * DYN_S_CM5_PER_PA_S_UL, outlet.distal_pa * DYN_CM2_PER_PA]
        else:
            values = [
                outlet.proximal * DYN_S_CM5_PER_PA_S_UL,
                outlet.compliance / DYN_S_CM5_PER_PA_S_UL,
                outlet.distal * DYN_S_CM5_PER_PA_S_UL,
                outlet.distal_pa * DYN_CM2_PER_PA,
            ]
        yield f"DATATABLE END{node} LIST"
        yield from (f"0.0 {value!r}" for value in values)
        yield "ENDDATATABLE"


def _table(name: str, wave: Waveform, period: float, scale: float) -> Iterator[str]:
    times = cycle_times(period, 200, closed=True)
    values = wave.at(times) * scale
    values[-1] = values[0]
    yield f"DATATABLE {name} LIST"
    yield from (f"{t!r} {v!r}" for t, v in zip(times.tolist(), values.tolist(), strict=True))
    yield "ENDDATATABLE"
