"""`printctl calibrate backlash`: write an axis test, or fit backlash and scale from readings."""

from __future__ import annotations

from typing import Annotated

import typer

from firmware_profiles import Printer, Syringe, load
from printctl.calibration import backlash_path
from printctl.calibration.paths import Axis
from printctl.calibration.results import backlash_result
from printctl.cli.calibrate_files import Job, write_test
from printctl.cli.calibrate_options import (
    At,
    Csv,
    Gcode,
    numbers_of,
    print_estimates,
    read_csv_argument,
)
from printctl.cli.options import JsonFlag, PrinterOption, SyringeOption, three_numbers
from printctl.errors import UsageError


def backlash(
    readings: Csv = None,
    printer: PrinterOption = "generic_marlin",
    syringe: SyringeOption = "hamilton_1ml",
    axis: Annotated[str, typer.Option("--axis", help="x, y, z or e.")] = "x",
    targets: Annotated[str, typer.Option("--targets", help="From the tip's place, mm.")] = (
        "2,4,6,8,10"
    ),
    overshoot: Annotated[float, typer.Option("--overshoot", help="mm", min=0.01)] = 1.0,
    speed: Annotated[float, typer.Option("--speed", help="mm/s", min=0.01)] = 2.0,
    wait: Annotated[float, typer.Option("--wait", help="To read the dial, s.", min=0)] = 8.0,
    at: At = "100,100,50",
    gcode: Gcode = None,
    as_json: JsonFlag = False,
) -> None:
    """Lost motion of an axis: CSV with target_mm, approach (1 or -1) and measured_mm.

    With --gcode it writes the G-code of the test, which comes to each place from both sides.
    """
    if gcode is not None:
        machine, filled = load(Printer, printer), load(Syringe, syringe)
        path, places, sides = backlash_path(
            _axis(axis),
            numbers_of(targets, "--targets"),
            overshoot_mm=overshoot,
            speed_mm_s=speed,
            wait_s=wait,
            syringe=filled,
        )
        rows = [[f"{p:g}", f"{s:g}", ""] for p, s in zip(places, sides, strict=True)]
        job = Job(gcode, path, machine, filled, three_numbers(at, "--at"))
        write_test(job, ("target_mm", "approach", "measured_mm"), rows, {})
        return
    data = read_csv_argument(readings, ("target_mm", "approach", "measured_mm"))
    result = backlash_result(data)
    print_estimates(result.lines, list(result.notes), as_json)


def _axis(text: str) -> Axis:
    for axis in ("x", "y", "z", "e"):
        if text == axis:
            return axis
    raise UsageError(f"--axis {text!r} is none of x, y, z, e")
