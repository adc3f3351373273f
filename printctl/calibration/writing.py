"""Write a calibration's files: test G-code, CSV sheet to fill in, corrected profile."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

import yaml

from design.files import write_bytes, write_text
from design.toolpath.gcode import GcodeOptions, write_gcode
from firmware_profiles import Facts, Printer, Syringe
from printctl.calibration.estimate import Estimate
from printctl.calibration.paths import CalibrationTest
from printctl.checks.made_for import header_lines, made_for, named
from printctl.checks.preflight import gcode_checks, refuse_failed, syringe_checks, warnings
from printctl.errors import UsageError
from sim.gcode.dry_run.run import dry_run


@dataclass(frozen=True)
class Job:
    """A test: where it goes, what it does, on what, from where.

    ``flow_factor`` is the ink's, where the test writes with it as a print does.
    """

    path: Path
    test: CalibrationTest
    printer: Printer
    syringe: Syringe
    at_mm: tuple[float, float, float]
    flow_factor: float = 1.0

    @property
    def sheet(self) -> Path:
        """The CSV file to fill in."""
        return self.path.with_suffix(".csv")


@dataclass(frozen=True)
class CalibrationOutput:
    """What was written of a test.

    Attributes
    ----------
    lines : int
        Of G-code.
    duration_s : float
    notes : tuple of str
        What the checks warn of.
    """

    lines: int
    duration_s: float
    notes: tuple[str, ...]


def make_test(job: Job) -> CalibrationOutput:
    """Write the G-code and the CSV file beside it, after the same checks as a print's.

    Raises
    ------
    SafetyError
        When a check refuses it.
    UsageError
        When it needs a plunger, and there is none.
    """
    test = job.test
    # Doses are the one test that a pneumatic head's valve opens for.
    if job.printer.pneumatic and test.columns[0] != "open_s" and test.toolpath.volume_ul.any():
        raise UsageError(
            f"{job.printer.name} has a pneumatic head, and this test drives a plunger; weigh its "
            "flow instead: printctl calibrate weigh"
        )
    # A pneumatic head's flow is what will be weighed; its doses are times, so any will do here.
    flow = 1.0 if job.printer.pneumatic else None
    options = GcodeOptions(
        start_mm=job.at_mm,
        relieve_ul=0.0,
        flow_factor=job.flow_factor,
        flow_ul_s=flow,
        standing_doses=flow is not None,
        header=header_lines({**made_for(job.printer, []), "syringe": (named(job.syringe),)}),
    )
    gcode = write_gcode(test.toolpath, job.printer, job.syringe, job.at_mm, options)
    run = dry_run(gcode.data, job.printer, job.at_mm)
    checks = [*gcode_checks(run, job.printer), *syringe_checks(run, job.printer, job.syringe)]
    refuse_failed(checks)
    write_bytes(job.path, gcode.data)
    table = io.StringIO()
    table.writelines(f"# {key}={value:g}\n" for key, value in test.facts.items())
    rows = [test.columns, *([*row, ""] for row in test.rows)]
    csv.writer(table, lineterminator="\n").writerows(rows)
    write_text(job.sheet, table.getvalue())
    return CalibrationOutput(gcode.line_count, run.duration_s, tuple(warnings(checks)))


@dataclass(frozen=True)
class MeasuredValue:
    """What a key gets: its value, and what its source is to say of it."""

    value: Any
    said: str


def measured_key(facts: Facts, key: str, estimate: Estimate) -> dict[str, MeasuredValue]:
    """One key with its estimate; a part of a group (``steps_per_mm.e``) keeps the others."""
    name, _, part = key.partition(".")
    value: Any = estimate.value
    if part:
        value = {**getattr(facts, name).model_dump(mode="json"), part: value}
    return {key: MeasuredValue(value, f"{estimate.text()}, 95 %")}


def save_measured(path: Path, facts: Facts, measured: Mapping[str, MeasuredValue]) -> str:
    """Write a copy of a profile with keys changed for what was measured; its source says so.

    Returns
    -------
    str
        What was changed.
    """
    data = facts.model_dump(mode="json", exclude_unset=True)
    for key, one in measured.items():
        data[key.partition(".")[0]] = one.value
    left = [other for other in facts.starting_values if other not in measured]
    if left:
        data["starting_values"] = left
    else:
        data.pop("starting_values", None)
    text = "; ".join(f"{key} {one.said}" for key, one in measured.items())
    numbers = text if len(measured) > 1 else next(iter(measured.values())).said
    data["source"] = (
        f"{facts.source} {', '.join(measured)} measured by printctl calibrate, "
        f"{date.today().isoformat()}: {numbers}."
    )
    type(facts).model_validate(data)
    write_text(path, yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=100))
    return text
