"""Weighing, backlash and lag calibration tests: toolpath from the tip's position, sheet to fill in.

The G-code writer of every print turns them into the firmware's words.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from design.toolpath import MoveBuilder, Toolpath
from firmware_profiles import Ink, Pneumatic, Syringe
from printctl.calibration.lag import LagPattern

Axis = Literal["x", "y", "z", "e"]
_LIFT_MM = 2.0
_STEADY = (0.55, 0.65, 0.75, 0.85, 0.95)
_AFTER_CHANGE = (0.01, 0.02, 0.04, 0.07, 0.1, 0.15, 0.2, 0.3, 0.4, 0.55, 0.75, 0.95)
"""Shares of a stretch at which a line's width is measured: close together after a change."""


@dataclass(frozen=True)
class CalibrationTest:
    """What a test does, and the sheet that its readings are written into.

    Attributes
    ----------
    toolpath : Toolpath
    columns : tuple of str
        Of the sheet; the last one is to be filled in.
    rows : sequence of sequence of str
        Without the last column.
    facts : mapping
        Numbers that stand above the sheet.
    """

    toolpath: Toolpath
    columns: tuple[str, ...]
    rows: Sequence[Sequence[str]]
    facts: Mapping[str, float] = field(default_factory=dict)


def weighing_test(
    doses_ul: Sequence[float],
    flow_ul_s: float,
    wait_s: float,
    syringe: Syringe,
    head: Pneumatic | None = None,
) -> CalibrationTest:
    """Push doses, standing still, with a wait before each and after the last.

    The sheet has the plunger's travel of each; of a pneumatic head the seconds from the opening
    command to the closing one.

    Parameters
    ----------
    doses_ul : (n,) µL
    flow_ul_s : float, µL/s
    wait_s : float, s
        To put the next vial under the needle.
    """
    if head is None:
        column, doses = "travel_mm", [f"{dose / syringe.area_mm2:.5f}" for dose in doses_ul]
    else:
        delay_s = np.ceil(head.opening_delay_s * 1e3) / 1e3
        column = "open_s"
        doses = [f"{round(dose / flow_ul_s, 3) + delay_s:.3f}" for dose in doses_ul]
    builder = MoveBuilder((0, 0, 0), "layer")
    for index, dose in enumerate(doses_ul):
        builder.dwell(wait_s, index)
        builder.plunge(dose, flow_ul_s, index)
    builder.dwell(wait_s, -1)
    toolpath = builder.build(must_write=False)
    return CalibrationTest(toolpath, (column, "mass_mg"), [[one] for one in doses])


def backlash_test(
    axis: Axis,
    targets_mm: ArrayLike,
    *,
    overshoot_mm: float,
    speed_mm_s: float,
    wait_s: float,
    syringe: Syringe,
) -> CalibrationTest:
    """Come to each target from below and from above, and wait there for the dial to be read.

    The sheet names each target and its approach: 1 from below, -1 from above.
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
    rows = [[f"{target:g}", f"{side:g}"] for target, side in zip(targets, approach, strict=True)]
    columns = ("target_mm", "approach", "measured_mm")
    return CalibrationTest(builder.build(must_write=False), columns, rows)


def lag_test(pattern: LagPattern, lines: int, ink: Ink) -> CalibrationTest:
    """Write lines slow, fast, slow, side by side; the tip begins where the first line does.

    Parameters
    ----------
    pattern : LagPattern
        Stands above the sheet, which has the places at which a line's width is measured.
    lines : int
    ink : Ink
        Primed before each line, and taken back after it, by its own retraction.
    """
    spacing_mm = 10 * pattern.width_mm
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
        builder.plunge(ink.retract_ul, ink.plunger_ul_s, line)
        builder.write(np.column_stack([ends, 0 * ends + y, 0 * ends]), volume, speeds, line)
        builder.plunge(-ink.retract_ul, ink.plunger_ul_s, line)
    rows = [
        [f"{round(pattern.length_mm * (stretch + share), 3):g}"]
        for stretch, shares in enumerate((_STEADY, _AFTER_CHANGE, _AFTER_CHANGE))
        for share in shares
    ]
    return CalibrationTest(builder.build(), ("x_mm", "width_mm"), rows, pattern.facts())
