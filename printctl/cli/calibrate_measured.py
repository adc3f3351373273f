"""`printctl calibrate`: what readings of a person or a balance tell."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from firmware_profiles import (
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
    FlowWeighing,
    Lag,
    LagPattern,
    Readings,
    backlash_path,
    fit_flow,
    fit_lag,
    fit_offset,
    lag_path,
    weighing_path,
)
from printctl.calibration.paths import Axis
from printctl.calibration.results import (
    backlash_result,
    offset_result,
    split_touches,
    weighing_of,
    weighing_result,
)
from printctl.calibration.writing import Job, MeasuredValue
from printctl.cli.calibrate_options import (
    At,
    Csv,
    Gcode,
    Write,
    numbers_of,
    print_estimates,
    read_csv_argument,
    write_changed,
    write_measured,
    write_mended,
    write_test,
)
from printctl.cli.declare import command
from printctl.cli.options import JsonFlag, PrinterOption, SyringeOption
from printctl.errors import UsageError
from printctl.settings import opt, three_numbers


@dataclass(frozen=True)
class WeighingOptions:
    """What was weighed, out of what."""

    printer: Printer
    head: Pneumatic
    ink: Ink
    needle: Needle


def timed_dose_rows(head: Pneumatic, doses_ul: list[float], flow: float) -> list[list[str]]:
    """Rows of the sheet: seconds from the opening command to the closing one, and a blank."""
    wait_s = np.ceil(head.opening_delay_s * 1e3) / 1e3
    return [[f"{round(dose / flow, 3) + wait_s:.3f}", ""] for dose in doses_ul]


def weigh_flow(
    what: WeighingOptions,
    data: Readings,
    density: tuple[float, float],
    write: Path | None,
    as_json: bool,
) -> None:
    """Fit, tell, and write the flow into a printer's profile if asked."""
    weighing = fit_flow(
        data.numbers["open_s"], data.numbers["mass_mg"], *density, data.last_digit["mass_mg"]
    )
    lines = {f"flow at {what.head.pressure_kpa:g} kPa": weighing.flow_ul_s}
    if weighing.lost_s is not None:
        lines["missing from each opening"] = weighing.lost_s
    print_estimates(lines, _notes(weighing, what), as_json)
    if write is not None:
        measured = MeasuredFlow(
            flow_ul_s=weighing.flow_ul_s.value,
            pressure_kpa=what.head.pressure_kpa,
            ink=what.ink.name,
            needle=what.needle.name,
        )
        dispenser = what.head.model_copy(update={"measured": measured})
        values = dispenser.model_dump(mode="json", exclude_unset=True)
        values["measured"] = measured.model_dump(mode="json")
        write_changed(write, what.printer, "dispenser", values, weighing.flow_ul_s)


def _notes(weighing: FlowWeighing, what: WeighingOptions) -> list[str]:
    foreseen = flow_ul_s(what.ink, what.needle, what.head.pressure_kpa * 1e3) * what.ink.flow_factor
    agrees = weighing.flow_ul_s.holds(foreseen)
    return [
        f"one dose scatters by {weighing.scatter_ul:.3g} µL",
        f"the viscosity of {what.ink.name} foresees {foreseen:.4g} µL/s through "
        f"{what.needle.name}, which {'agrees' if agrees else 'does not agree'}",
        "good for this ink, needle and pressure alone, and for this warmth",
    ]


# `printctl calibrate backlash`: write an axis test, or fit backlash and scale from readings.


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
    print_estimates(result.lines, list(result.notes), as_json)


def _axis(text: str) -> Axis:
    for axis in ("x", "y", "z", "e"):
        if text == axis:
            return axis
    raise UsageError(f"--axis {text!r} is none of x, y, z, e")


# `printctl calibrate lag`: write a test, or fit pressure lag and flow factor to line widths.


@command
def lag(
    readings: Csv = None,
    printer: PrinterOption = "generic_marlin",
    syringe: SyringeOption = "hamilton_1ml",
    ink: str = opt("Ink profile.", "collagen_fresh"),
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


# `printctl calibrate offset`: fit the offset between two needle tips to touch-off readings.


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


# `printctl calibrate weigh`: write a dosing test, or fit steps per µL to weighed doses.


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
