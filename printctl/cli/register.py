"""`printctl register`: hold a scan against a design."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from design.files import write_text
from design.network import VesselNetwork
from design.network_csv import read_network_csv
from design.solids import Solid, read_solid
from design.units import LengthUnit
from printctl.cli.options import JsonFlag, messages, print_json, print_lines
from printctl.cli.pdf_option import PdfFlag
from printctl.cli.run_folder import print_folder
from printctl.cli.scan_options import (
    AirAbove,
    Axes,
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
    said_of_scan,
)
from printctl.errors import UsageError
from printctl.feedback import ORIGIN, keep_origin
from printctl.link.print_identity import print_identity
from printctl.pipeline.context import LUMEN, NETWORK, SOLID
from printctl.pipeline.deviation_surfaces import split_surfaces
from printctl.pipeline.facts import scan_origin
from printctl.pipeline.stages.registration import (
    DEVIATION,
    NUMBERS,
    SIGN,
    design_facts,
    load_deviation,
    scan_facts,
    write_deviation,
    write_exports,
)
from printctl.pipeline.stages.report import HTML, PDF
from printctl.pipeline.verdict import verdict
from registration import (
    RegistrationOptions,
    RegistrationReport,
    register_scan,
    report_dict,
)
from registration.corrected import corrected_scan
from registration.report import ReportSurface, write_report_html
from registration.report.pdf import write_report_pdf
from registration.walls_file import read_walls


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
    oct_calibration: OctCalibrationFile = None,
    air_above: AirAbove = False,
    walls: Annotated[
        Path | None, typer.Option("--walls", help="File of `printctl calibrate walls`.")
    ] = None,
    filled: Filled = False,
    printed_in: Annotated[
        Path | None,
        typer.Option(
            "--print", help="The print that was scanned: its folder or file; else the run's own."
        ),
    ] = None,
    tolerance_um: Annotated[float, typer.Option("--tolerance-um", min=0.1)] = 100.0,
    diameter_tolerance_percent: Annotated[
        float, typer.Option("--diameter-tolerance-percent", min=0.1)
    ] = 10.0,
    pdf: PdfFlag = False,
    as_json: JsonFlag = False,
) -> None:
    """Align a scan with its design and report the deviation, vessel by vessel.

    Exit code 1 when the print doesn't pass.
    """
    surface, path = _design(model, network, lumens, unit)
    vessels, printed = read_network_csv(path, unit="mm"), _printed(model, printed_in)
    options = RegistrationOptions(
        lumens="bright" if filled else "dark", walls=None if walls is None else read_walls(walls)
    )
    said = said_of_scan(
        voxel_um, refractive_index, optical_depth, modality, scale, axes, depth_down, mirrored
    )
    measured = corrected_scan(scan, said, oct_calibration, air_above)
    for note in measured.notes:
        messages().print(f"note: {note}", markup=False)
    found = register_scan(measured, surface, vessels, options)
    numbers = {
        **report_dict(found),
        "sign_convention": SIGN,
        "design": design_facts(path),
        "measured_by": scan_facts(measured),
    }
    data: dict[str, Any] = {
        "schema": 1,
        "recipe": scan.stem,
        "verdict": verdict(numbers, tolerance_um, diameter_tolerance_percent),
        "scan": {"source": str(scan)},
        "printed": printed,
        "registration": numbers,
    }
    _write(out, data | _origin(model, scan, out), found, surface, vessels)
    if pdf:
        write_report_pdf(out / PDF, {**data, "provenance": scan_origin(scan, path)}, vessels)
    write_exports(out, measured, vessels, found)
    if as_json:
        print_json(data)
    else:
        made = [str(out / HTML), *([str(out / PDF)] if pdf else [])]
        print_lines(*data["verdict"]["reasons"], *made)
    if not data["verdict"]["passed"]:
        raise typer.Exit(1)


def _write(
    out: Path,
    data: dict[str, Any],
    found: RegistrationReport,
    surface: Solid,
    vessels: VesselNetwork,
) -> None:
    """Numbers, the scanned surface with its deviation, and the page."""
    out.mkdir(parents=True, exist_ok=True)
    write_text(out / NUMBERS, json.dumps(data, indent=1, allow_nan=False) + "\n")
    write_deviation(out / DEVIATION, found)
    vertices, faces, deviation_um = load_deviation(out / DEVIATION)
    shown = [
        *split_surfaces(vertices, faces, deviation_um, vessels),
        ReportSurface("As designed", surface.vertices, surface.faces),
    ]
    write_report_html(out / HTML, data, shown, vessels)


def _origin(model: Path, scan: Path, out: Path) -> dict[str, Any]:
    """How the part was made, where the model is a run; a compensation needs it."""
    found = keep_origin(model, scan, out) if model.is_dir() else None
    return {} if found is None else {ORIGIN: found}


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
    if named is None:
        return print_identity(print_folder(model)) if model.is_dir() else None
    found = print_identity(print_folder(named))
    if found is None:
        raise UsageError(
            f"--print {named} has no journal of a print; give the print's folder, its run's, or "
            "its G-code file"
        )
    return found
