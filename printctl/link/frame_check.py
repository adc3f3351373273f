"""Places that another program has renamed (G92): told by the steps that M114 counts.

Marlin counts steps from where it was switched on, whatever a place is called since. So what lies
between the count and the place's name changes by the job's own renamings alone. The motors must
stand: the name is that of the last command's place, the count that of the motors' own.

Not told: the plunger's, whose steps M114 doesn't count; builds without workspace offsets, whose
count follows the name.
"""

from __future__ import annotations

from typing import Final

from firmware_profiles.families.position_reply import parse_counts, parse_position
from printctl.link.channel import Channel
from printctl.link.job_frame import Renaming, renamings
from printctl.link.modal import HOMING
from sim.reading import code_of

RETRIES: Final = 8
"""So often a question is asked whose answer may be garbled."""
_AXES: Final = "XYZ"
_WITHIN_MM: Final = 0.02
"""Of two decimals, twice; a step comes on top."""

Place = dict[str, float]


class FrameCheck:
    """Compares what a printer calls its place with the steps that it counts.

    Parameters
    ----------
    channel : Channel
    """

    def __init__(self, channel: Channel) -> None:
        self._channel = channel
        self._told: Place = {}
        self._offset: Place = {}
        self._named: list[Renaming] | None = None

    def begin(self) -> None:
        """Note both before the job's first line, with the motors standing."""
        before: tuple[Place, Place] | None = None
        for _ in range(RETRIES):
            now = self._asked(journalled=False)
            if now == before:
                self._told, self._offset = now
                self._channel.logbook.record("frame", told=now[0], offset=now[1])
                return
            before = now

    def restore(self, told: Place, offset: Place) -> None:
        """Take both as they were before the job's first line, from its journal."""
        self._told, self._offset = told, offset

    def renamed(self, *, waited: bool = False) -> str:
        """Return which axes are called otherwise than by the job, or ''; waits for the motors.

        Parameters
        ----------
        waited : bool
            Whether M400 was just answered.
        """
        if not self._applies():
            return ""
        if not waited:
            self._channel.command(b"M400")
        expected, wrong = self._expected(), ""
        for _ in range(RETRIES):  # a reply may be garbled
            _, offset = self._asked(journalled=True)
            if not offset:
                continue
            wrong = self._difference(expected, offset)
            if not wrong or not self._difference(self._offset, offset):
                return ""
        return wrong

    def doubtful(self) -> bool:
        """Whether the motors are where the moves that they may be making don't lead; no waiting."""
        if not self._applies():
            return False
        told, offset = self._asked(journalled=True)
        if not offset:
            return False
        expected, progress = self._expected(), self._channel.logbook.progress
        places = progress.places_under_way()
        for axis in _AXES:
            motor = offset[axis] + told[axis] - expected[axis]
            along = [place[axis.lower()] for place in places if axis.lower() in place]
            within = self._within(axis)
            if along and not min(along) - within <= motor <= max(along) + within:
                return True
        return False

    def _applies(self) -> bool:
        progress = self._channel.logbook.progress
        done = progress.job.lines[: progress.done]
        return bool(self._offset) and not any(code_of(line) in HOMING for line in done)

    def _asked(self, *, journalled: bool) -> tuple[Place, Place]:
        """Return the place as the printer calls it, and the steps' place less that, mm."""
        replies = self._channel.command(b"M114", journalled)
        told, counts = parse_position(replies), parse_counts(replies)
        if not set(_AXES) <= set(told) & set(counts):
            return {}, {}
        per_mm = self._channel.wiring.printer.steps_per_mm
        at = {axis: counts[axis] / getattr(per_mm, axis.lower()) for axis in _AXES}
        return told, {axis: at[axis] - told[axis] for axis in _AXES}

    def _expected(self) -> Place:
        """Offset that the job's own renamings have led to, mm."""
        offset, progress = dict(self._offset), self._channel.logbook.progress
        for one in self._renamings():
            if one.index >= progress.done:
                break
            for axis, mm in one.moved.items():
                offset[axis] -= mm
            for axis, mm in one.declared.items():
                offset[axis] -= mm - self._told[axis]
        return offset

    def _renamings(self) -> list[Renaming]:
        """Return the job's, read once."""
        if self._named is None:
            self._named = renamings(self._channel.logbook.progress.job.lines)
        return self._named

    def _difference(self, expected: Place, offset: Place) -> str:
        aside = {axis: expected[axis] - offset[axis] for axis in _AXES}
        return ", ".join(
            f"{axis} is called {mm:+.2f} mm otherwise than by the job"
            for axis, mm in aside.items()
            if abs(mm) > self._within(axis)
        )

    def _within(self, axis: str) -> float:
        per_mm: float = getattr(self._channel.wiring.printer.steps_per_mm, axis.lower())
        return _WITHIN_MM + 1.0 / per_mm
