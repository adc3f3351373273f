"""Moves of an embedded print's G-code, with line and speed. Shares no code with the product.

Read are G0, G1 (X, Y, Z, E, F), G4, G90, G91, G92, M82 and M83; arcs and the like are refused.
Lengths are mm, speeds mm/s, volumes µL, times s.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_STILL = 1e-9
_HARMLESS = ("G21", "M", "T", "SET_", "F")


@dataclass(frozen=True)
class Moves:
    """Moves in the order of the file.

    Attributes
    ----------
    line : (n,) int64
        In the file, from 1.
    start, end : (n, 3) float64, mm
    pushed : (n,) float64
        Change of E.
    speed : (n,) float64, mm/s
        Of the tip; of E alone where the tip stands; NaN where no F was said yet.
    dwell_s : float
        All G4 together.
    """

    line: IntArray
    start: FloatArray
    end: FloatArray
    pushed: FloatArray
    speed: FloatArray
    dwell_s: float

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

    @property
    def duration(self) -> FloatArray:
        """Of each move at constant speed, (n,), s."""
        way = np.where(self.stands, np.abs(self.pushed), self.length)
        return way / self.speed


def read_embedded(text: str) -> Moves:
    """Read a file; axes stand at 0 until they are named.

    Raises
    ------
    ValueError
        For a line that would move the needle in a way this reader doesn't know; with its number.
    """
    at, feed, dwell = [0.0, 0.0, 0.0, 0.0], float("nan"), 0.0
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
        elif code == "G4":
            dwell += sum(
                float(word[1:]) * (1e-3 if word[0] == "P" else 1.0)
                for word in rest
                if word[0] in "PS"
            )
        elif not code.startswith(_HARMLESS):
            raise ValueError(f"line {number}: {raw!r} isn't read by this checker")
    found = np.array(rows, dtype=np.float64).reshape(-1, 9)
    return Moves(
        line=found[:, 0].astype(np.int64),
        start=found[:, 1:4],
        end=found[:, 4:7],
        pushed=found[:, 7],
        speed=found[:, 8],
        dwell_s=dwell,
    )


def passes_of(moves: Moves) -> IntArray:
    """Which pass each move writes, (n,), from 0; -1 for all others.

    A pass ends where the tip goes on without ink; the plunger alone may move within one.
    """
    writes, goes = moves.writes, ~moves.stands
    where = np.flatnonzero(goes)
    begins = writes[where] & ~np.concatenate([[False], writes[where][:-1]])
    number = np.full(len(writes), -1, dtype=np.int64)
    number[where] = np.where(writes[where], np.cumsum(begins) - 1, -1)
    return number
