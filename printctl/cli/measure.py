"""`printctl measure`: distances, densities, branching, flow and oxygen of a network in tissue."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Literal

import typer

from design.files import write_text
from design.measures import MeasureOptions, compare_orders, measure_network, measures_dict
from design.network_files.by_suffix import READ
from design.tissue import SizeLimits, Tissue, load_tissue
from design.units import LengthUnit
from printctl.analysis.networks import Drive, load_source
from printctl.cli.measure_table import measure_lines
from printctl.cli.network_options import (
    InletFlowOption,
    SourceArg,
    TissueOption,
    TissueUnitOption,
    UnitOption,
    ViscosityOption,
)
from printctl.cli.options import (
    JsonFlag,
    messages,
    print_json,
    print_lines,
    refuse_input_as_output,
)
from printctl.errors import UsageError
from printctl.run_folder.artefacts import SURFACE

_ANY_SIZE = SizeLimits(0.5, 2000.0)
"""The network says where the tissue is, so that a wrong unit shows in the measures."""


def measure(
    network: SourceArg,
    tissue: TissueOption = None,
    tissue_unit: TissueUnitOption = None,
    unit: UnitOption = None,
    out: Annotated[Path | None, typer.Option("--out", help="Write the JSON into a file.")] = None,
    printable_mm: Annotated[
        float | None,
        typer.Option("--printable-mm", help="Measure again for lumens at least as wide."),
    ] = None,
    murray_exponent: Annotated[
        float,
        typer.Option(
            "--murray-exponent", help="That radii at junctions are held against.", min=1, max=5
        ),
    ] = 3.0,
    samples: Annotated[
        int, typer.Option("--samples", min=100, max=50_000_000, help="Points in the tissue.")
    ] = 200_000,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of the points.")] = 1,
    against: Annotated[
        Literal["coronary", "kidney", "lung", "liver"] | None,
        typer.Option("--against", help="Compare orders and forks with published real vessels."),
    ] = None,
    inlet_flow_ml_min: InletFlowOption = None,
    viscosity_mpa_s: ViscosityOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Measure any network in a tissue: distances, densities, oxygen, orders, Murray's law, flow.

    A run folder brings its tissue and flow; beside a network's file name the tissue, too.
    """
    refuse_input_as_output(out, network)
    source = load_source(network, unit, Drive(inlet_flow_ml_min, viscosity_mpa_s))
    options = MeasureOptions(
        samples=samples,
        seed=seed,
        printable_diameter_mm=printable_mm,
        murray_exponent=murray_exponent,
    )
    around = tissue_around(tissue if tissue is not None else network, tissue_unit)
    measures = measures_dict(
        measure_network(source.network, around, options, source.known.flow.get("flow_ul_s"))
    )
    if against is not None:
        measures["against"] = compare_orders(source.network, against)
    text = json.dumps(measures, indent=1, allow_nan=False) + "\n"
    if out is not None:
        write_text(out, text)
    if as_json:
        print_json(measures)
        return
    for note in source.notes:
        messages().print(note, style="dim", markup=False)
    print_lines(*measure_lines(measures), *([str(out)] if out is not None else []))


def tissue_around(path: Path, unit: LengthUnit | None) -> Tissue:
    """The tissue that the user names, or that of the run."""
    if path.is_dir():
        path, unit = path / SURFACE, "mm"
        if not path.is_file():
            raise UsageError(f"{path} isn't there; give --tissue a mesh or a run folder")
    elif path.suffix.lower() in READ:
        raise UsageError("a network alone has no tissue; give --tissue a mesh or a run folder")
    if unit is None:
        raise UsageError(f"--tissue {path} doesn't say its unit; give --tissue-unit")
    messages().print("preparing the tissue ...")
    return load_tissue(path, unit, limits=_ANY_SIZE)
