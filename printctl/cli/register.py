"""`printctl register`: hold a scan against a design."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from design.network_csv import read_network_csv
from design.solids import Solid, read_solid
from design.units import LengthUnit
from printctl.ahead import call_ahead
from printctl.cli.options import JsonFlag, messages, print_json, print_lines
from printctl.cli.pdf_option import PdfFlag
from printctl.cli.progress_option import ProgressFileOption, Steps
from printctl.cli.record_option import read_record
from printctl.cli.scan_options import (
    AirAbove,
    Axes,
    CountRange,
    CountsPerDb,
    DbAtZero,
    DbRange,
    DepthDown,
    Filled,
    Mirrored,
    Modality,
    OctCalibrationFile,
    OpticalDepth,
    RefractiveIndex,
    Scale,
    ScanFile,
    VoxelUm,
    WallsFile,
    said_of_counts,
    said_of_scan,
)
from printctl.cli.tolerance_options import tolerances_of
from printctl.errors import UsageError
from printctl.pipeline.artefacts import HTML, LUMEN, NETWORK, PDF, SOLID
from printctl.recipe.record import RecordPart
from registration import RegistrationOptions, register_scan
from registration.corrected import corrected_scan
from registration.walls_file import read_walls

REGISTERING: Final = "printctl.pipeline.registering"
"""What draws and writes."""


def register(
    scan: ScanFile,
    model: Annotated[
        Path,
        typer.Option("--model", help="A run folder, or the design's STL.", show_default=False),
    ],
    out: Annotated[Path, typer.Option("--out", help="Folder for the files.", show_default=False)],
    network: Annotated[
        Path | None,
        typer.Option("--network", help="network.csv in mm; else the one beside the model."),
    ] = None,
    lumens: Annotated[
        bool,
        typer.Option("--lumens", help="With a run folder: only its lumens were scanned."),
    ] = False,
    unit: Annotated[LengthUnit, typer.Option("--unit", help="Unit of an STL model.")] = "mm",
    voxel_um: VoxelUm = None,
    refractive_index: RefractiveIndex = None,
    optical_depth: OpticalDepth = None,
    modality: Modality = None,
    scale: Scale = None,
    axes: Axes = None,
    depth_down: DepthDown = None,
    mirrored: Mirrored = None,
    db_range: DbRange = None,
    count_range: CountRange = None,
    counts_per_db: CountsPerDb = None,
    db_at_zero: DbAtZero = None,
    oct_calibration: OctCalibrationFile = None,
    air_above: AirAbove = False,
    walls: WallsFile = None,
    filled: Filled = False,
    printed_in: Annotated[
        Path | None,
        typer.Option(
            "--print", help="The print that was scanned: its folder or file; else the run's own."
        ),
    ] = None,
    record: Annotated[
        Path | None,
        typer.Option(
            "--record",
            help="YAML file of the measurement record: instrument, certificate, operator, "
            "temperature (docs/registration.md).",
        ),
    ] = None,
    tolerance: Annotated[
        Path | None,
        typer.Option(
            "--tolerance",
            help="YAML file of limits by vessel and feature (docs/registration.md).",
        ),
    ] = None,
    tolerance_um: Annotated[
        float | None,
        typer.Option(
            "--tolerance-um",
            help="RMS deviation of the scaled fit above which the print doesn't pass; else 100.",
            min=0.1,
        ),
    ] = None,
    diameter_tolerance_percent: Annotated[
        str | None,
        typer.Option(
            "--diameter-tolerance-percent",
            help="Error of any section's diameter beyond which it doesn't, like 10 or +10/-5; "
            "else 10.",
        ),
    ] = None,
    progress_file: ProgressFileOption = None,
    pdf: PdfFlag = False,
    as_json: JsonFlag = False,
) -> None:
    """Align a scan with its design and report the deviation, vessel by vessel.

    Exit code 1 when the print doesn't pass: a fail, or undecided.
    """
    steps = Steps(progress_file, out, ("reading", "registration", "writing"))
    with steps.whole():
        steps.begin("reading")
        surface, path = _design(model, network, lumens, unit)
        stated = RecordPart() if record is None else read_record(record)
        limits = tolerances_of(tolerance, tolerance_um, diameter_tolerance_percent)
        vessels, printed = read_network_csv(path, unit="mm"), _printed(model, printed_in)
        options = RegistrationOptions(
            lumens="bright" if filled else "dark",
            walls=None if walls is None else read_walls(walls),
        )
        counts = said_of_counts(db_range, count_range, counts_per_db, db_at_zero)
        said = said_of_scan(
            voxel_um,
            refractive_index,
            optical_depth,
            modality,
            scale,
            axes,
            depth_down,
            mirrored,
            counts,
        )
        drawn = call_ahead(REGISTERING, "network_drawing", vessels)
        measured = corrected_scan(scan, said, oct_calibration, air_above)
        for note in measured.notes:
            messages().print(f"note: {note}", markup=False)
        steps.begin("registration")
        found = register_scan(measured, surface, vessels, options)
        # Imported only now: what draws and packs loads while kernels search the scan.
        from printctl.pipeline.measurement_record import Corrections
        from printctl.pipeline.registering import Registered

        made = Registered(scan, measured, model, surface, path, vessels, found, printed)
        data = made.judged(limits)
        done = Corrections(_text(oct_calibration), air_above, _text(walls))
        made.add_record(data, stated, done, datetime.now(UTC))
        steps.begin("writing")
        for note in made.write(out, data, pdf, drawn.result()):
            messages().print(f"note: {note}", markup=False)
    if as_json:
        print_json(data)
    else:
        files = [str(out / HTML), *([str(out / PDF)] if pdf else [])]
        print_lines(*data["verdict"]["reasons"], *files)
    if not data["verdict"]["passed"]:
        raise typer.Exit(1)


def _text(path: Path | None) -> str | None:
    return None if path is None else str(path)


def _design(
    model: Path, network: Path | None, lumens: bool, unit: LengthUnit
) -> tuple[Solid, Path]:
    """Surface of the design in mm, and where its network is."""
    if model.is_dir():
        surface = read_solid(model / (LUMEN if lumens else SOLID), unit="mm")
        beside = model / NETWORK
    elif model.is_file():
        surface = read_solid(model, unit=unit)
        beside = model.with_name(NETWORK)
    else:
        raise UsageError(f"--model {model} doesn't exist; give a run folder or an STL file")
    path = network if network is not None else beside
    if not path.is_file():
        raise UsageError(f"no network at {path}; give --network network.csv for the vessel table")
    return surface, path


def _printed(model: Path, named: Path | None) -> dict[str, Any] | None:
    """Which print was scanned, as far as a journal tells it."""
    if named is None and not model.is_dir():
        return None
    # Only prints have journals; a lone STL doesn't wait for the link's modules.
    from printctl.cli.run_folder import print_folder
    from printctl.link.print_identity import print_identity

    found = print_identity(print_folder(named or model))
    if found is None and named is not None:
        raise UsageError(
            f"--print {named} has no journal of a print; give the print's folder, its run's, or "
            "its G-code file"
        )
    return found
