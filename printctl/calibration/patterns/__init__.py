"""Calibration prints (lines, spiral, joint, bridge, comb, squares) and sheets to measure them.

Goes in: printer, ink, needle and speeds. Comes out: a test print, its drawing, a sheet to fill in.
Begin with `plan.py`.
"""

from printctl.calibration.patterns.files import (
    CLEAR,
    COLUMNS,
    PatternSetUp,
    WrittenPattern,
    filled_text,
    read_pattern,
    read_printed_lines,
    sheet_svg,
    sheet_text,
    width_row,
)
from printctl.calibration.patterns.kinds import (
    LineSeries,
    bridge_pattern,
    comb_pattern,
    joint_pattern,
    lines_pattern,
    spiral_pattern,
    squares_pattern,
)
from printctl.calibration.patterns.plan import (
    Bead,
    Pattern,
    Stroke,
    pattern_path,
)

__all__ = [
    "CLEAR",
    "COLUMNS",
    "Bead",
    "LineSeries",
    "Pattern",
    "PatternSetUp",
    "Stroke",
    "WrittenPattern",
    "bridge_pattern",
    "comb_pattern",
    "filled_text",
    "joint_pattern",
    "lines_pattern",
    "pattern_path",
    "read_pattern",
    "read_printed_lines",
    "sheet_svg",
    "sheet_text",
    "spiral_pattern",
    "squares_pattern",
    "width_row",
]
