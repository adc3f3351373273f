"""`printctl calibrate` by what a person or a balance reads: weigh, offset, level, backlash, lag.

A command with a test has two ways: ``--gcode FILE`` writes the G-code and, beside it, a CSV file
to fill in; with that file as argument it fits. No profile is written but with ``--write``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from firmware_profiles import (
    Facts,
    Ink,
    MeasuredFlow,
    MeasuredLag,
    Needle,
    Pneumatic,
    Printer,
    Syringe,
    flow_ul_s,
    load,
)
from printctl.calibration import (
    Estimate,
    Lag,
    LagPattern,
    Readings,
    backlash_path,
    fit_flow,
    fit_lag,
    fit_offset,
    lag_path,
    read_readings,
    weighing_path,
)
from printctl.calibration.paths import Axis
from printctl.calibration.results import (
    backlash_result,
    level_result,
    offset_result,
    split_touches,
    weighing_of,
    weighing_result,
)
from printctl.calibration.writing import Job, MeasuredValue, make_test, measured_key, save_measured
from printctl.cli.declare import command
from printctl.cli.options import (
    InkOption,
    JsonFlag,
    PrinterOption,
    SyringeOption,
    print_lines,
    print_note,
    print_notes,
    print_result,
)
from printctl.errors import UsageError
from printctl.settings import arg, numbers_of, opt, three_numbers

Csv = Annotated[Path | None, arg("Readings to fit, a CSV file.")]
Gcode = Annotated[Path | None, opt("Write the test's G-code here, and a CSV to fill in beside it.")]
At = Annotated[str, opt("Where the tip stands, printer's frame, mm.", metavar="X,Y,Z")]
Write = Annotated[Path | None, opt("Write a profile with the result to this file.")]


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


def print_estimates(lines: Mapping[str, Estimate], notes: Sequence[str], as_json: bool) -> None:
    """Numbers with their 95 % intervals, then what they mean."""
    values = {
        name: {"value": e.value, "low": e.low, "high": e.high, "unit": e.unit}
        for name, e in lines.items()
    }
    reported = [f"{name:<40} {estimate.text()}" for name, estimate in lines.items()]
    facts = {"estimates": values, "level": 0.95, "notes": notes}
    print_result(as_json, facts, [*reported, "(95 % intervals)", *notes])


def write_test(
    job: Job, columns: tuple[str, ...], rows: list[list[str]], facts: dict[str, float]
) -> None:
    """Write the G-code and the CSV file beside it; say what to do with them (`make_test`)."""
    made = make_test(job, columns, rows, facts)
    print_notes(made.notes)
    start = ",".join(f"{value:g}" for value in job.at_mm)
    print_lines(
        f"{job.path}: {made.lines} lines, {made.duration_s:.0f} s; put the tip to {start} "
        f"and print it with --start {start}",
        f"{job.sheet}: fill in the last column ({columns[-1]}), then give it to the same command",
    )


def write_mended(path: Path, facts: Facts, key: str, estimate: Estimate) -> None:
    """Write a copy of a profile with one key measured; its source says so."""
    write_measured(path, facts, measured_key(facts, key, estimate))


def write_measured(path: Path, facts: Facts, measured: Mapping[str, MeasuredValue]) -> None:
    """Write a copy of a profile with keys changed for what was measured; its source says so."""
    print_note(f"wrote {path}: {save_measured(path, facts, measured)}")


@command
def backlash(
    readings: Csv = None,
    printer: PrinterOption = "generic_marlin",
    syringe: SyringeOption = "hamilton_1ml",
    axis: str = opt("x, y, z or e.", "x"),
    targets: str = opt("From the tip's place, mm.", "2,4,6,8,10"),
    overshoot: float = opt("mm", 1.0, min=0.01),
    speed: float = opt("mm/s", 2.0, min=0.01),
    wait: float = opt("To read the dial, s.", 8.0, min=0),
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
    print_estimates(result.lines, result.notes, as_json)


def _axis(text: str) -> Axis:
    for axis in ("x", "y", "z", "e"):
        if text == axis:
            return axis
    raise UsageError(f"--axis {text!r} is none of x, y, z, e")


@command
def lag(
    readings: Csv = None,
    printer: PrinterOption = "generic_marlin",
    syringe: SyringeOption = "hamilton_1ml",
    ink: InkOption = "collagen_fresh",
    needle: str | None = opt("The one mounted: a lag is written for it alone."),
    slow: float = opt("mm/s", 4.0, min=0.01),
    fast: float = opt("mm/s", 16.0, min=0.01),
    length: float = opt("Of each stretch, mm.", 40.0, min=1),
    width: float = opt("Of the line, mm.", 0.4, min=0.01),
    layer: float = opt("mm", 0.2, min=0.01),
    round_bead: bool = opt("A filament in a bath, or a bead on a plate.", False, "--round/--flat"),
    lines: int = opt("Of the test.", 3, min=1),
    at: At = "40,100,1",
    gcode: Gcode = None,
    write: Write = None,
    as_json: JsonFlag = False,
) -> None:
    """Pressure lag (K, τ) and flow factor: CSV with x_mm along the line and width_mm there.

    With --gcode it writes the G-code of the test: one line, slow and fast in turn, whose width
    follows the pressure late.
    """
    material = load(Ink, ink)
    line = {"slow_mm_s": slow, "fast_mm_s": fast, "length_mm": length, "width_mm": width}
    line |= {"layer_mm": layer, "round": float(round_bead)}
    if gcode is not None:
        path = lag_path(
            _pattern(line),
            lines,
            prime_ul=material.retract_ul,
            flow_ul_s=material.plunger_ul_s,
            spacing_mm=10 * width,
        )
        place = three_numbers(at, "--at")
        mounted = (load(Printer, printer), load(Syringe, syringe))
        # As a print does: what is found then multiplies the factor that the ink has.
        job = Job(gcode, path, *mounted, place, flow_factor=material.flow_factor)
        write_test(job, ("x_mm", "width_mm"), [[f"{x:g}", ""] for x in _places(length)], line)
        return
    data = read_csv_argument(readings, ("x_mm", "width_mm"))
    fit = fit_lag(
        data.numbers["x_mm"],
        data.numbers["width_mm"],
        _pattern(line | data.facts),
        data.last_digit["width_mm"],
    )
    factor = fit.flow_factor.times(material.flow_factor, "")
    tip = None if needle is None else load(Needle, needle)
    print_estimates(
        _lag_estimates(fit, factor), [*_lag_notes(fit), *_unwritten(fit, tip, write)], as_json
    )
    if write is not None:
        lagging = _with_lag(material, fit, tip, load(Syringe, syringe))
        write_mended(write, lagging, "flow_factor", factor)


def _with_lag(ink: Ink, fit: Lag, needle: Needle | None, syringe: Syringe) -> Ink:
    """The ink with its lag, where one number says it and the needle is known."""
    if needle is None or not fit.linear:
        return ink
    lag = MeasuredLag(lag_s=fit.rise_s.value, needle=needle.name, syringe=syringe.name)
    source = f"{ink.source} lag measured by printctl calibrate: {fit.rise_s.text()}, 95 %."
    return ink.model_copy(update={"lag": lag, "source": source})


def _unwritten(fit: Lag, needle: Needle | None, write: Path | None) -> list[str]:
    if write is None:
        return []
    if not fit.linear:
        return ["the lag isn't written: rise and fall differ, so no single number says it"]
    if needle is None:
        return ["the lag isn't written: it holds for one needle; name it (--needle)"]
    return []


def _pattern(line: dict[str, float]) -> LagPattern:
    """The line, as options say it or the CSV file that was written with its G-code."""
    return LagPattern(
        line["slow_mm_s"],
        line["fast_mm_s"],
        line["length_mm"],
        line["width_mm"],
        line["layer_mm"],
        "round" if line["round"] else "flat",
    )


def _lag_estimates(fit: Lag, factor: Estimate) -> dict[str, Estimate]:
    return {
        "flow factor": factor,
        "τ, flow going up": fit.rise_s,
        "τ, flow going down": fit.fall_s,
        "K (advance)": fit.advance_s,
    }


def _lag_notes(fit: Lag) -> list[str]:
    return [
        f"one width scatters by {fit.scatter_mm * 1e3:.3g} µm",
        "rise and fall agree: the ink is linear here"
        if fit.linear
        else "rise and fall differ: the ink holds pressure by its yield stress, so no single K "
        "is right; keep to one speed",
        "printctl sends no advance: set it in the firmware (Marlin M900 K, RepRapFirmware M572 S, "
        "Klipper SET_PRESSURE_ADVANCE) and print the test again",
    ]


def _places(length: float) -> list[float]:
    """Where to measure: close together after the changes of speed."""
    after = [0.01, 0.02, 0.04, 0.07, 0.1, 0.15, 0.2, 0.3, 0.4, 0.55, 0.75, 0.95]
    steady = [0.55, 0.65, 0.75, 0.85, 0.95]
    return [
        round(length * (stretch + part), 3)
        for stretch, parts in ((0, steady), (1, after), (2, after))
        for part in parts
    ]


@command
def offset(
    readings: Csv = None,
    printer: str | None = opt("Profile of a printer with several heads, all lowered."),
    head: int = opt("Whose needle is the second of the two.", 1, min=1),
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
    print_estimates(result.lines, result.notes, as_json)


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
    reported = ", ".join(f"{axis} {one.text()}" for axis, one in zip("xyz", estimates, strict=True))
    measured = MeasuredValue(heads, f"{reported}, 95 %")
    write_measured(write, printer, {f"heads.{number}.offset_mm": measured})


@command
def weigh(
    readings: Csv = None,
    printer: PrinterOption = "generic_marlin",
    syringe: SyringeOption = "hamilton_1ml",
    density: float = opt("Of what is weighed, g/cm³.", 0.998),
    density_error: float = opt("Half of its 95 % interval, g/cm³.", 0.001, min=0),
    mend: str = opt("What --write changes: bore (syringe) or steps (printer).", "steps"),
    doses: str = opt("Of the test, µL.", "20,40,60"),
    repeats: int = opt("Of each dose.", 4, min=1),
    flow: float = opt("Of the test, µL/s.", 2.0, min=0.001),
    wait: float = opt("To change vials, s.", 30.0, min=0),
    ink: str = opt("What a pneumatic head is weighed with.", "collagen_fresh"),
    needle: str = opt("The same, its needle.", "30g"),
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
    path = None if gcode is None else weighing_path(volumes, flow, wait)
    head = machine.pneumatic
    columns = ("travel_mm" if head is None else "open_s", "mass_mg")
    if gcode is not None and path is not None:
        place = three_numbers(at, "--at")
        job = Job(gcode, path, machine, filled, place, doses=head is not None)
        write_test(job, columns, _dose_rows(head, filled, volumes, flow), {})
        return
    if head is not None:
        data = read_csv_argument(readings, columns)
        used = (load(Ink, ink), load(Needle, needle))
        _weigh_flow(data, machine, head, used, (density, density_error), write, as_json)
        return
    if mend not in ("bore", "steps"):
        raise UsageError(f"--mend {mend!r} is neither bore nor steps")
    data = read_csv_argument(readings, columns)
    weighing = weighing_of(data, density, density_error)
    result = weighing_result(weighing, machine, filled)
    print_estimates(result.lines, result.notes, as_json)
    if write is not None and mend == "bore":
        write_mended(write, filled, "inner_mm", weighing.bore_mm())
    elif write is not None:
        write_mended(write, machine, "steps_per_mm.e", weighing.steps_per_mm(machine, filled))


def _dose_rows(
    head: Pneumatic | None, filled: Syringe, doses_ul: list[float], flow: float
) -> list[list[str]]:
    """Rows of the sheet: travel, or seconds from the opening command to the closing one; blanks."""
    if head is None:
        per_ul = 4 / (math.pi * filled.inner_mm**2)
        return [[f"{dose * per_ul:.5f}", ""] for dose in doses_ul]
    wait_s = np.ceil(head.opening_delay_s * 1e3) / 1e3
    return [[f"{round(dose / flow, 3) + wait_s:.3f}", ""] for dose in doses_ul]


def _weigh_flow(
    data: Readings,
    machine: Printer,
    head: Pneumatic,
    used: tuple[Ink, Needle],
    density: tuple[float, float],
    write: Path | None,
    as_json: bool,
) -> None:
    """Fit, tell, and write the flow of a pneumatic head into a printer's profile if asked."""
    ink, needle = used
    weighing = fit_flow(
        data.numbers["open_s"], data.numbers["mass_mg"], *density, data.last_digit["mass_mg"]
    )
    flow = weighing.flow_ul_s
    lines = {f"flow at {head.pressure_kpa:g} kPa": flow}
    if weighing.lost_s is not None:
        lines["missing from each opening"] = weighing.lost_s
    foreseen = flow_ul_s(ink, needle, head.pressure_kpa * 1e3) * ink.flow_factor
    agrees = "agrees" if flow.holds(foreseen) else "does not agree"
    notes = [
        f"one dose scatters by {weighing.scatter_ul:.3g} µL",
        f"the viscosity of {ink.name} foresees {foreseen:.4g} µL/s through {needle.name}, which "
        f"{agrees}",
        "good for this ink, needle and pressure alone, and for this warmth",
    ]
    print_estimates(lines, notes, as_json)
    if write is not None:
        measured = MeasuredFlow(
            flow_ul_s=flow.value,
            pressure_kpa=head.pressure_kpa,
            ink=ink.name,
            needle=needle.name,
        )
        dispenser = head.model_copy(update={"measured": measured})
        values = dispenser.model_dump(mode="json", exclude_unset=True)
        values["measured"] = measured.model_dump(mode="json")
        stated = MeasuredValue(values, f"{flow.text()}, 95 %")
        write_measured(write, machine, {"dispenser": stated})


@command
def level(
    readings: Csv = None,
    part: str = opt("Size of the part, mm.", "20,20", metavar="X,Y"),
    as_json: JsonFlag = False,
) -> None:
    """Level of bed and bath: CSV with surface (bed or bath), x_mm, y_mm and z_mm of touches.

    Three places of each at least, not in a row; more tell how sure the tilt is.
    """
    data = read_csv_argument(readings, ("x_mm", "y_mm", "z_mm"), ("surface",))
    size = numbers_of(part, "--part")
    result = level_result(data, size[0], size[-1])
    print_estimates(result.lines, result.notes, as_json)
