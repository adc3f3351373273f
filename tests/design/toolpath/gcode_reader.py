"""A small, slow G-code reader that shares nothing with the writer."""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction


@dataclass
class Machine:
    """Where the machine stands after each line, in exact decimals.

    `plunger` counts since power-up: G92 moves the count, not the plunger. A mark (a comment) is a
    line that changes nothing; `commands` leaves them out.
    """

    position: dict[str, Fraction | None] = field(
        default_factory=lambda: {"X": None, "Y": None, "Z": None}
    )
    e: Fraction = Fraction(0)
    plunger: Fraction = Fraction(0)
    feed: Fraction | None = None
    pause_ms: int = 0
    states: list[tuple[dict[str, Fraction | None], Fraction, Fraction | None]] = field(
        default_factory=list
    )
    lines: list[str] = field(default_factory=list)

    def read(self, data: bytes) -> Machine:
        assert data.endswith(b"\n")
        self.lines = data.decode("ascii").split("\n")[:-1]
        for line in self.lines:
            if not line.startswith(";"):
                self._run(line)
            self.states.append((dict(self.position), self.plunger, self.feed))
        return self

    @property
    def commands(self) -> list[str]:
        return [line for line in self.lines if not line.startswith(";")]

    def _run(self, line: str) -> None:
        code, *rest = line.split(" ")
        words = {word[0]: Fraction(word[1:]) for word in rest}
        assert len(words) == len(rest)
        if code in ("G0", "G1"):
            self.feed = words.pop("F", self.feed)
            assert self.feed is not None
            assert self.feed > 0
            assert words
            if "E" in words:
                target = words.pop("E")
                self.plunger += target - self.e
                self.e = target
            self.position |= words
        elif code == "G92":
            self.e = words.pop("E", self.e)
            self.position |= words
        elif code == "G4":
            self.pause_ms += int(words["P"])
        else:
            assert code in ("M85", "G21", "G90", "M82", "M220", "M221", "M200", "M302", "M400")
