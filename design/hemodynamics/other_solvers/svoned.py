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

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from design.errors import FlowError
from design.files import write_text
from design.hemodynamics.conditions import (
    PressureOutlet,
    PulsatileConditions,
    ResistanceOutlet,
    WindkesselOutlet,
)
from design.hemodynamics.one_d.grid import (
    OneDOptions,
    check_compliant,
    external_pressure,
    stiffness,
)
from design.hemodynamics.other_solvers.network_case import (
    CGS,
    NetworkCase,
    closed_cycle,
    constant_pressure,
    network_case,
    outlet_values,
)
from design.hemodynamics.vessel_coefficients import VesselWalls
from design.hemodynamics.zero_d.boundary import boundary_nodes
from design.network import VesselNetwork
from design.units import DYN_CM2_PER_PA


class Steps(NamedTuple):
    """Resolution that is written."""

    cells: int = 20
    """Of a vessel."""
    per_cycle: int = 1000
    """Time steps."""
    saved_every: int = 10
    """Time steps."""
    cycles: int = 10


STEPS: Final = Steps()
_KINDS: Final[dict[type, str]] = {
    PressureOutlet: "PRESSURE",
    ResistanceOutlet: "RESISTANCE",
    WindkesselOutlet: "RCR",
}


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
    _refuse_unsaid(network, conditions, options)
    case = network_case(network, conditions, "svOneDSolver")
    for node, (into, _) in case.ends.items():
        if bool(into) != (node in case.outlets):
            raise FlowError(
                f"the vessel at end {node} runs the wrong way; svOneDSolver wants it to leave an "
                "inlet and to enter an outlet: turn it round"
            )
    # Joints are placed by their order, so their nodes come first.
    order = [*case.joints, *case.ends]
    number = {node: k for k, node in enumerate(order)}
    lines = [f"MODEL {''.join(c if c.isalnum() else '_' for c in name)}_", ""]
    for node in order:
        x, y, z = (network.nodes[node] / 10.0).tolist()
        lines.append(f"NODE {number[node]} {x!r} {y!r} {z!r}")
    for node, (into, out) in case.joints.items():
        lines.append(f"JOINT J{number[node]} {number[node]} IN{number[node]} OUT{number[node]}")
        for what, vessels in (("INLET IN", into), ("OUTLET OUT", out)):
            listed = " ".join(map(str, [len(vessels), *vessels]))
            lines.append(f"JOINT{what}{number[node]} {listed}")
    lines += _segments(network, case, number)
    lines += _materials(network, conditions, options)
    lines += _outlet_tables(case)
    times, values = closed_cycle(conditions.inlet, case.period_s, 200, case.inlet_scale)
    rows = zip(times.tolist(), values.tolist(), strict=True)
    lines += _table("INLET", (f"{t!r} {v!r}" for t, v in rows))
    step, total = case.period_s / STEPS.per_cycle, STEPS.per_cycle * STEPS.cycles
    kind = "FLOW" if conditions.inlet_is == "flow" else "PRESSURE_WAVE"
    lines.append(f"SOLVEROPTIONS {step!r} {STEPS.saved_every} {total} 2 INLET {kind} 1.0e-8 1 1")
    return "\n".join([*lines, "OUTPUT TEXT", ""])


def _refuse_unsaid(
    network: VesselNetwork, conditions: PulsatileConditions, options: OneDOptions
) -> None:
    wall, inlets = conditions.wall, boundary_nodes(network, conditions)[0]
    check_compliant(network, wall)
    if len(inlets) != 1:
        raise FlowError(f"{len(inlets)} inlets; svOneDSolver takes one: join them by a vessel")
    if external_pressure(wall, network.vessel_count).any() or options.alpha is not None:
        raise FlowError(
            "svOneDSolver has no pressure outside vessels, and alpha follows the profile; leave "
            "these out"
        )
    viscous = isinstance(wall, VesselWalls) and wall.viscous is not None and wall.viscous.any()
    if options.reflection or options.wall_viscosity_pa_s or viscous:
        raise FlowError("svOneDSolver has no reflecting outlet and no viscous wall; leave them out")


def _segments(
    network: VesselNetwork, case: NetworkCase, number: Mapping[int, int]
) -> Iterator[str]:
    lengths = (network.lengths() / 10.0).tolist()
    for k, (first, last) in enumerate(network.vessel_nodes.tolist()):
        radius = network.polyline(k)[1] / 10.0
        top, bottom = (float(np.pi * r * r) for r in (radius[0], radius[-1]))
        ending = "NOBOUND NONE"
        if last in case.outlets:
            ending = f"{_KINDS[type(case.outlets[last])]} END{last}"
        yield (
            f"SEGMENT V{k} {k} {lengths[k]!r} {STEPS.cells} {number[first]} {number[last]} {top!r} "
            f"{bottom!r} 0.0 M{k} NONE 0.0 0 0 {ending}"
        )


def _materials(
    network: VesselNetwork, conditions: PulsatileConditions, options: OneDOptions
) -> Iterator[str]:
    radius = network.mean_radius()
    vessels = np.arange(network.vessel_count)
    stiff = stiffness(network, conditions.wall, vessels, radius**2, radius**3) * DYN_CM2_PER_PA
    density = conditions.density * CGS.g_cm3_per_pa_s2_mm2
    viscosity = conditions.viscosity_pa_s * CGS.poise_per_pa_s
    exponents = options.exponents(network.vessel_count).tolist()
    for k, value in enumerate((0.75 * stiff).tolist()):
        yield (
            f"MATERIAL M{k} OLUFSEN {density!r} {viscosity!r} 0.0 {exponents[k]!r} "
            f"0.0 0.0 {value!r}"
        )


def _outlet_tables(case: NetworkCase) -> Iterator[str]:
    for node, outlet in case.outlets.items():
        values = list(outlet_values(outlet).values())
        if isinstance(outlet, PressureOutlet):
            pressure = constant_pressure(outlet)
            if pressure is None:
                raise FlowError(f"outlet {node}'s pressure changes; svOneDSolver holds it")
            values = [pressure]
        yield from _table(f"END{node}", (f"0.0 {value!r}" for value in values))


def _table(name: str, rows: Iterable[str]) -> Iterator[str]:
    yield f"DATATABLE {name} LIST"
    yield from rows
    yield "ENDDATATABLE"
