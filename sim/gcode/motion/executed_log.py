"""Convert the simulated stepper's log from steps to `ExecutedMotion` in mm."""

from __future__ import annotations

import numpy as np

from firmware_profiles import Printer
from sim.gcode.motion.executed import ExecutedMotion
from sim.gcode.motion.state import Records


def executed_motion(log: Records, printer: Printer) -> ExecutedMotion:
    """Blocks that ran, (n,) of `LOG`, in mm and s."""
    axes = printer.steps_per_mm
    per_mm = np.array([axes.x, axes.y, axes.z])
    heads = range(printer.head_count)
    plunger = np.array([printer.of_head(number).steps_per_mm.e for number in heads])[log["tool"]]
    return ExecutedMotion(
        start=log["start"][:, :3] / per_mm,
        end=log["end"][:, :3] / per_mm,
        plunger_start=log["start"][:, 3] / plunger,
        plunger_end=log["end"][:, 3] / plunger,
        time_start=log["time_start"].copy(),
        time_end=log["time_end"].copy(),
        line=log["line"].copy(),
        tool=log["tool"].copy(),
    )
