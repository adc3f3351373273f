"""`printctl register`: compare a scan with its design or its print; options and entry."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from design.units import LengthUnit
from printctl.cli import options as cli
from printctl.cli.declare import json_command
from printctl.cli.judge.scan import ScanFile, ScanOptions
from printctl.cli.kernels_ready import have_kernels
from printctl.history.table import HEADLINES, outcome
from printctl.pipeline.running.lock import run_lock
from printctl.processes.garbage_collection import collected_rarely
from printctl.processes.second import SecondProcess
from printctl.progress_file import ProgressFile
from printctl.recipe.sections.measuring import RegistrationPart
from printctl.recipe.sections.record import RecordPart
from printctl.run_folder.artefacts import HTML, PDF
from printctl.settings import of, opt
from registration.measuring.judging.tolerance import DecisionRule

PAGES: Final = "printctl.pipeline.judging.registration_pages"
"""What draws, in the second process; loading it takes seconds, as the search for the pose does."""
_STEPS: Final = ("reading", "registration", "writing")


@contextmanager
def _told_steps(path: Path | None, folder: Path) -> Iterator[Callable[[str], None]]:
    """Give what begins a step, told to a --progress-file; the folder is locked meanwhile."""
    if path is None:
        yield lambda name: None
        return
    progress, begun = ProgressFile(path), list[str]()

    def begin(name: str) -> None:
        if begun:
            progress.done(begun[-1], "")
        begun.append(name)
        progress.stage(name, 0.0)

    with progress.whole(cli.message_of), run_lock(folder):
        progress.begin(_STEPS, _STEPS[-1])
        yield begin
        progress.done(begun[-1], "")


@json_command
def register(
    *,
    scan: ScanFile,
    model: Path = opt("A run folder, or the design's STL.", ...),
    out: cli.OutFolder,
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
        "Datum features, primary first, like 'face -z, face -x, axis 3'; also 'inlet 0', "
        "'outlet 3', 'ports'; else best fit."
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
    tolerance_um: float | None = of(RegistrationPart, "tolerance_um", default=None, min=0.1),
    diameter_tolerance_percent: str | None = of(
        RegistrationPart, "diameter_tolerance_percent", default=None
    ),
    decision_rule: DecisionRule | None = of(RegistrationPart, "decision_rule", default=None),
    conformance_percent: float | None = of(RegistrationPart, "conformance_percent", default=None),
    progress_file: cli.ProgressFileOption = None,
    pdf: cli.PdfFlag = False,
) -> None:
    """Align a scan with its design and report the deviation, vessel by vessel.

    Exit code 1 when the print doesn't pass: a fail, or undecided.
    """
    # Of matrices so small a second thread would do nothing but spin; numpy reads this once.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

    have_kernels("register")
    with (
        collected_rarely(),
        SecondProcess(PAGES) as second,
        _told_steps(progress_file, out) as begin,
    ):
        begin("reading")
        # Help waits for no mesh library; the second process loads beside this one.
        from printctl.pipeline.judging import registration_work as work
        from printctl.recipe import section_files

        design = work.read_design(model, network, lumens, unit, printed_in, out, cli.print_note)
        drawn = second.call(PAGES, "network_drawing", design.vessels)
        stated = RecordPart() if record is None else section_files.read_record(record)
        percent, rule = diameter_tolerance_percent, decision_rule
        limits = section_files.tolerances_of(
            tolerance, tolerance_um, percent, rule, conformance_percent
        )
        limits.check_network(design.vessels)
        how = work.Measuring(
            scan,
            scan_said.overrides(),
            scan_said.oct_calibration,
            scan_said.walls,
            scan_said.air_above,
            scan_said.filled,
            work.datums_of(datums, design.vessels),
        )
        measured = how.read()
        cli.print_notes(measured.notes)
        begin("registration")
        made = how.register(measured, design)
        data = work.judge_registration(made, how, limits, stated)
        begin("writing")
        cli.print_notes(made.write(out, data, pdf, second, drawn))
    files = [str(out / HTML), *([str(out / PDF)] if pdf else [])]
    verdict = data["verdict"]
    said = [HEADLINES[outcome(verdict)], *verdict["reasons"], *files]
    cli.print_result(data, said, verdict["passed"])
