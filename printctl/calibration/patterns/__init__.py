"""Calibration prints (lines, spiral, joint, bridge, comb, squares) and sheets to measure them.

Goes in: printer, ink, needle and speeds. Comes out: a test print, its drawing, a sheet to fill in.
Begin with `plan.py`.
"""

from printctl.calibration.patterns.files import PatternSetUp, WrittenPattern, read_pattern
from printctl.calibration.patterns.lines import LineSeries, lines_pattern, spiral_pattern
from printctl.calibration.patterns.meetings import bridge_pattern, comb_pattern, joint_pattern
from printctl.calibration.patterns.plan import Bead, Pattern, PatternName, Question, Stroke
from printctl.calibration.patterns.sheet import sheet_svg
from printctl.calibration.patterns.squares import squares_pattern
from printctl.calibration.patterns.table import (
    CLEAR,
    COLUMNS,
    filled_text,
    sheet_text,
    speed_at,
    width_row,
)
from printctl.calibration.patterns.toolpath import pattern_path

__all__ = [
    "CLEAR",
    "COLUMNS",
    "Bead",
    "LineSeries",
    "Pattern",
    "PatternName",
    "PatternSetUp",
    "Question",
    "Stroke",
    "WrittenPattern",
    "bridge_pattern",
    "comb_pattern",
    "filled_text",
    "joint_pattern",
    "lines_pattern",
    "pattern_path",
    "read_pattern",
    "sheet_svg",
    "sheet_text",
    "speed_at",
    "spiral_pattern",
    "squares_pattern",
    "width_row",
]
