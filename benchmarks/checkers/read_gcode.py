"""Read any slicer's G-code as lines with a width, without product code.

Read are G0, G1 (X, Y, Z, E, F), G90, G91, G92, M82 and M83; anything that would move the needle
otherwise is refused. Lengths are mm, speeds mm/s, volumes µL, times s.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
WINDOW_MM = 1.0
_HARMLESS = ("G21", "G4", "M", "T", "SET_", "F")
_STILL = 1e-9


@dataclass(frozen=True)
class Moves:
    """Moves (n,) in the order of the file.

    ``line`` in the file, from 1; ``start``, ``end`` (n, 3), mm; ``pushed``: change of E; ``speed``
    of the tip, of E alone where the tip stands, mm/s, NaN where no F was given yet.
    """

    line: NDArray[np.int64]
    start: FloatArray
    end: FloatArray
    pushed: FloatArray
    speed: FloatArray

    @property
    def length(self) -> FloatArray:
        """Of each move, (n,), mm."""
        length: FloatArray = np.linalg.norm(self.end - self.start, axis=1)
        return length

    @property
    def writes(self) -> NDArray[np.bool_]:
        """Whether ink is laid: the tip goes and E grows."""
        return (self.length > _STILL) & (self.pushed > 0)

    @property
    def stands(self) -> NDArray[np.bool_]:
        """Whether only the plunger moves."""
        return self.length <= _STILL


@dataclass(frozen=True)
class Lines:
    """Lines that were written: stadiums seen from above, (n, 2) to (n, 2), width, z (n,), mm."""

    start: FloatArray
    end: FloatArray
    width: FloatArray
    z: FloatArray


def read_moves(text: str, begin: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Moves:
    """Read a file; where an axis stands before it is first named comes from ``begin``.

    A line that would move the needle in a way this reader doesn't know is refused (ValueError).
    """
    at, feed = [*begin, 0.0], float("nan")
    relative, relative_e = False, False
    rows: list[list[float]] = []
    for number, raw in enumerate(text.splitlines(), 1):
        words = raw.split(";", 1)[0].split()
        if not words:
            continue
        code, rest = words[0], words[1:]
        if code in ("G0", "G1"):
            to = list(at)
            for word in rest:
                axis, value = "XYZE".find(word[0]), float(word[1:])
                if word[0] == "F":
                    feed = value / 60.0
                elif axis >= 0:
                    adds = relative_e if axis == 3 else relative
                    to[axis] = at[axis] + value if adds else value
            rows.append([number, *at[:3], *to[:3], to[3] - at[3], feed])
            at = to
        elif code == "G92":
            for word in rest:
                at["XYZE".index(word[0])] = float(word[1:])
        elif code in ("G90", "G91"):
            relative = relative_e = code == "G91"
        elif code in ("M82", "M83"):
            relative_e = code == "M83"
        elif not code.startswith(_HARMLESS):
            raise ValueError(f"line {number}: {raw!r} isn't read by this checker")
    found = np.array(rows, dtype=np.float64).reshape(-1, 9)
    line = found[:, 0].astype(np.int64)
    return Moves(line, found[:, 1:4], found[:, 4:7], found[:, 7], found[:, 8])


def rounded_to_steps(moves: Moves, steps_per_mm: float) -> Moves:
    """The same moves as a motor of whole steps makes them, X and Y."""
    start, end = moves.start.copy(), moves.end.copy()
    for made in (start, end):
        made[:, :2] = np.rint(made[:, :2] * steps_per_mm) / steps_per_mm
    return replace(moves, start=start, end=end)


def written_lines(moves: Moves, ul_per_e: float, layer_mm: float, *, planned: Moves) -> Lines:
    """Return the lines that ink flowed in: rectangles with round sides, w h - (1 - pi/4) h².

    E is written with few digits, so that its change over a short move says little: what counts is
    its change over `WINDOW_MM` of way about the move, within one stroke. ``planned`` gives the
    lengths that volumes were planned for.
    """
    wrote, length = _wrote(moves, planned)
    stroke = np.cumsum(~wrote)[wrote].astype(np.int64)
    flow = _flow(length[wrote], moves.pushed[wrote], stroke)
    width = flow * ul_per_e / layer_mm + layer_mm * (1 - np.pi / 4)
    return Lines(moves.start[wrote, :2], moves.end[wrote, :2], width, moves.end[wrote, 2])


def own_lines(moves: Moves, ul_per_e: float, layer_mm: float, *, planned: Moves) -> Lines:
    """Return lines with round sides, each by its own change of E alone."""
    wrote, length = _wrote(moves, planned)
    area = moves.pushed[wrote] / length[wrote] * ul_per_e
    round_part = np.pi / 4 * layer_mm**2
    wide = (area - round_part) / layer_mm + layer_mm
    width = np.where(area > round_part, wide, 2 * np.sqrt(area / np.pi))
    return Lines(moves.start[wrote, :2], moves.end[wrote, :2], width, moves.end[wrote, 2])


def _wrote(moves: Moves, planned: Moves) -> tuple[NDArray[np.bool_], FloatArray]:
    """Return which moves write across, (n,), and their planned lengths, mm."""
    length = np.linalg.norm((planned.end - planned.start)[:, :2], axis=1)
    return (moves.pushed > 0) & (length > 1e-6), length


def _flow(length: FloatArray, pushed: FloatArray, stroke: NDArray[np.int64]) -> FloatArray:
    """E per mm about each move of its stroke."""
    along, filled = np.cumsum(length), np.cumsum(pushed)
    first = np.flatnonzero(np.diff(stroke, prepend=-1))
    last = np.append(first[1:], len(stroke)) - 1
    which = np.searchsorted(first, np.arange(len(stroke)), side="right") - 1
    begin, end = (along - length)[first][which], along[last][which]
    middle = along - length / 2
    low = np.clip(middle - WINDOW_MM / 2, begin, np.maximum(end - WINDOW_MM, begin))
    high = np.clip(low + WINDOW_MM, begin, end)
    places, total = np.append(0.0, along), np.append(0.0, filled)
    found: FloatArray = (np.interp(high, places, total) - np.interp(low, places, total)) / (
        high - low
    )
    return found
