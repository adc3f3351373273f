"""Executed motion from the places it goes through."""

from typing import Any

import numpy as np

from gcode.motion.executed import ExecutedMotion


def moved(points: Any, volume_ul: Any, area_mm2: float, times: Any = None) -> ExecutedMotion:
    """Blocks from point to point, each of a volume; a second each where no times (n + 1) are said.

    ``area_mm2`` is the plunger's.
    """
    where = np.array(points, dtype=float)
    plunger = np.concatenate([[0.0], np.cumsum(volume_ul)]) / area_mm2
    time = np.arange(len(where), dtype=float) if times is None else times
    return ExecutedMotion(
        where[:-1], where[1:], plunger[:-1], plunger[1:], time[:-1], time[1:],
        np.arange(len(volume_ul)),
    )  # fmt: skip
