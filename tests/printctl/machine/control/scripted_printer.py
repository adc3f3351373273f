"""Marlin in virtual time that keeps each move its motors made; it waits for nobody.

Modelled: numbers and checksums, Resend, a planner of a few moves and the pause before its first,
M400, M410 and M112 past the queue, "busy" once a second, M114 with counts, G92, tokens, a reset.
Moves are straight, at their feed rate. Not modelled: heat, endstops, acceleration.
"""

from __future__ import annotations

import math
import re
from collections import deque
from dataclasses import dataclass
from typing import Final

import numpy as np

from tests.printctl.machine.link.fake_marlin import FakeMarlin

AHEAD: Final = 4
"""Moves that the planner holds."""
FIRST_STEP_S: Final = 0.1
"""Before a planner that was empty begins; a second M410 sent meanwhile drops the move."""
DROPS_S: Final = 1.0
"""After M410 a line that waited for the planner is let in so late."""
ANSWER_S: Final = 0.002
BUSY_S: Final = 1.0
URGENT: Final = re.compile(rb"M410|M112")
_WORDS: Final = re.compile(r"([XYZEF])(-?[\d.]+)")
_PER_MM: Final = {"X": 80, "Y": 80, "Z": 400}

Place = dict[str, float]


@dataclass(frozen=True)
class Made:
    """A move that the motors have made: its line, and the places as the job calls them, mm."""

    line: str
    start: Place
    end: Place


@dataclass
class _Planned:
    line: str
    start: Place
    end: Place
    begins_s: float
    ends_s: float

    def at(self, now: float) -> Place:
        whole = self.ends_s - self.begins_s
        part = min(max((now - self.begins_s) / whole, 0.0), 1.0) if whole > 0 else 1.0
        return {axis: a + (self.end[axis] - a) * part for axis, a in self.start.items()}


class ScriptedPrinter(FakeMarlin):
    """Bytes in by `take`, what it says by `said`, its next own doing at `due_s`."""

    def __init__(self, rng: np.random.Generator | None = None) -> None:
        super().__init__(rng)
        self.at = {"X": 50.0, "Y": 50.0, "Z": 10.0, "E": 0.0}
        self.made: list[Made] = []
        self.taken: list[str] = []  # moves that entered the planner
        self.dropped: list[str] = []  # moves that left it unmade
        # lines that lost their numbers in a flushed buffer: made all the same, as by a real one
        self.fragments: list[str] = []
        self.now, self.feed = 0.0, 1800.0
        self.last_made_s = 0.0  # when the last move ended
        self._queue: deque[str] = deque()
        self._planner: deque[_Planned] = deque()
        self._out: deque[tuple[float, bytes]] = deque()
        self._since = self._busy_s = self._let_in_s = 0.0

    # --- the host's side ---------------------------------------------------------------------

    @property
    def due_s(self) -> float:
        """When it says its next word, if nobody writes to it."""
        own = math.inf if self.mute else self._out[0][0] if self._out else math.inf
        if self._queue and not self.halted:
            own = min(own, max(self._begins_s(self._queue[0]), self.now) + ANSWER_S)
            own = min(own, self._busy_s) if self.keepalive else own
        return math.inf if self.mute else own

    def take(self, data: bytes, now: float) -> None:
        """Receive bytes."""
        self.run_to(now)
        for urgent in URGENT.findall(data):
            self._drop()
            if urgent == b"M112":
                self._halt()
        said = self.receive(data)
        if said:
            self.say(said)

    def said(self, now: float) -> bytes:
        """Live up to now; give what is said by then."""
        self.run_to(now)
        words = b""
        while self._out and self._out[0][0] <= now:
            words += self._out.popleft()[1]
        return b"" if self.mute else words

    def say(self, text: bytes, after_s: float = ANSWER_S) -> None:
        """Say something, in its turn."""
        last = self._out[-1][0] if self._out else 0.0
        self._out.append((max(self.now + after_s, last), text))

    def reset_now(self, silently: bool = False) -> None:
        """Start anew, as by a brown-out: what it held isn't made, and its place is gone."""
        self._drop()
        self._queue.clear()
        self.at = dict.fromkeys("XYZE", 0.0)
        said = self.reset()
        self.say(b"" if silently else said)

    @property
    def place(self) -> Place:
        """Where the motors are, as the last commands call it."""
        return self._planner[0].at(self.now) if self._planner else dict(self.at)

    # --- its own life ------------------------------------------------------------------------

    def run_to(self, now: float) -> None:
        while not self.halted and self._queue:
            begins = max(self._begins_s(self._queue[0]), self.now)
            if begins > now:
                break
            self._go(begins)
            self._carry_out(self._queue.popleft())
            self._begin_next()
        if self._queue and self.keepalive and not self.halted:
            while self._busy_s <= now:
                self._out.append((self._busy_s, b"echo:busy: processing\n"))
                self._busy_s += BUSY_S
        self._go(now)

    def _go(self, now: float) -> None:
        self.now = max(self.now, now)
        while self._planner and self._planner[0].ends_s <= self.now:
            one = self._planner.popleft()
            self.made.append(Made(one.line, one.start, one.end))
            self.last_made_s = one.ends_s

    def _begins_s(self, command: str) -> float:
        if command.startswith(("G0", "G1")):
            full = len(self._planner) >= AHEAD
            return max(self._planner[0].ends_s if full else 0.0, self._let_in_s)
        if command.startswith(("M400", "G4")) and self._planner:
            return self._planner[-1].ends_s
        return 0.0

    def _begin_next(self) -> None:
        self._busy_s = self.now + BUSY_S

    def _take(self, line: str) -> bytes:
        if line.startswith(("G0", "G1", "G92")):
            line = line.partition("*")[0]  # a checksum without a number is passed over
            self.fragments.append(line)
        return super()._take(line)

    def _do(self, command: str) -> bytes:
        if not self._queue:
            self._busy_s = self.now + BUSY_S
        self._queue.append(command)
        return b""

    def _carry_out(self, command: str) -> None:
        self.executed.append(command)
        word = command.split()[0]
        words = {axis: float(value) for axis, value in _WORDS.findall(command)}
        if word in ("G0", "G1"):
            self._plan(command, words)
        elif word == "G92":
            for axis in self.at.keys() & words:
                self.renamed_mm[axis] += words[axis] - self.at[axis]
                self.at[axis] = words[axis]
        self.say(self._reply(word, command).encode("latin-1"))

    def _plan(self, command: str, words: dict[str, float]) -> None:
        self.feed = words.pop("F", self.feed)
        start, end = dict(self.at), {**self.at, **words}
        way = math.dist([start[a] for a in "XYZ"], [end[a] for a in "XYZ"])
        seconds = (way or abs(end["E"] - start["E"])) / (self.feed / 60)
        begins = self._planner[-1].ends_s if self._planner else self.now + FIRST_STEP_S
        self.taken.append(command)
        if seconds > 0:
            self._planner.append(_Planned(command, start, end, begins, begins + seconds))
        else:
            self.made.append(Made(command, start, end))
        self.at = dict(end)

    def _reply(self, word: str, command: str) -> str:
        if word != "M114":
            return super()._reply(word, command)
        where = " ".join(f"{axis}:{value:.2f}" for axis, value in self.at.items())
        motors = self.place
        counts = (
            f"{axis}:{round((motors[axis] - self.renamed_mm[axis]) * per_mm)}"
            for axis, per_mm in _PER_MM.items()
        )
        return f"{where} Count {' '.join(counts)}\nok\n"

    def _drop(self) -> None:
        """Stop the motors where they are; forget what was planned."""
        self._go(self.now)
        self.at = self.place
        self.dropped += [one.line for one in self._planner]
        self._planner.clear()
        self._let_in_s = self.now + DROPS_S

    def _halt(self) -> None:
        self.halted = True
        self.say(b"Error:Printer halted. kill() called!\n")
