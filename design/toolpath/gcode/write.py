"""Write a toolpath as G-code for one printer and syringe."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from design.errors import ToolpathError
from design.toolpath.gcode.air import valve_lines
from design.toolpath.gcode.dialect import dialect_of
from design.toolpath.gcode.job import Gcode, GcodeOptions
from design.toolpath.gcode.marks import marks_of
from design.toolpath.gcode.numbers import FEED_DECIMALS, decimals_for
from design.toolpath.gcode.render import render
from design.toolpath.gcode.table import place_text, tabulate
from design.toolpath.gcode.trip import round_trip
from design.toolpath.toolpath import FloatArray, Toolpath
from firmware_profiles import Printer, Syringe

#: Room that the link needs on each line: a number, ``N1234567 ``, and a checksum, ``*255``.
LINK_BYTES = 13


def write_gcode(
    toolpath: Toolpath,
    printer: Printer,
    syringe: Syringe,
    place_mm: ArrayLike,
    options: GcodeOptions | None = None,
) -> Gcode:
    """Write ``toolpath``, moved by ``place_mm``, in the dialect of the printer's firmware.

    Positions are absolute mm (G21, G90); E is the plunger's absolute travel in mm (M82) and is
    rounded once from the running total, so that it never drifts. The job doesn't home. It goes
    straight up or down to a height above the whole toolpath, across, and down to the first
    point; so the tip must begin outside the dish's walls and no lower than they allow. At the end
    it relieves the plunger and goes straight up. Feeds are lowered where an axis' limit asks
    for it. Writing moves shorter than the firmware's least are merged. Comments mark where the
    job may be interrupted (`design.toolpath.gcode.marks`).

    A pneumatic head's job has no E: a valve opens before each written path and closes after it,
    and the speed of each move follows from the flow (`design.toolpath.gcode.air`).

    Parameters
    ----------
    toolpath : Toolpath
    printer : Printer
    syringe : Syringe
    place_mm : (3,) array, mm
        From the part's frame to the printer's.
    options : GcodeOptions

    Raises
    ------
    ToolpathError
        For a second head (not written yet), a line longer than the firmware takes, one move
        that pushes more than E can hold, or a speed that a pneumatic head's flow asks for and
        printer or ink don't bear.
    """
    options = options or GcodeOptions()
    place = np.asarray(place_mm, dtype=np.float64)
    _check(toolpath, place)
    dialect = dialect_of(printer)
    trip = round_trip(toolpath, printer, syringe, place, options)
    digits = decimals_for(printer)
    table = tabulate(trip, printer, declares=not dialect.declares)
    text, longest = render(table, (digits.x, digits.y, digits.z, digits.e, FEED_DECIMALS, 0))
    if longest > printer.max_line_bytes - LINK_BYTES:
        raise ToolpathError(
            f"a G-code line of {longest} bytes leaves no room for number and checksum within "
            f"{printer.max_line_bytes} bytes (profile {printer.name!r}: max_line_bytes); use a "
            "printer with longer lines"
        )
    start = place_text(trip, printer) if trip.known else None
    header, footer = dialect.header(printer, start), dialect.footer()
    marks = marks_of(toolpath, table)
    if printer.pneumatic:
        doses = options.standing_doses
        marks = valve_lines(toolpath, table, printer.pneumatic, marks, standing_doses=doses)
    source, move = (np.insert(of, marks.row, -1) for of in (table.source, table.move))
    return Gcode(
        data="".join(f"{line}\n" for line in header).encode()
        + marks.put_into(text)
        + "".join(f"{line}\n" for line in footer).encode(),
        line_source=np.pad(source, (len(header), len(footer)), constant_values=-1),
        line_move=np.pad(move, (len(header), len(footer)), constant_values=-1),
        source_kind=toolpath.source_kind,
    )


def _check(toolpath: Toolpath, place: FloatArray) -> None:
    if place.shape != (3,) or not np.isfinite(place).all():
        raise ToolpathError(f"place_mm is {place}; give three finite numbers, mm")
    heads = np.unique(toolpath.tool)
    if len(heads) > 1:
        raise ToolpathError(f"toolpath uses heads {heads.tolist()}; only one can be written yet")
