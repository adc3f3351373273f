"""Write a calibration's files: test G-code, CSV sheet to fill in, corrected profile."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any, Final

import yaml

from design.files import write_bytes, write_text
from design.toolpath.gcode import GcodeOptions, write_gcode
from firmware_profiles import Facts, Ink, Needle, Printer, ProfileError, Syringe, load
from gcode.dry_run.run import dry_run
from printctl.calibration.estimate import Estimate
from printctl.calibration.paths import CalibrationTest
from printctl.checks.made_for import MadeFor, header_lines, made_for, named, profile_hash
from printctl.checks.preflight import gcode_checks, refuse_failed, syringe_checks, warnings
from printctl.errors import SafetyError, UsageError


@dataclass(frozen=True)
class Job:
    """A test: where it goes, what it does, on what, from where.

    ``flow_factor`` is the ink's, where the test writes with it as a print does. Ink and needle are
    None where the test holds for any.
    """

    path: Path
    test: CalibrationTest
    printer: Printer
    syringe: Syringe
    at_mm: tuple[float, float, float]
    flow_factor: float = 1.0
    ink: Ink | None = None
    needle: Needle | None = None

    @property
    def sheet(self) -> Path:
        """The CSV file to fill in."""
        return self.path.with_suffix(".csv")

    @property
    def record(self) -> MadeFor:
        """Set-up that the test is for."""
        return record_of_test(self.printer, self.syringe, self.ink, self.needle)


def record_of_test(
    printer: Printer, syringe: Syringe | None, ink: Ink | None = None, needle: Needle | None = None
) -> MadeFor:
    """Return the record of a test that holds for these parts."""
    parts = {"syringe": syringe, "needle": needle, "ink": ink}
    rest = {part: (named(one),) for part, one in parts.items() if one is not None}
    return {**made_for(printer, []), **rest}


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
        header=header_lines(job.record),
    )
    gcode = write_gcode(test.toolpath, job.printer, job.syringe, job.at_mm, options)
    run = dry_run(gcode.data, job.printer, job.at_mm)
    checks = [*gcode_checks(run, job.printer), *syringe_checks(run, job.printer, job.syringe)]
    refuse_failed(checks)
    write_bytes(job.path, gcode.data)
    table = io.StringIO()
    table.writelines(f"# {line}\n" for line in header_lines(job.record))
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


MAX_CHANGE: Final = 0.2
"""Of a constant, by which no calibration moves it unasked: another syringe moves it by more."""


def save_measured(
    path: Path,
    facts: Facts,
    measured: Mapping[str, MeasuredValue],
    *,
    accept_change: bool = False,
) -> str:
    """Write a copy of a profile with keys changed for what was measured; its source says so.

    Returns
    -------
    str
        What was changed.

    Raises
    ------
    SafetyError
        Where ``path`` is another profile than the one that was measured, or a constant changes by
        more than `MAX_CHANGE` and that isn't accepted.
    """
    _refuse_other_profile(path, facts)
    if not accept_change:
        _refuse_large_change(facts, measured)
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


def _refuse_other_profile(path: Path, facts: Facts) -> None:
    if not path.exists():
        return
    kind = type(facts).__name__.lower()
    try:
        there = load(type(facts), str(path))
    except ProfileError as exc:
        raise UsageError(f"{path} exists and is no {kind} profile ({exc}); name another") from exc
    if profile_hash(there) != profile_hash(facts):
        raise SafetyError(
            f"{path} is {there.name!r} with other values than the {kind} that was measured "
            f"({facts.name!r}), and nothing was written; name {path} for the measurement (--{kind} "
            f"{path}), or give a new file"
        )


def _refuse_large_change(facts: Facts, measured: Mapping[str, MeasuredValue]) -> None:
    before = facts.model_dump(mode="json")
    names = ((key.partition(".")[0], one.value) for key, one in measured.items())
    large = [
        f"{name} would change from {old:.6g} to {new:.6g} ({new / old - 1:+.0%}), limit "
        f"{MAX_CHANGE:.0%}"
        for key, value in names
        for name, old, new in _changes(key, before.get(key), value)
        if abs(new / old - 1) > MAX_CHANGE
    ]
    if large:
        raise SafetyError(
            f"{facts.name}: {'; '.join(large)}. Likely cause: the test was made with another "
            "syringe, needle or ink than the one named, or the sheet has values in another unit. "
            "Nothing was written; check that, or accept the change (--accept-change)"
        )


def _changes(name: str, old: object, new: object) -> Iterator[tuple[str, float, float]]:
    """Yield name, old and new value of each number in a key; none of another needle's or ink's."""
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        if all(old.get(key) == one for key, one in new.items() if isinstance(one, str)):
            for key, one in new.items():
                yield from _changes(f"{name}.{key}", old.get(key), one)
    elif isinstance(old, (int, float)) and isinstance(new, (int, float)) and old:
        yield name, float(old), float(new)
