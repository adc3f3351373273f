"""`printctl oxygen`: solve oxygen in vessels and tissue of a network; report hypoxic tissue."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from pydantic import ValidationError

from design.files import write_text
from design.hemodynamics import FlowSolution, solve_flow, vessel_resistance
from design.network import VesselNetwork
from design.units import PA_PER_MMHG
from firmware_profiles.wrong_values import wording
from printctl.cli.measure import tissue_around
from printctl.cli.network_options import (
    SourceArg,
    TissueOption,
    TissueUnitOption,
    UnitOption,
)
from printctl.cli.options import JsonFlag, messages, print_json, print_lines
from printctl.errors import UsageError
from printctl.networks import Drive, Source, load_source
from printctl.oxygen import FIELD, SLICE, TABLE, hypoxia, solve_and_write
from printctl.recipe.oxygen import OxygenPart

NUMBERS = "oxygen.json"


def oxygen(
    network: SourceArg,
    tissue: TissueOption = None,
    tissue_unit: TissueUnitOption = None,
    unit: UnitOption = None,
    out: Annotated[
        Path, typer.Option("--out", help="Folder for the files; made where it isn't.")
    ] = Path("oxygen"),
    inlet_flow_ml_min: Annotated[
        float | None,
        typer.Option("--inlet-flow-ml-min", min=1e-9, help="0.25, or the run's own flow."),
    ] = None,
    viscosity_mpa_s: Annotated[
        float | None, typer.Option("--viscosity-mpa-s", min=1e-6, help="1, or the run's own.")
    ] = None,
    inlet_millimolar: Annotated[
        float, typer.Option("--inlet-millimolar", help="In the medium; with air at 37 °C 0.2.")
    ] = 0.2,
    cells_per_ml: Annotated[
        float, typer.Option("--cells-per-ml", help="In the tissue; assumed, count yours.")
    ] = 1e7,
    uptake_mol_per_cell_s: Annotated[
        float, typer.Option("--uptake-mol-per-cell-s", help="At most; assumed, measure yours.")
    ] = 5e-17,
    half_millimolar: Annotated[
        float, typer.Option("--half-millimolar", help="Where uptake is half of that.")
    ] = 1e-3,
    tissue_diffusivity_mm2_s: Annotated[
        float, typer.Option("--tissue-diffusivity-mm2-s", help="Of oxygen in tissue at 37 °C.")
    ] = 2e-3,
    threshold_millimolar: Annotated[
        float, typer.Option("--threshold-millimolar", help="Below it tissue is hypoxic.")
    ] = 0.01,
    bath_millimolar: Annotated[
        float | None,
        typer.Option("--bath-millimolar", help="At the tissue's surface; else nothing passes."),
    ] = None,
    spacing_um: Annotated[float | None, typer.Option("--spacing-um", help="Of the grid.")] = None,
    grid_cells: Annotated[
        int, typer.Option("--grid-cells", help="About so many, without --spacing-um.")
    ] = 1_000_000,
    as_json: JsonFlag = False,
) -> None:
    """Oxygen in vessels and tissue: what is hypoxic, what is left at the outlets.

    What isn't given is assumed, and the assumptions stand in the result: cells and their uptake
    decide it, so give your own.
    """
    given = inlet_flow_ml_min is not None or viscosity_mpa_s is not None
    drive = Drive(inlet_flow_ml_min or 0.25, viscosity_mpa_s or 1.0)
    source = load_source(network, unit, drive)
    part = _part(
        inlet_millimolar=inlet_millimolar,
        cells_per_ml=cells_per_ml,
        uptake_mol_per_cell_s=uptake_mol_per_cell_s,
        half_millimolar=half_millimolar,
        tissue_diffusivity_mm2_s=tissue_diffusivity_mm2_s,
        threshold_millimolar=threshold_millimolar,
        bath_millimolar=bath_millimolar,
        spacing_um=spacing_um,
        grid_cells=grid_cells,
    )
    flow = None if given else known_flow(source)
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


def _part(**given: Any) -> OxygenPart:
    """The options as a recipe's section, checked as it would be."""
    try:
        return OxygenPart(**given)
    except ValidationError as exc:
        first = exc.errors()[0]
        option = "--" + ".".join(map(str, first["loc"])).replace("_", "-")
        raise UsageError(f"{option}: {wording(first)} (is {first['input']!r})") from exc


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
