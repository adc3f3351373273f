"""Read any slicer's G-code as lines with a width, without product code.

Read are G0, G1 (X, Y, Z, E), G92 and M82 or M83; anything that would move the needle otherwise is
refused. Lengths are mm, volumes µL.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
WINDOW_MM = 1.0
_HARMLESS = ("G4", "G21", "G90", "M", "T", "SET_", "F")


@dataclass(frozen=True)
class Moves:
    """Moves in the order of the file.

    Attributes
    ----------
    start, end : (n, 3) float64, mm
    pushed : (n,) float64
        Change of E.
    """

    start: FloatArray
    end: FloatArray
    pushed: FloatArray


@dataclass(frozen=True)
class Lines:
    """Lines that were written: stadiums seen from above.

    Attributes
    ----------
    start, end : (n, 2) float64, mm
    width, z : (n,) float64, mm
    """

    start: FloatArray
    end: FloatArray
    width: FloatArray
    z: FloatArray


def read_moves(text: str, begin: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Moves:
    """Every move of a file; where an axis stands before it is first named comes from ``begin``."""
    at, relative = [*begin, 0.0], False
    rows: list[list[float]] = []
    for number, raw in enumerate(text.splitlines(), 1):
        words = raw.split(";", 1)[0].split()
        if not words:
            continue
        if words[0] in ("G0", "G1"):
            to = list(at)
            for word in words[1:]:
                axis = "XYZE".find(word[0])
                if axis == 3 and relative:
                    to[3] += float(word[1:])
                elif axis >= 0:
                    to[axis] = float(word[1:])
            rows.append([*at[:3], *to[:3], to[3] - at[3]])
            at = to
        elif words[0] == "G92":
            for word in words[1:]:
                at["XYZE".index(word[0])] = float(word[1:])
        elif words[0] in ("M82", "M83"):
            relative = words[0] == "M83"
        elif not words[0].startswith(_HARMLESS):
            raise ValueError(f"line {number}: {raw!r} isn't read by this checker")
    found = np.array(rows, dtype=np.float64).reshape(-1, 7)
    return Moves(found[:, :3], found[:, 3:6], found[:, 6])


def rounded_to_steps(moves: Moves, steps_per_mm: float) -> Moves:
    """The same moves as a motor of whole steps makes them, X and Y."""
    ends = []
    for point in (moves.start, moves.end):
        made = point.copy()
        made[:, :2] = np.rint(point[:, :2] * steps_per_mm) / steps_per_mm
        ends.append(made)
    return Moves(ends[0], ends[1], moves.pushed)


def written_lines(
    moves: Moves, ul_per_e: float, layer_mm: float, *, rounded: bool, planned: Moves | None = None
) -> Lines:
    """The lines that ink flowed in.

    A line's cross-section is its volume over its length: width times height for lines that abut,
    and a rectangle with round sides, w h - (1 - pi/4) h², for a slicer that plans it so
    (``rounded``). E is written with few digits, so that its change over a short move says little:
    what counts is its change over `WINDOW_MM` of way about the move, within one stroke.
    ``planned`` gives the lengths that volumes were planned for.
    """
    way = (planned or moves).end - (planned or moves).start
    length = np.linalg.norm(way[:, :2], axis=1)
    wrote = (moves.pushed > 0) & (length > 1e-6)
    stroke = np.cumsum(~wrote)[wrote]
    width = _flow(length[wrote], moves.pushed[wrote], stroke) * ul_per_e / layer_mm
    if rounded:
        width += layer_mm * (1 - np.pi / 4)
    return Lines(moves.start[wrote, :2], moves.end[wrote, :2], width, moves.end[wrote, 2])


def own_lines(
    moves: Moves, ul_per_e: float, layer_mm: float, *, planned: Moves | None = None
) -> Lines:
    """Lines with round sides, each by its own change of E alone."""
    way = (planned or moves).end - (planned or moves).start
    length = np.linalg.norm(way[:, :2], axis=1)
    wrote = (moves.pushed > 0) & (length > 1e-6)
    area = moves.pushed[wrote] / length[wrote] * ul_per_e
    round_part = np.pi / 4 * layer_mm**2
    wide = (area - round_part) / layer_mm + layer_mm
    width = np.where(area > round_part, wide, 2 * np.sqrt(area / np.pi))
    return Lines(moves.start[wrote, :2], moves.end[wrote, :2], width, moves.end[wrote, 2])


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
