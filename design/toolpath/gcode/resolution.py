"""Derive from a printer: shortest move, ink's clearance from lumens, longest infill joint."""

from __future__ import annotations

from design.toolpath.fresh.options import FreshOptions
from design.toolpath.gcode.commands import MARGIN_STEPS
from firmware_profiles import Printer


def least_move_mm(printer: Printer) -> float:
    """Shortest move, along the longer of x and y, that the firmware doesn't merge, mm."""
    steps = printer.min_steps_per_segment + MARGIN_STEPS
    return steps / min(printer.steps_per_mm.x, printer.steps_per_mm.y)


def clear_mm(printer: Printer) -> float:
    """How far ink should keep from a lumen, mm: an eighth of a motor step.

    Points are rounded by up to half a step either way. Keeping half a step away would make every
    lumen wider than designed on a machine that is finer than its steps; an eighth leaves both
    errors about the same (benchmarks/solids.py: 80 steps/mm).
    """
    return 0.125 / min(printer.steps_per_mm.x, printer.steps_per_mm.y)


def joint_mm(printer: Printer) -> float:
    """Longest joint of two infill lines, mm: none where ink flows by time, as turns take longer."""
    return 0.0 if printer.pneumatic else FreshOptions.joint_mm
