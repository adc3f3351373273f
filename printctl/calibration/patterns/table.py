"""Make the CSV text of a calibration pattern's measuring sheet, blank or filled in."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from typing import Final

import numpy as np

from kernels.arrays import FloatArray
from printctl.calibration.patterns.files import WrittenPattern
from printctl.calibration.patterns.plan import Pattern, Stroke

COLUMNS: Final = {
    "lines": ("line", "x_mm", "speed_mm_s", "flow", "expected_mm", "width_mm"),
    "spiral": ("line", "x_mm", "speed_mm_s", "flow", "expected_mm", "width_mm"),
    "comb": ("gap", "commanded_mm", "expected_mm", "gap_mm"),
    "joint": ("joint", "overlap_radii", "gap_mm"),
    "bridge": ("bridge", "span_mm", "held"),
}
HINTS: Final = {
    "lines": "width_mm at x_mm from the line's begin (the dot); leave blank where there is none",
    "spiral": "width_mm at x_mm along the line from its begin, in the middle (the dot)",
    "comb": "gap_mm between edges; 0 where the teeth touch",
    "joint": "gap_mm between the branch's end and the trunk; 0 where they are joined",
    "bridge": "held: 1 where the line bridges the gap, 0 where it sank or broke",
}
CLEAR: Final = 1.0
"""Widths to either side of a step of speed that aren't measured."""
_PLAIN: Final = (0.55, 0.7, 0.85)
_AFTER: Final = (0.03, 0.08, 0.15, 0.25, 0.4, 0.6, 0.8, 0.95)
_STEADY: Final = (0.55, 0.75, 0.95)
_SPIRAL: Final = 24


def sheet_text(written: WrittenPattern) -> str:
    """Return the CSV file with its last column to be filled in."""
    pattern = written.pattern
    return _table(written, [[*row, ""] for row in _rows(pattern, written.mounted.swell_factor)])


def filled_text(written: WrittenPattern, rows: Iterable[list[str]]) -> str:
    """Return the CSV file with rows that were measured."""
    return _table(written, rows)


def width_row(stroke: Stroke, x_mm: float, pattern: Pattern, swell: float | None) -> list[str]:
    """Columns of a width before its last one."""
    expected = pattern.bead.width_at(stroke.flow) * (swell or 1.0)
    speed = speed_at(stroke, np.array([x_mm]))[0]
    return [f"{stroke.number}", f"{x_mm:.3f}", f"{speed:g}", f"{stroke.flow:g}", f"{expected:.4f}"]


def speed_at(stroke: Stroke, x_mm: FloatArray) -> FloatArray:
    """Commanded speed at places along a stroke, (n,), mm/s."""
    ends = np.cumsum(np.linalg.norm(np.diff(stroke.points, axis=0), axis=1))
    at = np.searchsorted(ends - 1e-9, x_mm, side="left")
    return np.asarray(stroke.speed_mm_s[np.minimum(at, len(ends) - 1)])


def _table(written: WrittenPattern, rows: Iterable[list[str]]) -> str:
    text = io.StringIO()
    text.write(f"# pattern={written.number}\n# {HINTS[written.pattern.name]}\n")
    columns = list(COLUMNS[written.pattern.name])
    csv.writer(text, lineterminator="\n").writerows([columns, *rows])
    return text.getvalue()


def _rows(pattern: Pattern, swell: float | None) -> list[list[str]]:
    if pattern.name in ("lines", "spiral"):
        return [
            width_row(stroke, x, pattern, swell)
            for stroke in pattern.of_role("line", "step", "spiral")
            for x in _places(stroke, pattern.bead.width_mm)
        ]
    wide = pattern.bead.width_mm * ((swell or 1.0) - 1.0)
    return [
        [
            f"{one.number}",
            f"{one.value:g}",
            *([f"{max(one.value - wide, 0.0):.4f}"] if pattern.name == "comb" else []),
        ]
        for one in pattern.questions
    ]


def _places(stroke: Stroke, width_mm: float) -> list[float]:
    """Where to measure: where a line is steady, and close together after a change of speed."""
    length = stroke.length_mm
    if stroke.role == "line":
        return [length * part for part in _PLAIN]
    if stroke.role == "spiral":
        return (length * (np.arange(_SPIRAL) + 0.5) / _SPIRAL).tolist()
    stretch = length / 3
    parts = ((0, _STEADY), (1, _AFTER), (2, _AFTER))
    clear = CLEAR * width_mm
    return [stretch * k + max(stretch * part, clear) for k, which in parts for part in which]
