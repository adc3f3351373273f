"""`printctl measure`, `oxygen`: a network in its tissue: distances, branching, flow, oxygen."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final, Literal

from design.files import write_text
from design.hemodynamics import solve_flow
from design.measures import MeasureOptions, compare_orders, measure_network, measures_dict
from design.network_files.by_suffix import READ
from design.tissue import SizeLimits, Tissue, load_tissue
from design.units import LengthUnit
from printctl.analysis.measure_words import measure_lines
from printctl.analysis.meshes import unit_missing
from printctl.analysis.networks import Drive, load_source
from printctl.analysis.oxygen import FIELD, SLICE, TABLE, hypoxia, known_flow, solve_and_write
from printctl.cli import options as cli
from printctl.cli.declare import json_command
from printctl.cli.section_options import SectionOptions, Sections
from printctl.errors import UsageError
from printctl.recipe.parts import OxygenPart
from printctl.run_folder.artefacts import SURFACE
from printctl.settings import opt, settings

_ANY_SIZE = SizeLimits(0.5, 2000.0)
"""The network says where the tissue is, so that a wrong unit shows in the measures."""


@settings
class NetworkInTissue:
    """A network, and the tissue around it."""

    network: cli.SourceArg
    tissue: Path | None = opt("A closed mesh, or a run folder; a run has its own.")
    tissue_unit: LengthUnit | None = opt("Length unit of the tissue mesh.")
    unit: cli.UnitOption = None

    def around(self) -> Tissue:
        """The tissue that the user names, or that of the run."""
        path, unit = self.tissue or self.network, self.tissue_unit
        if path.is_dir():
            path, unit = path / SURFACE, "mm"
            if not path.is_file():
                raise UsageError(f"{path} isn't there; give --tissue a mesh or a run folder")
        elif path.suffix.lower() in READ:
            raise UsageError("a network alone has no tissue; give --tissue a mesh or a run folder")
        if unit is None:
            raise unit_missing(path, "--tissue-unit")
        cli.messages().print("preparing the tissue ...")
        return load_tissue(path, unit, limits=_ANY_SIZE)


@json_command
def measure(
    *,
    design: NetworkInTissue,
    out: Path | None = opt("Write the JSON into a file."),
    printable_mm: float | None = opt("Measure again for lumens at least as wide."),
    murray_exponent: float = opt("That radii at junctions are held against.", 3.0, min=1, max=5),
    samples: int = opt("Points in the tissue.", 200_000, min=100, max=50_000_000),
    seed: int = opt("Random seed of the points.", 1, min=0),
    against: Literal["coronary", "kidney", "lung", "liver"] | None = opt(
        "Compare orders and forks with published real vessels."
    ),
    drive: Drive,
) -> None:
    """Measure any network in a tissue: distances, densities, oxygen, orders, Murray's law, flow.

    A run folder brings its tissue and flow; beside a network's file name the tissue, too.
    """
    cli.refuse_input_as_output(out, design.network)
    source = load_source(design.network, design.unit, drive)
    how = MeasureOptions(samples, seed, printable_mm, murray_exponent=murray_exponent)
    flow, around = source.known.flow.get("flow_ul_s"), design.around()
    measures = measures_dict(measure_network(source.network, around, how, flow))
    if against is not None:
        measures["against"] = compare_orders(source.network, against)
    if out is not None:
        write_text(out, json.dumps(measures, indent=1, allow_nan=False) + "\n")
    cli.print_dim(source.notes)
    written = [] if out is None else [str(out)]
    cli.print_result(measures, lambda: [*measure_lines(measures), *written])


NUMBERS = "oxygen.json"
_SHOWN = (
    *("hypoxic_percent", "hypoxic_coarser_percent", "mean_millimolar", "least_millimolar"),
    *("outlet_millimolar", "extraction_percent", "demand_met_percent", "cells"),
    *("cells_fed_at_most", "imbalance", "spacing_um"),
)
_PART: Final[Any] = Sections([SectionOptions(OxygenPart)], OxygenPart, "oxygen")


@json_command
def oxygen(
    *,
    design: NetworkInTissue,
    out: Path = opt(
        "Folder for the files; made where it isn't.", Path("oxygen"), callback=cli.folder_to_write
    ),
    drive: Drive,
    part: OxygenPart = _PART,
) -> None:
    """Oxygen in vessels and tissue: what is hypoxic, what is left at the outlets.

    What isn't given is assumed, and the assumptions stand in the result: cells and their uptake
    decide it, so give your own.
    """
    source = load_source(design.network, design.unit, drive)
    flow = known_flow(source) or solve_flow(source.network, drive.conditions(source.network))
    around = design.around()
    out.mkdir(parents=True, exist_ok=True)
    numbers = solve_and_write(out, source.network, flow, around, part, _report_progress)
    write_text(out / NUMBERS, json.dumps(numbers, indent=1, allow_nan=False) + "\n")
    cli.print_dim(source.notes)
    files = [str(out / name) for name in (NUMBERS, TABLE, FIELD, SLICE)]
    main = [f"{key}: {numbers[key]:.4g}" for key in _SHOWN if key in numbers]
    cli.print_result(numbers, lambda: [hypoxia(numbers, part), *main, *files])


def _report_progress(fraction: float, note: str = "") -> None:
    cli.messages().print(f"solving at {note} ...")
