"""Options of `printctl calibrate`, and the files that its subcommands write."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from firmware_profiles import Facts
from printctl.calibration import Estimate, Readings, read_readings
from printctl.calibration.writing import Job, MeasuredValue, make_test, measured_key, save_measured
from printctl.cli.options import messages, print_json, print_lines
from printctl.errors import UsageError
from printctl.settings import arg, opt

Csv = Annotated[Path | None, arg("Readings to fit, a CSV file.")]
Gcode = Annotated[Path | None, opt("Write the test's G-code here, and a CSV to fill in beside it.")]
At = Annotated[str, opt("Where the tip stands, printer's frame, mm.", metavar="X,Y,Z")]
Write = Annotated[Path | None, opt("Write a profile with the result to this file.")]


def numbers_of(text: str, option: str) -> list[float]:
    """Read ``1,2,3``.

    Raises
    ------
    UsageError
        When one isn't a number.
    """
    try:
        return [float(word) for word in text.split(",")]
    except ValueError as exc:
        raise UsageError(f"{option} {text!r} isn't a list of numbers; write it like 2,4,6") from exc


def read_csv_argument(
    path: Path | None, numbers: tuple[str, ...], words: tuple[str, ...] = ()
) -> Readings:
    """Read the file that must be there when no test is to be written."""
    if path is None:
        raise UsageError(
            f"give a CSV file with the columns {', '.join((*words, *numbers))}; where there is a "
            "test, --gcode FILE writes it and the file to fill in"
        )
    return read_readings(path, numbers, words)


def print_estimates(lines: dict[str, Estimate], notes: list[str], as_json: bool) -> None:
    """Numbers with their 95 % intervals, then what they mean."""
    if as_json:
        values: dict[str, Any] = {
            name: {"value": e.value, "low": e.low, "high": e.high, "unit": e.unit}
            for name, e in lines.items()
        }
        print_json({"estimates": values, "level": 0.95, "notes": notes})
        return
    print_lines(*(f"{name:<40} {estimate.text()}" for name, estimate in lines.items()))
    print_lines("(95 % intervals)", *notes)


# Write the files of `printctl calibrate` (test, CSV, corrected profile) and print their names.


def write_test(
    job: Job, columns: tuple[str, ...], rows: list[list[str]], facts: dict[str, float]
) -> None:
    """Write the G-code and the CSV file beside it, and say what to do with them; see `make_test`.

    Raises
    ------
    SafetyError, UsageError
    """
    made = make_test(job, columns, rows, facts)
    for text in made.notes:
        messages().print(f"note: {text}", markup=False)
    start = ",".join(f"{value:g}" for value in job.at_mm)
    print_lines(
        f"{job.path}: {made.lines} lines, {made.duration_s:.0f} s; put the tip to {start} "
        f"and print it with --start {start}",
        f"{job.sheet}: fill in the last column ({columns[-1]}), then give it to the same command",
    )


def write_mended(path: Path, facts: Facts, key: str, estimate: Estimate) -> None:
    """Write a copy of a profile with one key measured; its source says so."""
    write_measured(path, facts, measured_key(facts, key, estimate))


def write_changed(path: Path, facts: Facts, key: str, value: Any, estimate: Estimate) -> None:
    """Write a copy of a profile with one key's value changed for what was measured."""
    write_measured(path, facts, {key: MeasuredValue(value, f"{estimate.text()}, 95 %")})


def write_measured(path: Path, facts: Facts, measured: Mapping[str, MeasuredValue]) -> None:
    """Write a copy of a profile with keys changed for what was measured; its source says so."""
    messages().print(f"wrote {path}: {save_measured(path, facts, measured)}", markup=False)
