"""`printctl calibrate weigh`: write a dosing test, or fit steps per µL to weighed doses."""

from __future__ import annotations

import math
from typing import Annotated

import typer

from firmware_profiles import Ink, Needle, Printer, Syringe, load
from printctl.calibration import weighing_path
from printctl.calibration.results import weighing_of, weighing_result
from printctl.cli.calibrate_air import WeighingOptions, timed_dose_rows, weigh_flow
from printctl.cli.calibrate_files import Job, write_mended, write_test
from printctl.cli.calibrate_options import (
    At,
    Csv,
    Gcode,
    Write,
    numbers_of,
    print_estimates,
    read_csv_argument,
)
from printctl.cli.options import JsonFlag, PrinterOption, SyringeOption, three_numbers
from printctl.errors import UsageError


def weigh(
    readings: Csv = None,
    printer: PrinterOption = "generic_marlin",
    syringe: SyringeOption = "hamilton_1ml",
    density: Annotated[float, typer.Option("--density", help="Of what is weighed, g/cm³.")] = 0.998,
    density_error: Annotated[
        float, typer.Option("--density-error", help="Half of its 95 % interval, g/cm³.", min=0)
    ] = 0.001,
    mend: Annotated[
        str, typer.Option("--mend", help="What --write changes: bore (syringe) or steps (printer).")
    ] = "steps",
    doses: Annotated[str, typer.Option("--doses", help="Of the test, µL.")] = "20,40,60",
    repeats: Annotated[int, typer.Option("--repeats", help="Of each dose.", min=1)] = 4,
    flow: Annotated[float, typer.Option("--flow", help="Of the test, µL/s.", min=0.001)] = 2.0,
    wait: Annotated[float, typer.Option("--wait", help="To change vials, s.", min=0)] = 30.0,
    ink: Annotated[
        str, typer.Option("--ink", help="What a pneumatic head is weighed with.")
    ] = "collagen_fresh",
    needle: Annotated[str, typer.Option("--needle", help="The same, its needle.")] = "30g",
    at: At = "100,100,50",
    gcode: Gcode = None,
    write: Write = None,
    as_json: JsonFlag = False,
) -> None:
    """Steps per µL, by weight: CSV with travel_mm and mass_mg of each dose.

    Of a pneumatic head the flow at its pressure: open_s and mass_mg; --doses over --flow is how
    long the valve opens.
    """
    machine, filled = load(Printer, printer), load(Syringe, syringe)
    volumes = numbers_of(doses, "--doses") * repeats
    if machine.pneumatic is not None:
        what = WeighingOptions(machine, machine.pneumatic, load(Ink, ink), load(Needle, needle))
        if gcode is not None:
            path = weighing_path(volumes, flow, wait)
            job = Job(gcode, path, machine, filled, three_numbers(at, "--at"), doses=True)
            write_test(job, ("open_s", "mass_mg"), timed_dose_rows(what.head, volumes, flow), {})
            return
        data = read_csv_argument(readings, ("open_s", "mass_mg"))
        weigh_flow(what, data, (density, density_error), write, as_json)
        return
    if gcode is not None:
        per_ul = 4 / (math.pi * filled.inner_mm**2)
        rows = [[f"{volume * per_ul:.5f}", ""] for volume in volumes]
        path = weighing_path(volumes, flow, wait)
        job = Job(gcode, path, machine, filled, three_numbers(at, "--at"))
        write_test(job, ("travel_mm", "mass_mg"), rows, {})
        return
    if mend not in ("bore", "steps"):
        raise UsageError(f"--mend {mend!r} is neither bore nor steps")
    data = read_csv_argument(readings, ("travel_mm", "mass_mg"))
    weighing = weighing_of(data, density, density_error)
    result = weighing_result(weighing, machine, filled)
    print_estimates(result.lines, list(result.notes), as_json)
    if write is not None and mend == "bore":
        write_mended(write, filled, "inner_mm", weighing.bore_mm())
    elif write is not None:
        write_mended(write, machine, "steps_per_mm.e", weighing.steps_per_mm(machine, filled))
