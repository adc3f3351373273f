"""Options, CSV reading and result printing shared by subcommands of `printctl calibrate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from printctl.calibration import Estimate, Readings, read_readings
from printctl.cli.options import print_json, print_lines
from printctl.errors import UsageError

Csv = Annotated[Path | None, typer.Argument(help="Readings to fit, a CSV file.")]
Gcode = Annotated[
    Path | None,
    typer.Option("--gcode", help="Write the test's G-code here, and a CSV to fill in beside it."),
]
At = Annotated[
    str, typer.Option("--at", metavar="X,Y,Z", help="Where the tip stands, printer's frame, mm.")
]
CameraFile = Annotated[
    Path | None,
    typer.Option("--camera", help="File of `printctl calibrate camera`: scale and distortion."),
]
Write = Annotated[
    Path | None, typer.Option("--write", help="Write a profile with the result to this file.")
]


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
