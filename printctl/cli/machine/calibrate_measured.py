"""`printctl calibrate` by what a person or a balance reads: weigh, offset, level, backlash, lag.

A command with a test has two ways: ``--gcode FILE`` writes the G-code and, beside it, a CSV file
to fill in; with that file as argument it fits. No profile is written but with ``--write``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal, cast, get_args

from firmware_profiles import Ink, Needle, Printer, Syringe, load
from printctl import calibration
from printctl.calibration.paths import Axis
from printctl.checks.made_for import MadeFor, is_recorded, refuse_other
from printctl.cli import options as cli
from printctl.cli.confirmation import ForMountedFlag, confirm_set_up
from printctl.cli.declare import json_command
from printctl.errors import UsageError
from printctl.machine.prints.mounted import refuse_unknown, with_mounted
from printctl.settings import arg, numbers_of, opt, three_numbers

Csv = Annotated[Path | None, arg("Readings to fit, a CSV file.")]
PrinterName = Annotated[str | None, opt("Profile of the printer to calibrate.")]
Gcode = Annotated[
    Path | None, opt("Write the test G-code to this file, and a CSV to fill in next to it.")
]
At = Annotated[str, opt("Tip position in printer coordinates, mm.", metavar="X,Y,Z")]
Write = Annotated[Path | None, opt("Write a profile with the result to this file.")]
AcceptChange = Annotated[bool, opt("Accept a constant that changes by more than 20 %.")]


def machine_parts(
    printer: str | None, needed: Sequence[str], **named: str | None
) -> dict[str, str]:
    """Return the printer and its parts, named or mounted; those ``needed`` must be known."""
    if printer is None:
        raise UsageError("--printer is missing; a calibration holds for one machine, so name its "
                         "profile")  # fmt: skip
    parts = with_mounted(printer, named)
    refuse_unknown(printer, parts, needed)
    return {"printer": printer, **{part: name or "" for part, name in parts.items()}}


def read_csv_argument(path: Path | None, *numbers: str, word: str = "") -> calibration.Readings:
    """Read the file that must be there when no test is to be written; ``word`` is no number."""
    words = (word,) if word else ()
    if path is None:
        raise UsageError(
            f"give a CSV file with the columns {', '.join((*words, *numbers))}; where there is a "
            "test, --gcode FILE writes it and the file to fill in"
        )
    return calibration.read_readings(path, numbers, words)


def ask_unrecorded(
    sheet: Path | None, data: calibration.Readings, made: MadeFor, machine: Printer, agreed: bool
) -> None:
    """Have the set-up of a sheet confirmed, once, where the sheet doesn't record it."""
    if sheet is not None and not is_recorded(data.recorded, machine):
        confirm_set_up(sheet, made, agreed)


def print_estimates(lines: Mapping[str, calibration.Estimate], notes: Sequence[str]) -> None:
    """Numbers with their 95 % intervals, then what they mean."""
    reported = [f"{name:<40} {estimate.text()}" for name, estimate in lines.items()]
    values = {name: vars(estimate) for name, estimate in lines.items()}
    facts = {"estimates": values, "level": 0.95, "notes": notes}
    cli.print_result(facts, [*reported, "(95 % intervals)", *notes])


def write_test(job: calibration.Job) -> None:
    """Write the G-code and the CSV file beside it; say what to do with them (`make_test`)."""
    made = calibration.make_test(job)
    cli.print_notes(made.notes)
    start = ",".join(f"{value:g}" for value in job.at_mm)
    last = job.test.columns[-1]
    cli.print_lines(
        f"{job.path}: {made.lines} lines, {made.duration_s:.0f} s; put the tip to {start} "
        f"and print it with --start {start}",
        f"{job.sheet}: fill in the last column ({last}), then give it to the same command",
    )


def finish(
    result: calibration.Result, write: Path | None = None, accept_change: bool = False
) -> None:
    """Print a result, and write a measured copy of its profile where one is wanted."""
    left = () if write is None else result.unwritten
    print_estimates(result.lines, [*result.notes, *left])
    if write is not None:
        cli.print_note(f"wrote {write}: {result.save(write, accept_change=accept_change)}")


@json_command
def backlash(
    readings: Csv = None,
    printer: PrinterName = None,
    syringe: cli.SyringeOption = None,
    axis: str = opt("Axis: x, y, z or e.", "x"),
    targets: str = opt("Target positions relative to the tip, mm.", "2,4,6,8,10"),
    overshoot: float = opt("Overshoot before each approach, mm.", 1.0, min=0.01),
    speed: float = opt("Speed of the moves, mm/s.", 2.0, min=0.01),
    wait: float = opt("Time to read the dial, s.", 8.0, min=0),
    at: At = "100,100,50",
    gcode: Gcode = None,
) -> None:
    """Lost motion of an axis: CSV with target_mm, approach (1 or -1) and measured_mm.

    With --gcode it writes the G-code of the test, which comes to each place from both sides.
    """
    if gcode is None:
        finish(
            calibration.backlash_result(
                read_csv_argument(readings, "target_mm", "approach", "measured_mm")
            )
        )
        return
    parts = machine_parts(printer, ["syringe"], syringe=syringe)
    machine, filled = load(Printer, parts["printer"]), load(Syringe, parts["syringe"])
    if axis not in get_args(Axis):
        raise UsageError(f"--axis {axis!r} is none of x, y, z, e")
    test = calibration.backlash_test(
        cast(Axis, axis),
        numbers_of(targets, "--targets"),
        overshoot_mm=overshoot,
        speed_mm_s=speed,
        wait_s=wait,
        syringe=filled,
    )
    write_test(calibration.Job(gcode, test, machine, filled, three_numbers(at, "--at")))


@json_command
def lag(
    readings: Csv = None,
    printer: PrinterName = None,
    syringe: cli.SyringeOption = None,
    ink: cli.InkOption = None,
    needle: str | None = opt(
        "Needle profile; a lag is only valid for this needle.", show_default="what is mounted"
    ),
    slow: float = opt("Speed of the slow stretches, mm/s.", 4.0, min=0.01),
    fast: float = opt("Speed of the fast stretches, mm/s.", 16.0, min=0.01),
    length: float = opt("Length of each stretch, mm.", 40.0, min=1),
    width: float = opt("Bead width, mm.", 0.4, min=0.01),
    layer: float = opt("Layer height, mm.", 0.2, min=0.01),
    round_bead: bool = opt(
        "Print a round filament in a bath, or a flat bead on a plate.", False, "--round/--flat"
    ),
    lines: int = opt("Number of lines of the test.", 3, min=1),
    at: At = "40,100,1",
    gcode: Gcode = None,
    write: Write = None,
    accept_change: AcceptChange = False,
    for_mounted: ForMountedFlag = False,
) -> None:
    """Pressure lag (K, τ) and flow factor: CSV with x_mm along the line and width_mm there.

    With --gcode it writes the G-code of the test: one line, slow and fast in turn, whose width
    follows the pressure late.
    """
    named = {"syringe": syringe, "ink": ink, "needle": needle}
    parts = machine_parts(printer, ["syringe", "ink"], **named)
    machine, filled = load(Printer, parts["printer"]), load(Syringe, parts["syringe"])
    material = load(Ink, parts["ink"])
    tip = load(Needle, parts["needle"]) if parts["needle"] else None
    line = calibration.LagPattern(
        slow, fast, length, width, layer, "round" if round_bead else "flat"
    )
    if gcode is not None:
        test = calibration.lag_test(line, lines, material)
        place = three_numbers(at, "--at")
        # As a print does: what is found then multiplies the factor that the ink has.
        factor = material.flow_factor
        write_test(calibration.Job(gcode, test, machine, filled, place, factor, material, tip))
        return
    data = read_csv_argument(readings, "x_mm", "width_mm")
    made = calibration.record_of_test(machine, filled, material, tip)
    refuse_other(data.recorded, made)
    if write is not None:
        ask_unrecorded(readings, data, made, machine, for_mounted)
    finish(calibration.lag_result(data, line, material, tip, filled), write, accept_change)


@json_command
def offset(
    readings: Csv = None,
    printer: str | None = opt("Profile of a printer with several heads, all lowered."),
    head: int = opt("Head that holds the second needle.", 1, min=1),
    write: Write = None,
) -> None:
    """Offset of a needle: CSV with needle (two names), x_mm, y_mm and z_mm of touch-offs.

    With --printer it is the offset of a head: the needle of the first row is the first head's, the
    other --head's, and both touched the same mark. --write writes the profile with it.
    """
    if write is not None and printer is None:
        raise UsageError("--write needs the profile that is to be mended; give --printer")
    data = read_csv_argument(readings, "x_mm", "y_mm", "z_mm", word="needle")
    if printer is not None:
        finish(calibration.head_offset_result(data, load(Printer, printer), head), write)
    else:
        finish(calibration.offset_result(data))


@json_command
def weigh(
    readings: Csv = None,
    printer: PrinterName = None,
    syringe: cli.SyringeOption = None,
    density: float = opt("Density of the weighed liquid, g/cm³.", 0.998),
    density_error: float = opt(
        "Half width of the 95 % interval of the density, g/cm³.", 0.001, min=0
    ),
    mend: str = opt("Value that --write changes: bore (syringe) or steps (printer).", "steps"),
    doses: str = opt("Dose volumes of the test, µL.", "20,40,60"),
    repeats: int = opt("Number of repeats of each dose.", 4, min=1),
    flow: float = opt("Flow rate of the test, µL/s.", 2.0, min=0.001),
    wait: float = opt("Time to change vials, s.", 30.0, min=0),
    ink: str | None = opt(
        "Ink profile for weighing with a pneumatic head.", show_default="what is mounted"
    ),
    needle: str | None = opt(
        "Needle profile for weighing with a pneumatic head.", show_default="what is mounted"
    ),
    at: At = "100,100,50",
    gcode: Gcode = None,
    write: Write = None,
    accept_change: AcceptChange = False,
    for_mounted: ForMountedFlag = False,
) -> None:
    """Steps per µL, by weight: CSV with travel_mm and mass_mg of each dose.

    Of a pneumatic head the flow at its pressure: open_s and mass_mg; --doses over --flow is how
    long the valve opens.
    """
    named = {"syringe": syringe, "ink": ink, "needle": needle}
    parts = machine_parts(printer, ["syringe"], **named)
    machine, filled = load(Printer, parts["printer"]), load(Syringe, parts["syringe"])
    volumes = numbers_of(doses, "--doses") * repeats
    head, known = machine.pneumatic, (density, density_error)
    if gcode is not None:
        test = calibration.weighing_test(volumes, flow, wait, filled, head)
        write_test(calibration.Job(gcode, test, machine, filled, three_numbers(at, "--at")))
        return
    if head is not None:
        data = read_csv_argument(readings, "open_s", "mass_mg")
        refuse_unknown(parts["printer"], parts, ["ink", "needle"])
        used = load(Ink, parts["ink"]), load(Needle, parts["needle"])
        if write is not None:
            made = calibration.record_of_test(machine, None, *used)
            ask_unrecorded(readings, data, made, machine, for_mounted)
        finish(calibration.flow_result(data, known, machine, *used), write, accept_change)
        return
    if mend not in ("bore", "steps"):
        raise UsageError(f"--mend {mend!r} is neither bore nor steps")
    data = read_csv_argument(readings, "travel_mm", "mass_mg")
    if write is not None:
        made = calibration.record_of_test(machine, filled)
        ask_unrecorded(readings, data, made, machine, for_mounted)
    what: Literal["bore", "steps"] = "bore" if mend == "bore" else "steps"
    finish(calibration.weighing_result(data, known, machine, filled, what), write, accept_change)


@json_command
def level(
    readings: Csv = None,
    part: str = opt("Size of the part, mm.", "20,20", metavar="X,Y"),
) -> None:
    """Level of bed and bath: CSV with surface (bed or bath), x_mm, y_mm and z_mm of touches.

    Three places of each at least, not in a row; more tell how sure the tilt is.
    """
    data = read_csv_argument(readings, "x_mm", "y_mm", "z_mm", word="surface")
    size = numbers_of(part, "--part")
    finish(calibration.level_result(data, size[0], size[-1]))
