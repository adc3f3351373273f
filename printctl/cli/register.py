"""`printctl register`: hold a scan against a design."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import typer

from printctl.ahead import SecondProcess
from printctl.cli.options import JsonFlag, messages, print_json, print_lines
from printctl.cli.pdf_option import PdfFlag
from printctl.cli.progress_option import ProgressFileOption, Steps
from printctl.cli.record_option import read_record
from printctl.cli.register_design import DesignRead, read_design
from printctl.cli.register_options import (
    DatumsOption,
    DiameterOption,
    LumensFlag,
    ModelOption,
    ModelUnit,
    NetworkOption,
    OutOption,
    PrintOption,
    RecordOption,
    RmsOption,
    ToleranceOption,
)
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
from printctl.pipeline.artefacts import HTML, PDF
from printctl.recipe.record import RecordPart
from registration import RegistrationOptions, ScanOverrides, register_scan
from registration.corrected import corrected_scan
from registration.geometry import Datum, read_datums
from registration.judging import Tolerances
from registration.walls_file import read_walls

if TYPE_CHECKING:
    from printctl.pipeline.registering import Registered

PAGES: Final = "printctl.pipeline.registration_pages"
"""What draws, in the second process; loading it takes seconds, as the search for the pose does."""


@dataclass(frozen=True)
class _Measuring:
    """How a scan is read and measured.

    Attributes
    ----------
    scan : Path
    said : ScanOverrides
        What its file doesn't say.
    optics, walls : Path or None
        Files of calibrations.
    air_above : bool
    filled : bool
        Lumens are brighter than the gel.
    datums : tuple of Datum
        None for the best fit.
    """

    scan: Path
    said: ScanOverrides
    optics: Path | None
    walls: Path | None
    air_above: bool
    filled: bool
    datums: tuple[Datum, ...]

    @property
    def options(self) -> RegistrationOptions:
        """As the registration takes them."""
        walls = None if self.walls is None else read_walls(self.walls)
        return RegistrationOptions(
            lumens="bright" if self.filled else "dark", walls=walls, datums=self.datums
        )


def register(
    scan: ScanFile,
    model: ModelOption,
    out: OutOption,
    network: NetworkOption = None,
    lumens: LumensFlag = False,
    unit: ModelUnit = "mm",
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
    datums: DatumsOption = None,
    printed_in: PrintOption = None,
    record: RecordOption = None,
    tolerance: ToleranceOption = None,
    tolerance_um: RmsOption = None,
    diameter_tolerance_percent: DiameterOption = None,
    progress_file: ProgressFileOption = None,
    pdf: PdfFlag = False,
    as_json: JsonFlag = False,
) -> None:
    """Align a scan with its design and report the deviation, vessel by vessel.

    Exit code 1 when the print doesn't pass: a fail, or undecided.
    """
    steps = Steps(progress_file, out, ("reading", "registration", "writing"))
    with SecondProcess() as second, steps.whole():
        steps.begin("reading")
        design = read_design(model, network, lumens, unit, printed_in)
        drawn = second.call(PAGES, "network_drawing", design.vessels)
        stated = RecordPart() if record is None else read_record(record)
        limits = tolerances_of(tolerance, tolerance_um, diameter_tolerance_percent)
        counts = said_of_counts(db_range, count_range, counts_per_db, db_at_zero)
        said = said_of_scan(voxel_um, refractive_index, optical_depth, modality, scale, axes,
                            depth_down, mirrored, counts)  # fmt: skip
        laid_on = read_datums((datums or "").split(","))
        how = _Measuring(scan, said, oct_calibration, walls, air_above, filled, laid_on)
        made = _registered(how, design, steps)
        data = _judged(made, how, limits, stated)
        steps.begin("writing")
        _note(made.write(out, data, pdf, second, drawn))
    _tell(data, out, pdf, as_json)
    if not data["verdict"]["passed"]:
        raise typer.Exit(1)


def _registered(how: _Measuring, design: DesignRead, steps: Steps) -> Registered:
    """Read the scan and register it."""
    options = how.options
    measured = corrected_scan(how.scan, how.said, how.optics, how.air_above, True)
    _note(measured.notes)
    steps.begin("registration")
    found = register_scan(measured, design.surface, design.vessels, options)
    # Imported only now: what draws and packs loads while kernels search the scan.
    from printctl.pipeline.registering import Registered

    return Registered(how.scan, measured, design.model, design.surface, design.network,
                      design.vessels, found, design.printed)  # fmt: skip


def _judged(
    made: Registered, how: _Measuring, limits: Tolerances, stated: RecordPart
) -> dict[str, Any]:
    """Numbers and verdict, with the measurement record."""
    from printctl.pipeline.measurement_record import Corrections

    data = made.judged(limits)
    done = Corrections(_text(how.optics), how.air_above, _text(how.walls))
    made.add_record(data, stated, done, datetime.now(UTC))
    return data


def _note(notes: list[str] | tuple[str, ...]) -> None:
    for note in notes:
        messages().print(f"note: {note}", markup=False)


def _tell(data: dict[str, Any], out: Path, pdf: bool, as_json: bool) -> None:
    if as_json:
        print_json(data)
        return
    files = [str(out / HTML), *([str(out / PDF)] if pdf else [])]
    print_lines(*data["verdict"]["reasons"], *files)


def _text(path: Path | None) -> str | None:
    return None if path is None else str(path)
