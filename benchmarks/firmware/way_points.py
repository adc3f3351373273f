"""Follow a board's motors along the way points of a list of commands, edge by edge."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.checkers.marlin_plunger import as_avr_reads
from benchmarks.firmware.gcode_files import MARLIN_STEPS
from benchmarks.firmware.step_log import AXES, StepLog

LEAST_STEPS = 6
"""Marlin adds a shorter move to the one after it."""
Steps = tuple[int, ...]
"""Of X, Y, Z and E since the board was switched on."""


@dataclass(frozen=True)
class Followed:
    """How far the motors went along a list of way points.

    Attributes
    ----------
    reached, wanted : int
        Way points.
    excursions : int
        Ways away from a way point and exactly back to it: the link's own, of a pause or look.
    left : int
        Step edges after the last way point that was reached.
    """

    reached: int
    wanted: int
    excursions: int
    left: int

    @property
    def exact(self) -> bool:
        """Whether each move was made once, in order, and nothing stayed elsewhere."""
        return self.reached == self.wanted and not self.left


def steps_of(axis: str, text: str) -> int:
    """Return the whole steps of a place in mm, in an 8-bit board's single precision."""
    steps = float(as_avr_reads(text) * np.float32(MARLIN_STEPS[axis]))
    return int(np.sign(steps) * np.floor(abs(steps) + 0.5))


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
