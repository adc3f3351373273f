"""`printctl calibrate level`: how level bed and bath are, and how deep the bath."""

from __future__ import annotations

from typing import Annotated

import typer

from printctl.calibration import fit_level, gap_between
from printctl.cli.calibrate_options import Csv, given, numbers_of, tell
from printctl.cli.options import JsonFlag
from printctl.errors import UsageError


def level(
    readings: Csv = None,
    part: Annotated[
        str, typer.Option("--part", metavar="X,Y", help="Size of the part, mm.")
    ] = "20,20",
    as_json: JsonFlag = False,
) -> None:
    """Level of bed and bath: CSV with surface (bed or bath), x_mm, y_mm and z_mm of touches.

    Three places of each at least, not in a row; more tell how sure the tilt is.
    """
    data = given(readings, ("x_mm", "y_mm", "z_mm"), ("surface",))
    unknown = set(data.words["surface"]) - {"bed", "bath"}
    if unknown:
        raise UsageError(f"surface {sorted(unknown)[0]!r} is neither bed nor bath")
    size = numbers_of(part, "--part")
    width, depth = size[0], size[-1]
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
            f"{surface}: {plane.rise_mm(width, depth):.3f} mm across a part of {part} mm; points "
            f"scatter by {plane.flatness_mm:.3g} mm about the plane"
        )
    if len(planes) == 2:
        lines["depth of the bath (bath_depth_mm)"] = gap_between(planes["bed"], planes["bath"])
    tell(lines, notes, as_json)
