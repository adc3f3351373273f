"""Ink volume of each move: from E and the syringe bore, or from valve time and flow."""

from __future__ import annotations

import math

import numpy as np

from kernels.arrays import FloatArray
from printctl.checks.gcode_view.pushing import Pushing
from printctl.checks.gcode_view.rows import Rows
from printctl.rounding import last_digit_mm
from registration.report.gcode import Act
from sim.gcode.program.gcode import Program
from sim.gcode.reading.comments import Comments


def plunger_doses(
    rows: Rows, program: Program, comments: Comments, pushing: Pushing
) -> tuple[FloatArray, float, str]:
    """Doses of a plunger.

    Returns
    -------
    dose : (n,) float64, µL
        Below 0 where it goes back.
    digit_ul : float, µL
        What E's last digit stands for.
    note : str
        Where the bore comes from.
    """
    bore, whence = pushing.bore_mm, pushing.bore_said
    if bore is None and comments.filament_mm is not None:
        bore, whence = comments.filament_mm, "filament_diameter in the file"
    if bore is None:
        bore, whence = pushing.syringe_mm, pushing.syringe_said
    area = math.pi * bore**2 / 4
    note = f"1 mm of E is {area:.4g} µL (bore {bore:g} mm: {whence})."
    return rows.plunger * area, last_digit_mm(program.plunger) * area, note


def valve_doses(rows: Rows, program: Program, pushing: Pushing) -> tuple[FloatArray, str]:
    """Doses of a pneumatic head, (n,), µL, NaN where its flow isn't known; and a note on it."""
    head = pushing.printer.pneumatic
    measured = head.measured.flow_ul_s if head and head.measured else None
    flow = pushing.flow_ul_s or measured
    open_for = np.where(rows.act == Act.WRITE, rows.way / program.feed[rows.row], 0.0)
    if flow is None:
        unknown = np.where(rows.act == Act.WRITE, np.nan, 0.0)
        return unknown, (
            f"Nobody measured the flow of {pushing.printer.name}, so widths and volumes aren't "
            "known; --flow-ul-s says it."
        )  # fmt: skip
    whose = "--flow-ul-s" if pushing.flow_ul_s else "measured, printer's profile"
    return open_for * flow, (
        f"While the valve is open {flow:.4g} µL/s flow ({whose}), at the speed that is fed: "
        "lag, corners and delays aren't in it."
    )  # fmt: skip
