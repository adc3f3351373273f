"""`printctl register`: compare a scan with its design or its print; options and entry."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Final, TypeVar

import typer
from pydantic import BaseModel, ValidationError

from design.units import LengthUnit
from printctl.cli.declare import command
from printctl.cli.kernels_ready import have_kernels
from printctl.cli.options import (
    JsonFlag,
    PdfFlag,
    ProgressFileOption,
    Steps,
    folder_to_write,
    print_json,
    print_lines,
    print_note,
)
from printctl.cli.scan import ScanFile, ScanOptions
from printctl.errors import UsageError
from printctl.garbage_collection import collected_rarely
from printctl.recipe.making import RegistrationPart
from printctl.recipe.record import RecordPart
from printctl.recipe.tolerances import TolerancesPart
from printctl.run_folder.artefacts import HTML, PDF
from printctl.second_process import SecondProcess
from printctl.settings import opt
from registration.measuring.judging.tolerance import DecisionRule, Tolerances

# Typer options of `printctl register`: design, output folder, datums, tolerances, record.


# Read and validate a YAML file with one section of a recipe, such as a measurement record.

PartT = TypeVar("PartT", bound=BaseModel)


def read_part(path: Path, part: type[PartT], what: str, remedy: str) -> PartT:
    """Read and check a file.

    Parameters
    ----------
    path : Path
    part : type
        The part's model.
    what, remedy : str
        What the file holds and how to write one, for messages.

    Raises
    ------
    RecipeError
        When it isn't there or isn't YAML.
    UsageError
        With each wrong key, its value and the remedy.
    """
    # Loads the schema of a whole recipe; without such a file nobody waits for it.
    from printctl.recipe.load import read_mapping, refusal

    data = read_mapping(path, what, remedy)
    try:
        return part.model_validate(data)
    except ValidationError as exc:
        raise UsageError(refusal(exc, str(path), list)) from exc


def read_record(path: Path) -> RecordPart:
    """Read a measurement record; see `read_part`."""
    return read_part(path, RecordPart, "record", "one line does: `operator: A. Smith`")


# Read a print's acceptance limits from command-line options: a tolerance file or single limits.

_REMEDY: Final = "one line does: `diameter_percent: 10`"


def tolerances_of(
    file: Path | None,
    rms_um: float | None,
    diameter_percent: str | None,
    decision_rule: DecisionRule | None = None,
    conformance_percent: float | None = None,
) -> Tolerances:
    """Read the limits that a print is judged by.

    Raises
    ------
    UsageError
        For a limit that can't be used, or one that is given twice.
    """
    # Loads the schema of a whole recipe; without such options nobody waits for it.
    from printctl.recipe.load import refusal

    given = {
        "tolerance_um": rms_um,
        "diameter_tolerance_percent": _number_or_text(diameter_percent),
        "decision_rule": decision_rule,
        "conformance_percent": conformance_percent,
        "tolerances": None
        if file is None
        else read_part(file, TolerancesPart, "tolerances", _REMEDY),
    }
    try:
        part = RegistrationPart.model_validate({k: v for k, v in given.items() if v is not None})
    except ValidationError as exc:
        raise UsageError(refusal(exc, "tolerances", list)) from exc
    return part.all_tolerances()


def _number_or_text(value: str | None) -> float | str | None:
    """Return a number where the text is one; `RegistrationPart` judges the rest."""
    try:
        return None if value is None else float(value)
    except ValueError:
        return value


PAGES: Final = "printctl.pipeline.registration_pages"
"""What draws, in the second process; loading it takes seconds, as the search for the pose does."""


@command
def register(
    *,
    scan: ScanFile,
    model: Path = opt("A run folder, or the design's STL.", ...),
    out: Path = opt("Folder for the files.", ..., callback=folder_to_write),
    network: Path | None = opt(
        "network.csv in mm; else the one beside the model, or the lumens found in an STL."
    ),
    lumens: bool | None = opt(
        "With a run folder: only its lumens were scanned, or the whole part. If not given, the "
        "lumens of an embedded print, the whole part of FRESH layers. With an STL and no network: "
        "the STL is the lumens.",
        None,
        "--lumens/--whole",
    ),
    unit: LengthUnit = opt("Unit of an STL model.", "mm"),
    scan_said: ScanOptions,
    datums: str | None = opt(
        "Datum features, primary first, like 'face -z, face -x, axis 3'; also 'inlet 0', 'outlet "
        "3', 'ports'; else best fit."
    ),
    printed_in: Path | None = opt(
        "The print that was scanned: its folder or file; else the run's own.", None, "--print"
    ),
    record: Path | None = opt(
        "YAML file of the measurement record: instrument, certificate, operator, temperature "
        "(docs/registration.md)."
    ),
    tolerance: Path | None = opt(
        "YAML file of limits by vessel and feature (docs/registration.md)."
    ),
    tolerance_um: float | None = opt(
        "RMS deviation of the scaled fit above which the print doesn't pass; else 100.", min=0.1
    ),
    diameter_tolerance_percent: str | None = opt(
        "Error of any section's diameter beyond which it doesn't, like 10 or +10/-5; else 10."
    ),
    decision_rule: DecisionRule | None = opt(
        "How limits count uncertainty: conformance (probability that the vessel conforms), "
        "guarded (ISO 14253-1), shared_risk (the value alone); else conformance."
    ),
    conformance_percent: float | None = opt(
        "Probability from which on a vessel passes by the rule conformance; else 95."
    ),
    progress_file: ProgressFileOption = None,
    pdf: PdfFlag = False,
    as_json: JsonFlag = False,
) -> None:
    """Align a scan with its design and report the deviation, vessel by vessel.

    Exit code 1 when the print doesn't pass: a fail, or undecided.
    """
    steps = Steps(progress_file, out, ("reading", "registration", "writing"))
    # Of matrices so small a second thread would do nothing but spin; numpy reads this once.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

    have_kernels("register")
    with collected_rarely(), SecondProcess(PAGES) as second, steps.whole():
        steps.begin("reading")
        from printctl.cli.register_work import read_design  # help waits for no mesh library

        design = read_design(model, network, lumens, unit, printed_in, out, print_note)
        drawn = second.call(PAGES, "network_drawing", design.vessels)
        # Loaded only now, beside what the second process loads.
        from printctl.cli.register_work import (
            Measuring,
            datums_of,
            judge_registration,
            note,
            read_and_register,
        )
        from printctl.recipe.record import RecordPart

        stated = RecordPart() if record is None else read_record(record)
        limits = tolerances_of(
            tolerance,
            tolerance_um,
            diameter_tolerance_percent,
            decision_rule,
            conformance_percent,
        )
        limits.check_network(design.vessels)
        laid_on = datums_of(datums, design.vessels)
        how = Measuring(
            scan,
            scan_said.overrides(),
            scan_said.oct_calibration,
            scan_said.walls,
            scan_said.air_above,
            scan_said.filled,
            laid_on,
        )
        made = read_and_register(how, design, steps)
        data = judge_registration(made, how, limits, stated)
        steps.begin("writing")
        note(made.write(out, data, pdf, second, drawn))
    _tell(data, out, pdf, as_json)
    if not data["verdict"]["passed"]:
        raise typer.Exit(1)


def _tell(data: dict[str, Any], out: Path, pdf: bool, as_json: bool) -> None:
    if as_json:
        print_json(data)
        return
    files = [str(out / HTML), *([str(out / PDF)] if pdf else [])]
    print_lines(*data["verdict"]["reasons"], *files)
