"""Measured widths and replies, and the sheet that they are typed into."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from printctl.calibration.patterns import COLUMNS, Pattern, WrittenPattern
from printctl.calibration.readings import Readings, read_readings
from printctl.errors import UsageError

END: Final = 0.93
"""Of a line's length: beyond lies what its end does."""


@dataclass(frozen=True)
class Widths:
    """Measured widths along strokes.

    Attributes
    ----------
    number : (n,) int64
        Stroke of each.
    x_mm, width_mm : (n,) float64, mm
        Way from the stroke's begin, and width there.
    last_digit_mm : float, mm
        Of a typed width.
    found : dict of int to float
        Share of each stroke at which a picture shows ink; empty of typed widths.
    optics : float
        Half of the relative 95 % interval of all widths, from what a picture's edges mean.
    """

    number: NDArray[np.int64]
    x_mm: FloatArray
    width_mm: FloatArray
    last_digit_mm: float = 0.0
    found: Mapping[int, float] = field(default_factory=dict)
    optics: float = 0.0

    def of(self, number: int) -> tuple[FloatArray, FloatArray]:
        """Places and widths of one stroke."""
        rows = self.number == number
        return self.x_mm[rows], self.width_mm[rows]


@dataclass(frozen=True)
class Replies:
    """A number for each question: a gap in mm, 0 where closed; or 1 for held, 0 for not.

    Attributes
    ----------
    number : (n,) int64
    reply : (n,) float64
    part : (n,) float64
        Share of the ways across that are open; of typed ones 0 or 1.
    least_mm : float, mm
        Narrower gaps can't be seen in the picture; 0 of typed ones.
    """

    number: NDArray[np.int64]
    reply: FloatArray
    part: FloatArray
    least_mm: float = 0.0


_FAR: Final = 5.0
"""Times wider or narrower than commanded: questioned."""
_EXPECTED_MM: Final = 2e-4
"""Rounding of the sheet's expected widths, and some."""
_MICRONS: Final = 100.0
"""Times wider: typed in µm."""


def read_sheet(path: Path, written: WrittenPattern) -> Widths | Replies:
    """Read a pattern's sheet: widths of lines or a spiral, replies of a comb, joints or bridges.

    Raises
    ------
    UsageError
        For another print's sheet, or a number that can't be one in mm or an answer.
    """
    if written.pattern.name in ("lines", "spiral"):
        return _typed_widths(path, written)
    return _typed_replies(path, written)


def _typed_widths(path: Path, written: WrittenPattern) -> Widths:
    data = _read(path, written, ("line", "x_mm", "width_mm"))
    strokes = {stroke.number: stroke for stroke in written.pattern.strokes if stroke.number}
    number, x = data.numbers["line"], data.numbers["x_mm"]
    width = data.numbers["width_mm"]
    for line, at, wide in zip(number.tolist(), x.tolist(), width.tolist(), strict=True):
        where = f"{path}, line {line:g} at {at:g} mm"
        if line not in strokes:
            raise UsageError(f"{where}: the pattern has no such line")
        if not 0 <= at <= strokes[int(line)].length_mm + 1e-6:
            raise UsageError(f"{where}: it is {strokes[int(line)].length_mm:g} mm long (x_mm)")
        _check_width(where, wide, written.pattern.bead.width_at(strokes[int(line)].flow))
    if "expected_mm" in data.header:
        _check_expected(path, written)
    return Widths(number.astype(np.int64), x, width, data.last_digit["width_mm"])


def _check_expected(path: Path, written: WrittenPattern) -> None:
    """Raise where the sheet's expected widths aren't the pattern's: columns were swapped."""
    data = _read(path, written, ("line", "expected_mm", "width_mm"))
    strokes = {stroke.number: stroke for stroke in written.pattern.strokes if stroke.number}
    number, expected = data.numbers["line"], data.numbers["expected_mm"]
    for line, value in zip(number.tolist(), expected.tolist(), strict=True):
        stroke = strokes.get(int(line))
        commanded = None if stroke is None else written.pattern.bead.width_at(stroke.flow)
        if commanded is not None and abs(value - commanded) > _EXPECTED_MM:
            raise UsageError(
                f"{path}, line {line:g}: expected_mm is {value:g}, and the pattern's is "
                f"{commanded:.4f}; columns or rows were exchanged, so fill in the last column of "
                "a fresh sheet"
            )


def _typed_replies(path: Path, written: WrittenPattern) -> Replies:
    pattern = written.pattern
    first, last = COLUMNS[pattern.name][0], COLUMNS[pattern.name][-1]
    data = _read(path, written, (first, last))
    number, reply = data.numbers[first], data.numbers[last]
    known = {one.number for one in pattern.questions}
    for one, value in zip(number.tolist(), reply.tolist(), strict=True):
        where = f"{path}, {first} {one:g}"
        if one not in known:
            raise UsageError(f"{where}: the pattern has no such {first}")
        _check_reply(where, pattern, last, value)
    if len(set(number.tolist())) < len(number):
        raise UsageError(f"{path}: a {first} is answered twice; one row each")
    return Replies(number.astype(np.int64), reply, (reply > 0).astype(np.float64))


def _read(path: Path, written: WrittenPattern, columns: tuple[str, ...]) -> Readings:
    data = read_readings(path, columns)
    number = data.facts.get("pattern")
    if number is not None and int(number) != written.number:
        raise UsageError(
            f"{path} is the sheet of pattern no. {number:.0f}, and the pattern's file is of no. "
            f"{written.number}; give the one that belongs to it (--pattern)"
        )
    return data


def _check_width(where: str, wide: float, commanded: float) -> None:
    if wide <= 0:
        raise UsageError(
            f"{where}: width_mm {wide:g} isn't above 0; leave it blank where there is no line"
        )
    if wide > _MICRONS * commanded:
        raise UsageError(
            f"{where}: width_mm {wide:g}, of a line commanded {commanded:g} mm wide; that looks "
            f"like µm: write {wide / 1e3:g}"
        )
    if not commanded / _FAR < wide < commanded * _FAR:
        raise UsageError(
            f"{where}: width_mm {wide:g} is more than {_FAR:g} times off the {commanded:g} mm "
            "commanded; if it is so, leave it blank: nothing could be fitted to such a line"
        )


def _check_reply(where: str, pattern: Pattern, column: str, value: float) -> None:
    if column == "held":
        if value not in (0, 1):
            raise UsageError(f"{where}: held is {value:g}; write 1 where it held, 0 where not")
        return
    if value < 0:
        raise UsageError(f"{where}: gap_mm {value:g} is below 0; write 0 where it closed")
    widest = max(abs(one.value) for one in pattern.questions) + 4 * pattern.bead.width_mm
    if value > _MICRONS / 10 * widest:
        raise UsageError(f"{where}: gap_mm {value:g} looks like µm: write {value / 1e3:g}")
    if value > 2 * widest:
        raise UsageError(
            f"{where}: gap_mm {value:g} is wider than anything in this pattern ({widest:g} mm)"
        )
