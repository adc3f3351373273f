"""G-code files whose exact motor steps are known, and how a board's motors follow them.

The dry run was tuned on none of `validation_files`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.checkers.marlin_plunger import as_avr_reads
from benchmarks.firmware.board import AXES, StepLog

MARLIN_STEPS = {"X": 80, "Y": 80, "Z": 400, "E": 500}
HEAD = ["G21", "G90", "M82", "M302 P1", "M85 S600", "G92 E0"]


def steps_of(axis: str, text: str) -> int:
    """Return the whole steps of a place in mm, by an 8-bit board's single precision.

    4.517 mm at 500 steps/mm are 2258 of them, not 2258.5 rounded up.
    """
    steps = float(as_avr_reads(text) * np.float32(MARLIN_STEPS[axis]))
    return int(np.sign(steps) * np.floor(abs(steps) + 0.5))


@dataclass
class MotionFile:
    """A file of absolute straight moves, every end of which is known, mm; motors begin at 0."""

    lines: list[str] = field(default_factory=lambda: list(HEAD))
    targets: list[dict[str, float]] = field(default_factory=lambda: [dict.fromkeys("XYZE", 0.0)])

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

    def steps(self) -> list[dict[str, int]]:
        """Return the targets in steps of each motor."""
        axes = MARLIN_STEPS
        return [{axis: steps_of(axis, f"{to[axis]:g}") for axis in axes} for to in self.targets]

    def edges(self) -> int:
        """Return how many step edges all motors must make."""
        pairs = pairwise(self.steps())
        return sum(abs(b[axis] - a[axis]) for a, b in pairs for axis in "XYZE")


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


Lines = list[str]


def infill_with_hops(rows: int = 14) -> Lines:
    """Return a zigzag with a hop and a travel after each second row."""
    file, e = MotionFile(), 0.0
    file.move(3600, X=30.0, Y=30.0, Z=0.4)
    for i in range(rows):
        e += 0.11
        file.move(60 * (18 + i % 3), X=30.0 + 13.0 * ((i + 1) % 2), E=e)
        if i % 2:
            file.move(240, Z=1.4)
            file.move(4800, X=37.0, Y=30.0 + 0.35 * (i + 1))
            file.move(240, Z=0.4)
            file.move(2400, X=30.0)
        else:
            file.move(1200, Y=30.0 + 0.35 * (i + 1))
    return file.lines


def arc_helix(turns: int = 7, radius_mm: float = 5.5) -> Lines:
    """Return half circles by G2 and G3, which rise and push ink."""
    lines, e = [*HEAD, "G1 X40 Y40 F3600"], 0.0
    for i in range(2 * turns):
        e += 0.21
        side, code = (1 if i % 2 == 0 else -1), "G2" if (i // 4) % 2 == 0 else "G3"
        way = f"X{40 + (2 * radius_mm if side > 0 else 0):g} Y40 Z{0.05 * (i + 1):.2f}"
        lines.append(f"{code} {way} I{side * radius_mm:g} J0 E{e:.4f} F{900 + 100 * (i % 5)}")
    return lines


def short_curve(moves: int, seed: int, feeds_mm_s: tuple[float, ...]) -> Lines:
    """Return segments of 0.05 to 0.2 mm on a winding curve, at one speed after the other."""
    rng, lines = np.random.default_rng(seed), [*HEAD, "G1 X60 Y60 F3600"]
    x, y, e, angle = 60.0, 60.0, 0.0, 0.0
    for i in range(moves):
        length = float(rng.uniform(0.05, 0.2))
        angle += float(rng.normal(0.02, 0.05))
        x, y, e = x + length * math.cos(angle), y + length * math.sin(angle), e + 0.03 * length
        feed = 60 * feeds_mm_s[i * len(feeds_mm_s) // moves]
        lines.append(f"G1 X{x:.3f} Y{y:.3f} E{e:.4f} F{feed:g}")
    return lines


def lattice(cells: int = 7, pitch_mm: float = 1.7) -> Lines:
    """Return two layers of diagonal struts, each crossing cut into pieces."""
    file, e = MotionFile(), 0.0
    for layer in range(2):
        file.move(240, Z=0.3 * (layer + 1))
        for i in range(cells):
            across = pitch_mm * i
            file.move(3000, **_turned(layer, 70.0, 70.0 + across))
            for k in range(1, cells + 1):
                e += 0.02
                wave = across + 0.3 * (k % 2)
                file.move(60 * 14, **_turned(layer, 70.0 + pitch_mm * k, 70.0 + wave), E=e)
    return file.lines


def _turned(layer: int, along: float, across: float) -> dict[str, float]:
    return {"X": along, "Y": across} if layer == 0 else {"X": across, "Y": along}


def random_walk(steps: int = 110, seed: int = 4106) -> Lines:
    """Return steps of all lengths and directions with ink, some pulled back."""
    rng, file, e = np.random.default_rng(seed), MotionFile(), 0.0
    x = y = 60.0
    file.move(3600, X=x, Y=y)
    for _ in range(steps):
        x, y = (float(np.clip(v + rng.normal(0, 3.5), 20, 100)) for v in (x, y))
        e += float(rng.uniform(0, 0.1))
        file.move(float(rng.uniform(500, 2400)), X=x, Y=y, E=e)
        if rng.random() < 0.1:
            file.move(300, E=e - 0.2)
            file.move(300, E=e)
    return file.lines


def validation_files() -> dict[str, Callable[[], Lines]]:
    """Return the five files by name."""
    return {
        "infill with hops": infill_with_hops,
        "arc helix": arc_helix,
        "900 short segments": lambda: short_curve(900, 4103, (12.0, 40.0)),
        "lattice": lattice,
        "random walk": random_walk,
    }


LAYERS, MOVES = 3, 6
LAYERED_HEAD = ["M85 S600", "G21", "G90", "M82", "M302 P1", "G92 X50 Y50 Z10 E0", "G0 Z10.25 F300"]


@dataclass
class LayeredFile:
    """Random strokes in layers, each drawn back, lifted and marked at its end.

    ``ends``: commands before each layer's end, and the place there, mm; ``mends``: by look, what
    was inserted there.
    """

    seed: int
    commands: list[str] = field(default_factory=lambda: list(LAYERED_HEAD))
    ends: list[tuple[int, dict[str, float]]] = field(default_factory=list)
    mends: dict[int, list[str]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.rng, e = np.random.default_rng(self.seed), 0.0
        for layer in range(LAYERS):
            z = 10.0 + 0.25 * layer
            x, y = self._place(100)
            self.commands += [f"G0 X{x:.2f} Y{y:.2f} F3000", f"G0 Z{z:.2f} F300", f"G1 E{e:.5f}"]
            for _ in range(MOVES):
                (x, y), e = self._place(100), e + 0.002 * int(self.rng.integers(8, 30))
                feed = int(self.rng.integers(900, 2400))
                self.commands.append(f"G1 X{x:.2f} Y{y:.2f} E{e:.5f} F{feed}")
            self.commands += [f"G1 E{e - 0.2:.5f} F60", f"G0 Z{z + 0.25:.2f} F300"]
            self.ends.append((len(self.commands), {"X": x, "Y": y, "Z": z + 0.25, "E": e - 0.2}))

    def _place(self, reach: int) -> tuple[float, float]:
        """A place within ``reach`` twentieths of a mm, of whole steps."""
        x, y = (50 + 0.05 * int(one) for one in self.rng.integers(-reach, reach + 1, 2))
        return x, y

    def text(self) -> str:
        """The file, with its marks."""
        lines = list(self.commands)
        for layer, (after, _) in reversed(list(enumerate(self.ends))):
            lines.insert(after, f";LAYER_END:{layer}")
        return "\n".join([*lines, "M400", ""])

    def mend(self, look: int) -> list[str]:
        """A stroke in the first layer's own hull, and back; the same each time it is asked."""
        if look not in self.mends:
            at = self.ends[look - 1][1]
            z, e = at["Z"], at["E"]
            starts = [one.split() for one in self.commands[10 : 10 + MOVES]]
            (x, y), (to_x, to_y) = (tuple(starts[k][1:3]) for k in self.rng.permutation(MOVES)[:2])
            self.mends[look] = [
                f"G1 Z{z + 0.5:.2f} F300", f"G1 {x} {y} F3000", f"G1 Z{z - 0.1:.2f} F300",
                f"G1 E{e + 0.2:.5f} F60", f"G1 {to_x} {to_y} E{e + 0.25:.5f} F400",
                f"G1 E{e + 0.05:.5f} F60", f"G1 Z{z + 0.5:.2f} F300",
                f"G1 X{at['X']:.2f} Y{at['Y']:.2f} F3000", f"G1 Z{z:.2f} F300", f"G92 E{e:.5f}",
            ]  # fmt: skip
        return self.mends[look]

    def grown(self) -> list[str]:
        """The file's commands with what was inserted."""
        grown, begin = list[str](), 0
        for look, (after, _) in enumerate(self.ends, 1):
            grown += self.commands[begin:after] + self.mends.get(look, [])
            begin = after
        return grown + self.commands[begin:]


LEAST_STEPS = 6
"""Marlin adds a shorter move to the one after it."""
Steps = tuple[int, ...]
"""Of X, Y, Z and E since the board was switched on."""


@dataclass(frozen=True)
class Followed:
    """How far the motors went along ``wanted`` way points.

    ``excursions`` lead away from a way point and exactly back to it: the link's own, of a pause or
    look. ``left``: step edges after the last way point that was reached.
    """

    reached: int
    wanted: int
    excursions: int
    left: int

    @property
    def exact(self) -> bool:
        """Whether each move was made once, in order, and nothing stayed elsewhere."""
        return self.reached == self.wanted and not self.left


def way_points(commands: Sequence[str]) -> list[Steps]:
    """Return where each move leads; absolute places throughout, G92 renames them."""
    motor, planned, asked = (np.zeros(4, np.int64) for _ in range(3))
    found = []
    for command in commands:
        code, *words = command.split()
        named = {AXES.index(one[0]): steps_of(one[0], one[1:]) for one in words if one[0] in AXES}
        if code == "G92":
            for axis, steps in named.items():
                planned[axis] = asked[axis] = steps
        elif code in ("G0", "G1"):
            for axis, steps in named.items():
                asked[axis] = steps
            if np.abs(asked - planned).max() >= LEAST_STEPS:
                motor, planned = motor + asked - planned, asked.copy()
                found.append(tuple(motor.tolist()))
    return found


def follow(log: StepLog, ways: Sequence[Steps]) -> Followed:
    """Follow the edges of a log along the way points, as far as they agree."""
    steps = log.steps()
    axis, direction = steps["axis"].astype(int), steps["direction"].astype(int)
    moved = np.where(np.arange(4) == axis[:, None], direction[:, None], 0)
    places = np.vstack([np.zeros((1, 4), np.int64), np.cumsum(moved, axis=0)])
    here: Steps = (0, 0, 0, 0)
    at = excursions = reached = 0
    while reached < len(ways):
        end = _straight(axis, direction, at, np.subtract(ways[reached], here))
        if end is not None:
            at, here, reached = end, ways[reached], reached + 1
            continue
        back = _back(places, at, here)
        if back is None:
            return Followed(reached, len(ways), excursions, len(axis) - at)
        at, excursions = back, excursions + 1
    while (back := _back(places, at, here)) is not None:
        at, excursions = back, excursions + 1
    return Followed(reached, len(ways), excursions, len(axis) - at)


def _straight(
    axis: NDArray[np.int64], direction: NDArray[np.int64], at: int, move: NDArray[np.int64]
) -> int | None:
    """Return the edge behind a move, in which no motor turns round; None where it isn't made."""
    end = at + int(np.abs(move).sum())
    signed = [int(direction[at:end][axis[at:end] == k].sum()) for k in range(4)]
    return end if end <= len(axis) and signed == move.tolist() else None


def _back(places: NDArray[np.int64], at: int, here: Steps) -> int | None:
    """Return the edge behind a way from ``here`` and back; None where it never comes back."""
    away = (places[at + 1 :] != here).any(axis=1)
    first = np.flatnonzero(away)
    home = np.flatnonzero(~away)
    home = home[home > first[0]] if len(first) else home[:0]
    return at + 1 + int(home[0]) if len(home) else None
