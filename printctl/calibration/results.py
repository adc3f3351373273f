"""Fit calibration readings (weights, dial, touches, widths): values, intervals, notes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from firmware_profiles import (
    Facts,
    Ink,
    MeasuredFlow,
    Needle,
    Printer,
    Syringe,
    flow_ul_s,
)
from printctl.calibration.estimate import Estimate
from printctl.calibration.lag import Lag, LagPattern, fit_lag
from printctl.calibration.readings import Readings
from printctl.calibration.touches import fit_backlash, fit_level, fit_offset, gap_between
from printctl.calibration.weighing import fit_flow, fit_weighing
from printctl.calibration.writing import (
    MeasuredValue,
    measured_key,
    record_of_test,
    save_measured,
)
from printctl.checks.made_for import refuse_other
from printctl.errors import UsageError


@dataclass(frozen=True)
class Result:
    """Result of a calibration.

    Attributes
    ----------
    lines : mapping of str to Estimate
    notes : sequence of str
        What it means, and what isn't known.
    profile : Facts, optional
        What a measured copy is written of.
    measured : mapping of str to MeasuredValue
        Keys of the profile that were measured.
    unwritten : tuple of str
        What the copy doesn't get, and why.
    table : sequence of str
        What was measured, line by line, for people.
    """

    lines: Mapping[str, Estimate]
    notes: Sequence[str]
    profile: Facts | None = None
    measured: Mapping[str, MeasuredValue] = field(default_factory=dict)
    unwritten: tuple[str, ...] = ()
    table: Sequence[str] = ()

    def save(self, path: Path, profile: Facts | None = None, *, accept_change: bool = False) -> str:
        """Write a measured copy of the profile, or of another one; return what was changed.

        Raises
        ------
        UsageError
            When no key of it was measured.
        """
        held = self.profile if profile is None else profile
        if held is None or not self.measured:
            raise UsageError(f"{path} isn't written: this print tells nothing that a profile holds")
        return save_measured(path, held, self.measured, accept_change=accept_change)


def weighing_result(
    data: Readings,
    density_g_cm3: tuple[float, float],
    printer: Printer,
    syringe: Syringe,
    mend: Literal["bore", "steps"] = "steps",
) -> Result:
    """Fit weighed doses: columns travel_mm and mass_mg.

    Parameters
    ----------
    density_g_cm3 : (density, half of its 95 % interval)
    mend : str
        Whether the syringe's bore is measured, or the printer's steps.

    Raises
    ------
    UsageError
    """
    refuse_other(data.recorded, record_of_test(printer, syringe))
    weighing = fit_weighing(
        data.numbers["travel_mm"],
        data.numbers["mass_mg"],
        *density_g_cm3,
        data.last_digit["mass_mg"],
    )
    bore, steps = weighing.bore_mm(), weighing.steps_per_mm(printer, syringe)
    lines = {
        "volume per travel": weighing.ul_per_mm,
        "steps per volume": weighing.steps_per_ul(printer),
        "steps per travel, if the bore is right": steps,
        "bore, if the steps are right": bore,
    }
    if weighing.lost_ul is not None:
        lines["missing from each dose"] = weighing.lost_ul
    nominal = syringe.area_mm2
    agrees = weighing.ul_per_mm.holds(nominal)
    notes = (
        f"one dose scatters by {weighing.scatter_ul:.3g} µL",
        f"the profiles say {nominal:.3f} µL/mm, which "
        f"{'agrees' if agrees else 'does not agree: mend steps or bore'}",
    )
    if mend == "bore":
        return Result(lines, notes, syringe, measured_key(syringe, "inner_mm", bore))
    return Result(lines, notes, printer, measured_key(printer, "steps_per_mm.e", steps))


def flow_result(
    data: Readings, density_g_cm3: tuple[float, float], printer: Printer, ink: Ink, needle: Needle
) -> Result:
    """Fit doses of a printer's pneumatic head: columns open_s and mass_mg; see `weighing_result`.

    Raises
    ------
    UsageError
    """
    head = printer.pneumatic
    if head is None:
        raise UsageError(f"{printer.name} has no pneumatic head; weigh travel_mm and mass_mg")
    refuse_other(data.recorded, record_of_test(printer, None, ink, needle))
    weighing = fit_flow(
        data.numbers["open_s"], data.numbers["mass_mg"], *density_g_cm3, data.last_digit["mass_mg"]
    )
    flow = weighing.flow_ul_s
    lines = {f"flow at {head.pressure_kpa:g} kPa": flow}
    if weighing.lost_s is not None:
        lines["missing from each opening"] = weighing.lost_s
    foreseen = flow_ul_s(ink, needle, head.pressure_kpa * 1e3) * ink.flow_factor
    notes = (
        f"one dose scatters by {weighing.scatter_ul:.3g} µL",
        f"the viscosity of {ink.name} foresees {foreseen:.4g} µL/s through {needle.name}, which "
        f"{'agrees' if flow.holds(foreseen) else 'does not agree'}",
        "good for this ink, needle and pressure alone, and for this warmth",
    )
    measured = MeasuredFlow(
        flow_ul_s=flow.value, pressure_kpa=head.pressure_kpa, ink=ink.name, needle=needle.name
    )
    values = head.model_dump(mode="json", exclude_unset=True)
    values["measured"] = measured.model_dump(mode="json")
    stated = MeasuredValue(values, f"{flow.text()}, 95 %")
    return Result(lines, notes, printer, {"dispenser": stated})


def lag_result(
    data: Readings, pattern: LagPattern, ink: Ink, needle: Needle | None, syringe: Syringe
) -> Result:
    """Fit widths along a line: columns x_mm and width_mm, the line's numbers above them.

    Parameters
    ----------
    pattern : LagPattern
        What holds where the sheet says nothing.
    needle : Needle, optional
        The one mounted: a lag is measured for it alone.

    Raises
    ------
    UsageError
    """
    x_mm, width_mm = data.numbers["x_mm"], data.numbers["width_mm"]
    fit = fit_lag(x_mm, width_mm, pattern.with_facts(data.facts), data.last_digit["width_mm"])
    # The test was written with the ink's own factor.
    factor = fit.flow_factor.times(ink.flow_factor, "")
    lines = {"flow factor": factor, **fit.estimates()}
    notes = (
        f"one width scatters by {fit.scatter_mm * 1e3:.3g} µm",
        "rise and fall agree: the ink is linear here"
        if fit.linear
        else "rise and fall differ: the ink holds pressure by its yield stress, so no single K "
        "is right; keep to one speed",
        "printctl sends no advance: set it in the firmware (Marlin M900 K, RepRapFirmware M572 S, "
        "Klipper SET_PRESSURE_ADVANCE) and print the test again",
    )
    measured, unwritten = measured_key(ink, "flow_factor", factor), ""
    if needle is not None:
        measured |= measured_lag(fit, needle, syringe)
    if not fit.linear:
        unwritten = "the lag isn't written: rise and fall differ, so no single number says it"
    elif needle is None:
        unwritten = "the lag isn't written: it holds for one needle; name it (--needle)"
    return Result(lines, notes, ink, measured, (unwritten,) if unwritten else ())


def measured_lag(lag: Lag, needle: Needle, syringe: Syringe) -> dict[str, MeasuredValue]:
    """Return an ink's ``lag`` for a needle and a syringe, where one number says it."""
    if not lag.linear:
        return {}
    value = {"lag_s": lag.rise_s.value, "needle": needle.name, "syringe": syringe.name}
    return {"lag": MeasuredValue(value, f"{lag.rise_s.text()}, 95 %, with {needle.name}")}


def backlash_result(data: Readings) -> Result:
    """Tell of a dial: columns target_mm, approach and measured_mm.

    Raises
    ------
    UsageError
    """
    target, approach, dial = (data.numbers[n] for n in ("target_mm", "approach", "measured_mm"))
    backlash = fit_backlash(target, approach, dial, data.last_digit["measured_mm"])
    lines = {"lost motion": backlash.lost_mm, "travelled over commanded": backlash.scale}
    return Result(lines, (f"one reading scatters by {backlash.scatter_mm:.3g} mm",))


def level_result(data: Readings, width_mm: float, depth_mm: float) -> Result:
    """Tell of touches of bed and bath: columns surface, x_mm, y_mm and z_mm.

    Raises
    ------
    UsageError
    """
    unknown = set(data.words["surface"]) - {"bed", "bath"}
    if unknown:
        raise UsageError(f"surface {sorted(unknown)[0]!r} is neither bed nor bath")
    centre = (float(data.numbers["x_mm"].mean()), float(data.numbers["y_mm"].mean()))
    planes, lines, notes = {}, {}, []
    for surface in dict.fromkeys(data.words["surface"]):
        rows = [word == surface for word in data.words["surface"]]
        x, y, z = (data.numbers[name][rows] for name in ("x_mm", "y_mm", "z_mm"))
        plane = planes[surface] = fit_level(x, y, z, centre, data.last_digit["z_mm"])
        lines[f"{surface}, height in the middle"] = plane.height_mm
        lines[f"{surface}, rise along x"] = plane.slope_x
        lines[f"{surface}, rise along y"] = plane.slope_y
        notes.append(
            f"{surface}: {plane.rise_mm(width_mm, depth_mm):.3f} mm across a part of "
            f"{width_mm:g},{depth_mm:g} mm; points scatter by {plane.flatness_mm:.3g} mm about "
            "the plane"
        )
    if len(planes) == 2:
        lines["depth of the bath (bath_depth_mm)"] = gap_between(planes["bed"], planes["bath"])
    return Result(lines, tuple(notes))


def _split_touches(data: Readings) -> tuple[tuple[str, str], list[np.ndarray]]:
    """Names of the two needles, and where each touched, (n, 3) mm.

    Raises
    ------
    UsageError
        When there aren't exactly two.
    """
    names = list(dict.fromkeys(data.words["needle"]))
    if len(names) != 2:
        raise UsageError(f"needles {', '.join(names)}: give touch-offs of exactly two")
    places = []
    for name in names:
        rows = [word == name for word in data.words["needle"]]
        columns = [data.numbers[axis][rows] for axis in ("x_mm", "y_mm", "z_mm")]
        places.append(np.column_stack(columns))
    return (names[0], names[1]), places


def offset_result(data: Readings) -> Result:
    """Tell of touch-offs with two needles: columns needle, x_mm, y_mm and z_mm.

    Raises
    ------
    UsageError
    """
    (one, other), (first, second) = _split_touches(data)
    offset = fit_offset(first, second, max(data.last_digit.values()))
    lines = {f"{other} less {one}, {axis}": e for axis, e in zip("xyz", offset, strict=True)}
    return Result(lines, (f"add it to place_mm when {other} prints what {one} was set up for",))


def head_offset_result(data: Readings, printer: Printer, head: int) -> Result:
    """Tell the offset of a head whose needle touched the mark that the first head's did.

    Columns as of `offset_result`, the first head's needle first.

    Raises
    ------
    UsageError
    """
    _, (first, second) = _split_touches(data)
    # The carriage stands so much less far as the tip stands out: the other way round.
    found = fit_offset(second, first, max(data.last_digit.values()))
    if head >= printer.head_count or not printer.heads:
        raise UsageError(
            f"{printer.name} has no head {head} (heads); name its heads in the profile first"
        )
    offset = dict(zip("xyz", found, strict=True))
    lines = {f"heads.{head}.offset_mm.{axis}": one for axis, one in offset.items()}
    heads = [one.model_dump(mode="json", exclude_unset=True) for one in printer.heads]
    heads[head]["offset_mm"] = {axis: round(one.value, 4) for axis, one in offset.items()}
    said = ", ".join(f"{axis} {one.text()}" for axis, one in offset.items())
    return Result(
        lines,
        ("touch off again after every change of a needle: it stands elsewhere then",),
        printer,
        {f"heads.{head}.offset_mm": MeasuredValue(heads, f"{said}, 95 %")},
    )
