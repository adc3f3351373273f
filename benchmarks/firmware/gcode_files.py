"""G-code files with the exact motor steps that they must produce."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np

from benchmarks.checkers.marlin_plunger import as_avr_reads

MARLIN_STEPS = {"X": 80, "Y": 80, "Z": 400, "E": 500}
HEAD = ["G21", "G90", "M82", "M302 P1", "M85 S600", "G92 E0"]
KLIPPER_HEAD = [
    "SET_IDLE_TIMEOUT TIMEOUT=600",
    "SET_KINEMATIC_POSITION X=0 Y=0 Z=0",
    "G21",
    "G90",
    "M82",
    "G92 E0",
]


@dataclass
class MotionFile:
    """A file of absolute straight moves, in which every target is known.

    Attributes
    ----------
    lines : list of str
    targets : list of dict
        Ends of the moves in order, mm; the motors begin at 0.
    """

    lines: list[str] = field(default_factory=lambda: list(HEAD))
    targets: list[dict[str, float]] = field(
        default_factory=lambda: [dict.fromkeys("XYZE", 0.0)],
    )

    def move(self, feed_mm_min: float | None = None, **to: float) -> None:
        """Add a move to a place, mm."""
        rounded = {axis: round(value, 4) for axis, value in to.items()}
        words = "".join(f" {axis}{value:g}" for axis, value in rounded.items())
        self.lines.append(f"G1{words}" + (f" F{feed_mm_min:g}" if feed_mm_min else ""))
        self.targets.append(self.targets[-1] | rounded)

    def write(self, path: Path) -> Path:
        """Write the file."""
        path.write_text("\n".join(self.lines) + "\n")
        return path

    def steps(self, per_mm: dict[str, int]) -> list[dict[str, int]]:
        """Return the targets in steps, by an 8-bit board's single precision.

        4.517 mm at 500 steps/mm are 2258 of them, not 2258.5 rounded up.
        """
        return [
            {
                axis: math.floor(float(as_avr_reads(f"{to[axis]:g}") * np.float32(count)) + 0.5)
                for axis, count in per_mm.items()
            }
            for to in self.targets
        ]

    def end_steps(self, per_mm: dict[str, int]) -> dict[str, int]:
        """Return the steps of each motor from start to end."""
        return self.steps(per_mm)[-1]

    def edges(self, per_mm: dict[str, int]) -> dict[str, int]:
        """Return how many step edges each motor must make in all."""
        steps = self.steps(per_mm)
        pairs = list(pairwise(steps))
        return {axis: sum(abs(b[axis] - a[axis]) for a, b in pairs) for axis in "XYZE"}


def raster(lines: int, width_mm: float = 10.0, feed_mm_s: float = 20.0) -> MotionFile:
    """Return parallel lines with E, as a FRESH layer has them."""
    file, e = MotionFile(), 0.0
    file.move(3000, X=20.0, Y=20.0)
    file.move(300, Z=0.5)
    for i in range(lines):
        e += 0.01 * width_mm
        file.move(60 * feed_mm_s, X=20.0 + width_mm * ((i + 1) % 2), E=e)
        file.move(60 * feed_mm_s, Y=20.0 + 0.25 * (i + 1))
    file.move(300, Z=3.0)
    return file


def polygon(turns: int, chords: int = 60, radius_mm: float = 8.0, feed: float = 15.0) -> MotionFile:
    """Return a helix of chords with E."""
    file, e = MotionFile(), 0.0
    file.move(3000, X=50.0 + radius_mm, Y=50.0)
    for i in range(1, turns * chords + 1):
        angle, e = 2 * math.pi * i / chords, e + 0.01
        x, y = 50 + radius_mm * math.cos(angle), 50 + radius_mm * math.sin(angle)
        file.move(60 * feed, X=x, Y=y, Z=0.3 * i / chords, E=e)
    return file


def random_moves(seed: int, moves: int) -> MotionFile:
    """Return moves of random length, direction and speed, all axes."""
    rng, file, e = np.random.default_rng(seed), MotionFile(), 0.0
    for _ in range(moves):
        e += float(rng.uniform(0.02, 0.3))
        x, y = rng.uniform(5, 60, 2)
        if rng.random() < 0.2:
            file.move(240, Z=float(rng.uniform(0, 2)))
        file.move(float(rng.uniform(600, 6000)), X=float(x), Y=float(y), E=e)
    return file


def short_moves(moves: int, step_mm: float = 0.1, feed_mm_s: float = 150.0) -> MotionFile:
    """Return moves so short and quick that line or processor limit the rate, not the motors."""
    file, reach = MotionFile(), 100
    for i in range(moves):
        there = i % (2 * reach)
        file.move(60 * feed_mm_s, X=step_mm * (min(there, 2 * reach - there)), Y=step_mm * (i + 1))
    return file
