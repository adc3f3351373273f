"""Interpret a program file of an Aerotech controller (A3200, Automation1); no product code.

Read are G0, G1, G4, G90, G91, G92, DWELL, the brakes of axes as valves (``BRAKE Aa 0``,
``DriveBrakeOff(Aa)``) and pressures (``$COM=``, ``$AP=``); several codes may stand in a line. Words
that set up and move nothing are kept by name. Lengths are mm, F is mm/s, times s.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.checkers.read_gcode import Moves

FloatArray = NDArray[np.float64]
AXES = "XYAB"
_WORD = re.compile(r"([A-Z])(-?\d*\.?\d+(?:[eE][-+]?\d+)?)$")
_VALVE = re.compile(r"BRAKE A([ab]) ([01])$|DriveBrakeO(ff|n)\(A([ab])\)$")
_QUIET = (
    "Enable", "Disable", "VELOCITY", "ROUNDING", "DVAR", "Call", "WAIT", "WaitForMotionDone", "G71",
    "G76", "G108", "M2", "VelocityBlendingOn", "CornerRoundingOn", "setPressure",
)  # fmt: skip


@dataclass(frozen=True)
class Program:
    """A file as the controller runs it.

    ``at`` (n + 1, 4): X, Y, A and B before the first move and after each, mm; ``line`` (n,) in the
    file; ``valve`` (n,): the heads whose valves stand open, as bits; ``seconds`` (n,) at the
    file's own feeds; ``dwells``: how many; ``words``: how often each command is used;
    ``pressures``: (line, port, value) of each call.
    """

    at: FloatArray
    line: NDArray[np.int64]
    valve: NDArray[np.int64]
    named: NDArray[np.int64]  # (n,), the vertical axes that the move names, as bits
    seconds: FloatArray
    dwells: int
    words: dict[str, int]
    pressures: list[tuple[int, int, float]]

    @property
    def length(self) -> FloatArray:
        """Way of each move, both vertical axes at once, (n,), mm."""
        step = np.diff(self.at, axis=0)
        high = np.abs(step[:, 2:]).max(axis=1)
        length: FloatArray = np.sqrt(step[:, 0] ** 2 + step[:, 1] ** 2 + high**2)
        return length

    @property
    def head(self) -> NDArray[np.int64]:
        """Head that writes each move, (n,); -1 where no valve is open.

        Where both valves are open, the one whose axis the stroke names.
        """
        head = np.select([self.valve == 1, self.valve == 2, self.valve == 3], [0, 1, 2], -1)
        stroke = np.cumsum(np.diff(self.valve > 0, prepend=False))
        for number in np.unique(stroke[head == 2]).tolist():
            own = stroke == number
            named = np.bitwise_or.reduce(self.named[own])
            if named not in (1, 2):
                raise ValueError(f"line {self.line[own][0]}: both axes move in one stroke")
            head[own] = named - 1
        return head

    def changes(self) -> int:
        """How often the ink changes between strokes."""
        head = self.head
        return int(np.count_nonzero(np.diff(head[head >= 0])))

    def seconds_at(self, write_mm_s: float, jog_mm_s: float, dwell_s: float) -> float:
        """Time with equal speeds: moves with a valve open, all others, and each dwell."""
        speed = np.where(self.valve > 0, write_mm_s, jog_mm_s)
        return float((self.length / speed).sum() + self.dwells * dwell_s)

    def moves(self, apart_mm: float, flow_ul_s: float) -> Moves:
        """Moves of the head in use, its tip's places; what flows as a plunger of 1 mm² pushes it.

        A head is in use from the end of the stroke of another to the end of its own last one.
        """
        head = self.head
        known = np.flatnonzero(head >= 0)
        following = np.searchsorted(known, np.arange(len(head)))
        used = head[known[np.minimum(following, len(known) - 1)]]
        tip = np.stack([self.at[:, [0, 1, 2]], self.at[:, [0, 1, 3]] + [apart_mm, 0, 0]])
        rows = np.arange(len(head))
        start, end = tip[used, rows], tip[used, rows + 1]
        pushed = np.where(head >= 0, self.seconds * flow_ul_s, 0.0)
        length = np.linalg.norm(end - start, axis=1)
        speed = np.divide(length, self.seconds, out=np.zeros_like(length), where=self.seconds > 0)
        return Moves(self.line, start, end, pushed, speed)


def read_program(text: str, comment: str) -> Program:
    """Read a file; ``comment`` begins a comment. ValueError for a word that isn't known here."""
    at, feed, relative = [0.0] * 4, np.nan, False
    valve = port = dwells = 0
    rows: list[tuple[float, ...]] = []
    words: dict[str, int] = {}
    pressures: list[tuple[int, int, float]] = []
    for number, raw in enumerate(text.splitlines(), 1):
        line = raw.split(comment, 1)[0].strip()
        if not line:
            continue
        switched = _VALVE.match(line)
        if switched:
            opens = switched[2] == "0" or switched[3] == "ff"
            bit = 1 if (switched[1] or switched[4]) == "a" else 2
            valve = valve | bit if opens else valve & ~bit
            _count(words, re.split(r"[ (]", line)[0])
            continue
        if line.startswith("$"):
            name, value = line.split("=")
            port = int(value) if name == "$COM" else port
            if name == "$AP":
                pressures.append((number, port, float(value)))
            _count(words, name)
            continue
        first = re.split(r"[ (]", line)[0]
        if first in _QUIET:
            _count(words, first)
            continue
        code, named = "", 0
        for word in line.split():
            if word in ("G90", "G91", "G0", "G1", "G92", "G4", "DWELL"):
                code = word
                relative = word == "G91" if word in ("G90", "G91") else relative
                _count(words, word)
                continue
            if code == "DWELL" or (code == "G4" and word[0] == "P"):
                dwells += 1
                continue
            found = _WORD.match(word)
            if found is None or (found[1] not in AXES and found[1] != "F"):
                raise ValueError(f"line {number}: {raw!r} isn't read by this checker")
            if found[1] == "F":
                feed = float(found[2])
                continue
            axis = AXES.index(found[1])
            named |= {2: 1, 3: 2}.get(axis, 0)
            before = at[axis] if relative and code != "G92" else 0.0
            at = [*at[:axis], before + float(found[2]), *at[axis + 1 :]]
        if code in ("G0", "G1") or (code == "G90" and named):
            rows.append((number, *at, valve, named, feed))
        elif code == "G92" and rows:
            rows.append((number, *at, valve, named, np.inf))
        elif code == "G92":
            begin = list(at)
    table = np.array(rows, dtype=np.float64)
    places = np.vstack([begin, table[:, 1:5]])
    counted = np.flatnonzero(np.isinf(table[:, 7]))
    return _without(places, table, counted, dwells, words, pressures)


def _without(
    places: FloatArray,
    table: FloatArray,
    counted: NDArray[np.int64],
    dwells: int,
    words: dict[str, int],
    pressures: list[tuple[int, int, float]],
) -> Program:
    """Take out later G92: what was before is told in the last one's numbers."""
    for row in counted[::-1].tolist():
        places[: row + 1] += places[row + 1] - places[row]
    kept = np.delete(np.arange(len(table)), counted)
    at = np.vstack([places[:1], places[1:][kept]])
    step = np.diff(at, axis=0)
    length = np.sqrt(step[:, 0] ** 2 + step[:, 1] ** 2 + np.abs(step[:, 2:]).max(axis=1) ** 2)
    line, valve, named, feed = (table[kept, k] for k in (0, 5, 6, 7))
    seconds = np.divide(length, feed, out=np.zeros_like(length), where=length > 0)
    whole = (line.astype(np.int64), valve.astype(np.int64), named.astype(np.int64))
    return Program(at, *whole, seconds, dwells, words, pressures)


def _count(words: dict[str, int], word: str) -> None:
    words[word] = words.get(word, 0) + 1
