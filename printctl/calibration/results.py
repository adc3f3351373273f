"""Fit calibration readings (weighing, dial, touches); report values with intervals, and notes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from firmware_profiles import Printer, Syringe
from printctl.calibration.estimate import Estimate
from printctl.calibration.readings import Readings
from printctl.calibration.touches import fit_backlash, fit_level, fit_offset, gap_between
from printctl.calibration.weighing import Weighing, fit_weighing
from printctl.errors import UsageError


@dataclass(frozen=True)
class Result:
    """Result of a calibration.

    Attributes
    ----------
    lines : dict of str to Estimate
    notes : tuple of str
    """

    lines: dict[str, Estimate]
    notes: tuple[str, ...]


def weighing_of(data: Readings, density_g_cm3: float, density_error: float) -> Weighing:
    """Fit doses: columns travel_mm and mass_mg.

    Raises
    ------
    UsageError
    """
    return fit_weighing(
        data.numbers["travel_mm"],
        data.numbers["mass_mg"],
        density_g_cm3,
        density_error,
        data.last_digit["mass_mg"],
    )


def weighing_result(weighing: Weighing, printer: Printer, syringe: Syringe) -> Result:
    """Tell of doses weighed."""
    lines = {
        "volume per travel": weighing.ul_per_mm,
        "steps per volume": weighing.steps_per_ul(printer),
        "steps per travel, if the bore is right": weighing.steps_per_mm(printer, syringe),
        "bore, if the steps are right": weighing.bore_mm(),
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
    return Result(lines, notes)


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


def split_touches(data: Readings) -> tuple[tuple[str, str], list[np.ndarray]]:
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
    (one, other), (first, second) = split_touches(data)
    offset = fit_offset(first, second, max(data.last_digit.values()))
    lines = {f"{other} less {one}, {axis}": e for axis, e in zip("xyz", offset, strict=True)}
    return Result(lines, (f"add it to place_mm when {other} prints what {one} was set up for",))
