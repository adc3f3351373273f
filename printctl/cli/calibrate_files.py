"""Write the files of `printctl calibrate` (test, CSV, corrected profile) and print their names."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from firmware_profiles import Facts
from printctl.calibration import Estimate
from printctl.calibration.writing import Job, MeasuredValue, make_test, measured_key, save_measured
from printctl.cli.options import messages, print_lines

__all__ = ["Job", "MeasuredValue", "write_changed", "write_measured", "write_mended", "write_test"]


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
