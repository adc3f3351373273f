"""Toolpaths of the weighing, backlash and lag calibration tests, from the tip's position.

The G-code writer of every print turns them into the firmware's words.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from design.toolpath import MoveBuilder, Toolpath
from firmware_profiles import Syringe
from kernels.arrays import FloatArray
from printctl.calibration.lag import LagPattern

Axis = Literal["x", "y", "z", "e"]
_LIFT_MM = 2.0


def weighing_path(doses_ul: ArrayLike, flow_ul_s: float, wait_s: float) -> Toolpath:
    """Push doses, standing still, with a wait before each and after the last.

    Parameters
    ----------
    doses_ul : (n,) µL
    flow_ul_s : float, µL/s
    wait_s : float, s
        To put the next vial under the needle.
    """
    builder = MoveBuilder((0, 0, 0), "layer")
    for index, dose in enumerate(np.asarray(doses_ul, dtype=np.float64).tolist()):
        builder.dwell(wait_s, index)
        builder.plunge(dose, flow_ul_s, index)
    builder.dwell(wait_s, -1)
    return builder.build(must_write=False)


def backlash_path(
    axis: Axis,
    targets_mm: ArrayLike,
    *,
    overshoot_mm: float,
    speed_mm_s: float,
    wait_s: float,
    syringe: Syringe,
) -> tuple[Toolpath, FloatArray, FloatArray]:
    """Come to each target from below and from above, and wait there for the dial to be read.

    Returns
    -------
    toolpath : Toolpath
    targets : (2 n,) float64, mm
    approach : (2 n,) float64
        +1 from below, -1 from above, in the order of the waits.
    """
    targets = np.repeat(np.asarray(targets_mm, dtype=np.float64), 2)
    approach = np.tile([1.0, -1.0], len(targets) // 2)
    builder = MoveBuilder((0, 0, 0), "layer")
    at, per_mm = 0.0, syringe.area_mm2
    for target, side in zip(targets.tolist(), approach.tolist(), strict=True):
        for place in (target - side * overshoot_mm, target):
            if axis == "e":
                builder.plunge((place - at) * per_mm, speed_mm_s * per_mm, 0)
            else:
                point = np.where([axis == name for name in "xyz"], place, 0.0)
                builder.travel(point[None], speed_mm_s, 0)
            at = place
        builder.dwell(wait_s, 0)
    return builder.build(must_write=False), targets, approach


def lag_path(
    pattern: LagPattern, lines: int, *, prime_ul: float, flow_ul_s: float, spacing_mm: float
) -> Toolpath:
    """Write lines slow, fast, slow, side by side; the tip begins where the first line does.

    Parameters
    ----------
    pattern : LagPattern
    lines : int
    prime_ul, flow_ul_s : float, µL, µL/s
        Before and (taken back) after each line.
    spacing_mm : float, mm
    """
    builder = MoveBuilder((0, 0, 0), "layer", pattern.layer_mm)
    speeds = np.array([pattern.slow_mm_s, pattern.fast_mm_s, pattern.slow_mm_s])
    ends = np.arange(1, 4) * pattern.length_mm
    volume = np.full(3, pattern.area_mm2 * pattern.length_mm)
    for line in range(lines):
        y = line * spacing_mm
        if line:
            x, before = 3 * pattern.length_mm, y - spacing_mm
            over = np.array([[x, before, _LIFT_MM], [0, y, _LIFT_MM], [0, y, 0]])
            builder.travel(over, pattern.fast_mm_s, line)
        builder.plunge(prime_ul, flow_ul_s, line)
        builder.write(np.column_stack([ends, 0 * ends + y, 0 * ends]), volume, speeds, line)
        builder.plunge(-prime_ul, flow_ul_s, line)
    return builder.build()
