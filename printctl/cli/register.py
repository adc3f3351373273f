"""`printctl register`: align a scan with its design and measure the deviations."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Final

import typer

from printctl.cli.kernels_ready import have_kernels
from printctl.cli.option_group import with_options_of
from printctl.cli.options import JsonFlag, print_json, print_lines, print_note
from printctl.cli.pdf_option import PdfFlag
from printctl.cli.progress_option import ProgressFileOption, Steps
from printctl.cli.register_options import (
    ConformanceOption,
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
    RuleOption,
    ToleranceOption,
)
from printctl.cli.scan_options import ScanFile, ScanOptions
from printctl.garbage_collection import collected_rarely
from printctl.run_folder.artefacts import HTML, PDF
from printctl.second_process import SecondProcess

PAGES: Final = "printctl.pipeline.registration_pages"
"""What draws, in the second process; loading it takes seconds, as the search for the pose does."""


@with_options_of(ScanOptions, "scan_said")
def register(
    *,
    scan: ScanFile,
    model: ModelOption,
    out: OutOption,
    network: NetworkOption = None,
    lumens: LumensFlag = None,
    unit: ModelUnit = "mm",
    scan_said: ScanOptions,
    datums: DatumsOption = None,
    printed_in: PrintOption = None,
    record: RecordOption = None,
    tolerance: ToleranceOption = None,
    tolerance_um: RmsOption = None,
    diameter_tolerance_percent: DiameterOption = None,
    decision_rule: RuleOption = None,
    conformance_percent: ConformanceOption = None,
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
        from printctl.cli.register_design import read_design  # help waits for no mesh library

        design = read_design(model, network, lumens, unit, printed_in, out, print_note)
        drawn = second.call(PAGES, "network_drawing", design.vessels)
        # Loaded only now, beside what the second process loads.
        from printctl.cli.datum_options import datums_of
        from printctl.cli.part_file import read_record
        from printctl.cli.register_work import (
            Measuring,
            judge_registration,
            note,
            read_and_register,
        )
        from printctl.cli.tolerance_options import tolerances_of
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
