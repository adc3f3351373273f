"""Generate random valid G-code: moves, arcs, G92 of E, unusual spelling."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

FIRST = ["M302 P1", "M85 S600", "G21", "G90", "M82", "G92 E0"]


class RandomJob:
    """A job made line by line from a seed; the firmware alone says where it ends.

    Parameters
    ----------
    odd : bool
        Blanks inside words or none at all, indented lines, comments.
    """

    def __init__(self, seed: int, odd: bool) -> None:
        self.rng = np.random.default_rng(seed)
        self.odd = odd
        self.at = dict.fromkeys("XYE", 0.0)  # mm
        self.lines = list(FIRST)

    def number(self, mm: float) -> str:
        """Return a length in one of several spellings."""
        text = f"{mm:.4f}"
        if self.rng.random() < 0.2:
            text = text.rstrip("0").rstrip(".")
        if self.rng.random() < 0.1 and not text.startswith("-"):
            text = "+" + text
        return text.replace("0.", ".", 1) if text.startswith("0.") and self.odd else text

    def word(self, axis: str, to: float) -> str:
        """Return the word that leads to a place, and remember it."""
        self.at[axis] = to
        return f"{axis}{self.number(to)}"

    def feed(self) -> str:
        """Return a feed rate, 10 to 60 mm/s."""
        return "F" + self.number(float(self.rng.uniform(600, 3600)))

    def straight(self) -> None:
        """Add a straight move of one to three axes."""
        words = [self.word("X", float(self.rng.uniform(40, 80)))]
        if self.rng.random() < 0.7:
            words.append(self.word("Y", float(self.rng.uniform(40, 80))))
        if self.rng.random() < 0.5:
            words.append(self.word("E", self.at["E"] + float(self.rng.uniform(0.05, 0.4))))
        if self.rng.random() < 0.5:
            words.append(self.feed())
        self.rng.shuffle(words)
        self.lines.append(("G0 " if self.rng.random() < 0.2 else "G1 ") + " ".join(words))

    def arc(self) -> None:
        """Add an arc by centre or by radius."""
        radius, a = float(self.rng.uniform(3, 15)), float(self.rng.uniform(0, 2 * math.pi))
        turn = float(self.rng.uniform(0.4, 2.8)) * (1 if self.rng.random() < 0.5 else -1)
        centre = (-radius * math.cos(a), -radius * math.sin(a))
        to_x = self.at["X"] + centre[0] + radius * math.cos(a + turn)
        to_y = self.at["Y"] + centre[1] + radius * math.sin(a + turn)
        if not (5 < to_x < 120 and 5 < to_y < 120):
            return self.straight()
        words = [self.word("X", to_x), self.word("Y", to_y)]
        if self.rng.random() < 0.3:
            words.append("R" + self.number(radius))
        else:
            words += ["I" + self.number(centre[0]), "J" + self.number(centre[1])]
        self.lines.append(("G3 " if turn > 0 else "G2 ") + " ".join(words))
        return None

    def between(self) -> None:
        """Count the plunger anew, or wait."""
        if self.rng.random() < 0.7:
            self.lines.append("G92 " + self.word("E", round(float(self.rng.uniform(0, 20)), 2)))
        else:
            self.lines.append(f"G4 P{self.rng.integers(1, 60)}")

    def spell(self, line: str) -> str:
        """Write a line otherwise, with the same meaning to the firmware."""
        what = self.rng.random()
        if what < 0.15:
            return line.replace(" ", "")
        if what < 0.3:
            return line.replace(" ", "  ") + " ; " + "seen"
        if what < 0.4:
            return "  " + line
        if what < 0.5:
            return "".join(c + (" " if c in "XYE" else "") for c in line)
        return line + ("(note)" if what < 0.55 else "")

    def make(self, length: int) -> list[str]:
        """Return the job's lines."""
        self.lines.append("G1 X60 Y60 F3000")
        self.at |= {"X": 60.0, "Y": 60.0}
        for _ in range(length):
            what = self.rng.random()
            if what < 0.6:
                self.straight()
            elif what < 0.8:
                self.arc()
            else:
                self.between()
        self.lines.append("G1 " + self.word("X", 50.0) + " " + self.word("Y", 45.0) + " " +
                          self.word("E", self.at["E"] + 0.2))  # fmt: skip
        if self.odd:
            head = len(FIRST)
            self.lines[head:] = [self.spell(line) for line in self.lines[head:]]
        return self.lines


def write_random(path: Path, seed: int, length: int, odd: bool) -> Path:
    """Write a random job."""
    path.write_text("\n".join(RandomJob(seed, odd).make(length)) + "\n")
    return path
