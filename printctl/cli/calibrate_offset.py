"""`printctl calibrate offset`: fit the offset between two needle tips to touch-off readings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from firmware_profiles import Printer, load
from printctl.calibration import Estimate, fit_offset
from printctl.calibration.results import offset_result, split_touches
from printctl.cli.calibrate_files import MeasuredValue, write_measured
from printctl.cli.calibrate_options import Csv, Write, print_estimates, read_csv_argument
from printctl.cli.options import JsonFlag
from printctl.errors import UsageError


def offset(
    readings: Csv = None,
    printer: Annotated[
        str | None,
        typer.Option("--printer", help="Profile of a printer with several heads, all lowered."),
    ] = None,
    head: Annotated[
        int, typer.Option("--head", help="Whose needle is the second of the two.", min=1)
    ] = 1,
    write: Write = None,
    as_json: JsonFlag = False,
) -> None:
    """Offset of a needle: CSV with needle (two names), x_mm, y_mm and z_mm of touch-offs.

    With --printer it is the offset of a head: the needle of the first row is the first head's, the
    other --head's, and both touched the same mark. --write writes the profile with it.
    """
    if write is not None and printer is None:
        raise UsageError("--write needs the profile that is to be mended; give --printer")
    data = read_csv_argument(readings, ("x_mm", "y_mm", "z_mm"), ("needle",))
    if printer is not None:
        _, (first, second) = split_touches(data)
        last_digit = max(data.last_digit.values())
        # The carriage stands so much less far as the tip stands out: the other way round.
        _of_head(
            load(Printer, printer), head, fit_offset(second, first, last_digit), write, as_json
        )
        return
    result = offset_result(data)
    print_estimates(result.lines, list(result.notes), as_json)


def _of_head(
    printer: Printer,
    number: int,
    estimates: tuple[Estimate, Estimate, Estimate],
    write: Path | None,
    as_json: bool,
) -> None:
    """Tell the offset of a head, and write it into a profile."""
    if number >= printer.head_count or not printer.heads:
        raise UsageError(
            f"{printer.name} has no head {number} (heads); name its heads in the profile first"
        )
    lines = {
        f"heads.{number}.offset_mm.{axis}": one for axis, one in zip("xyz", estimates, strict=True)
    }
    notes = ["touch off again after every change of a needle: it stands elsewhere then"]
    print_estimates(lines, notes, as_json)
    if write is None:
        return
    heads: list[dict[str, Any]] = [
        head.model_dump(mode="json", exclude_unset=True) for head in printer.heads
    ]
    heads[number]["offset_mm"] = {
        axis: round(one.value, 4) for axis, one in zip("xyz", estimates, strict=True)
    }
    told = ", ".join(f"{axis} {one.text()}" for axis, one in zip("xyz", estimates, strict=True))
    measured = MeasuredValue(heads, f"{told}, 95 %")
    write_measured(write, printer, {f"heads.{number}.offset_mm": measured})
