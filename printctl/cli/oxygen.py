"""`printctl oxygen`: solve oxygen in vessels and tissue of a network; report hypoxic tissue."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import numpy as np
from pydantic import ValidationError

from design.files import write_text
from design.hemodynamics import FlowSolution, solve_flow, vessel_resistance
from design.network import VesselNetwork
from design.units import PA_PER_MMHG
from printctl.analysis.networks import Drive, Source, load_source
from printctl.analysis.oxygen import FIELD, SLICE, TABLE, hypoxia, solve_and_write
from printctl.cli.declare import command
from printctl.cli.measure import tissue_around
from printctl.cli.options import (
    InletFlowOption,
    JsonFlag,
    SourceArg,
    TissueOption,
    TissueUnitOption,
    UnitOption,
    ViscosityOption,
    folder_to_write,
    messages,
    print_json,
    print_lines,
)
from printctl.cli.section_options import (
    SectionOptions,
    Sections,
    section_values,
    wrong_option,
)
from printctl.recipe.parts import OxygenPart
from printctl.settings import opt

NUMBERS = "oxygen.json"
_SECTION: Final = SectionOptions(OxygenPart)


def _part(typed: dict[str, Any]) -> OxygenPart:
    """The options as a recipe's section, checked as it would be."""
    try:
        return OxygenPart(**section_values([_SECTION], typed))
    except ValidationError as exc:
        raise wrong_option(exc, [_SECTION], "oxygen") from exc


_PART: Final = Sections([_SECTION], _part)


@command
def oxygen(
    *,
    network: SourceArg,
    tissue: TissueOption = None,
    tissue_unit: TissueUnitOption = None,
    unit: UnitOption = None,
    out: Path = opt(
        "Folder for the files; made where it isn't.", Path("oxygen"), callback=folder_to_write
    ),
    inlet_flow_ml_min: InletFlowOption = None,
    viscosity_mpa_s: ViscosityOption = None,
    part: OxygenPart = _PART,
    as_json: JsonFlag = False,
) -> None:
    """Oxygen in vessels and tissue: what is hypoxic, what is left at the outlets.

    What isn't given is assumed, and the assumptions stand in the result: cells and their uptake
    decide it, so give your own.
    """
    drive = Drive(inlet_flow_ml_min, viscosity_mpa_s)
    source = load_source(network, unit, drive)
    flow = known_flow(source)
    if flow is None:
        flow = solve_flow(source.network, drive.conditions())
    around = tissue_around(tissue if tissue is not None else network, tissue_unit)
    out.mkdir(parents=True, exist_ok=True)
    numbers = solve_and_write(out, source.network, flow, around, part, _report_progress)
    write_text(out / NUMBERS, json.dumps(numbers, indent=1, allow_nan=False) + "\n")
    if as_json:
        print_json(numbers)
        return
    for note in source.notes:
        messages().print(note, style="dim", markup=False)
    files = (NUMBERS, TABLE, FIELD, SLICE)
    print_lines(hypoxia(numbers, part), *_lines(numbers), *(str(out / name) for name in files))


def _report_progress(fraction: float, note: str = "") -> None:
    messages().print(f"solving at {note} ...")


def known_flow(source: Source) -> FlowSolution | None:
    """The flow that a run found; None where nothing is known."""
    known, network = source.known.flow, source.network
    if "flow_ul_s" not in known:
        return None
    flow, radius = known["flow_ul_s"], network.mean_radius()
    return FlowSolution(
        pressure=_node_pressure(network, known["pressure_in_mmhg"], known["pressure_out_mmhg"]),
        flow=flow,
        velocity=flow / (np.pi * radius**2),
        wall_shear=known["wall_shear_pa"],
        resistance=vessel_resistance(network, 1e-3),
    )


def _node_pressure(network: VesselNetwork, enter: Any, leave: Any) -> Any:
    pressure = np.zeros(len(network.nodes))
    pressure[network.vessel_nodes[:, 0]] = enter * PA_PER_MMHG
    pressure[network.vessel_nodes[:, 1]] = leave * PA_PER_MMHG
    return pressure


def _lines(numbers: dict[str, Any]) -> list[str]:
    """The main numbers, a line each."""
    keys = (
        "hypoxic_percent", "hypoxic_coarser_percent", "mean_millimolar", "least_millimolar",
        "outlet_millimolar", "extraction_percent", "demand_met_percent", "cells",
        "cells_fed_at_most", "imbalance", "spacing_um",
    )  # fmt: skip
    return [f"{key}: {numbers[key]:.4g}" for key in keys if key in numbers]
