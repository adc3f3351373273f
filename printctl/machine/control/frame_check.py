"""Detect that another program redefined the coordinates, from step counts or reported shifts.

Marlin counts steps from where it was switched on, whatever a place is called since. So what lies
between the count and the place's name changes by the job's own renamings alone. The motors must
stand: the name is that of the last command's place, the count that of the motors' own.

Klipper tells by how much places and the plunger's count are shifted, and nothing stands still for
it; and its motors' steps beside the place they stand for, which SET_KINEMATIC_POSITION changes.

Not told: the plunger's, whose steps M114 doesn't count; builds without workspace offsets, whose
count follows the name.
"""

from __future__ import annotations

from typing import Final

from firmware_profiles.families.position_reply import (
    parse_counts,
    parse_driven,
    parse_machine,
    parse_motors,
    parse_position,
    parse_shifted,
    tells_counts_in_mm,
)
from printctl.machine.control.channel import Channel
from printctl.machine.families import link_facts
from printctl.machine.job.coordinates import (
    HOMING,
    Modal,
    Renaming,
    declared_axes,
    disagreement,
    modal_state,
    places,
    renamings,
)
from sim.gcode.reading import code_of, is_motion, read_sent

RETRIES: Final = 8
"""So often a question is asked whose answer may be garbled."""
_AXES: Final = "XYZ"
_WITHIN_MM: Final = 0.02
"""Of two decimals, twice; steps come on top."""

_ROUNDED_MM: Final = 0.006
"""Of two decimals, once, where the job's end is compared."""
_ROUNDED_STEPS: Final = 2
_LAST_MOVES: Final = 64
"""Lines looked back for the job's last move."""

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
        self._unshifted = False
        self._named: list[Renaming] | None = None
        self._plunger: tuple[int, float] | None = None
        self._motors: Place = {}
        self._driven: dict[str, tuple[float, float]] = {}
        self._declared: tuple[int, Place] = 0, {}
        facts = link_facts(channel.wiring.printer)
        self._question, self._axes_question = facts.place_question, facts.axes_question
        self._cartesian, self._by_order = False, False
        self._steps_told = False
        self._ordered: dict[str, tuple[float, float]] = {}
        self._begun: dict[str, tuple[float, float]] = {}
        self._end_mm: Place = {}

    def begin(self) -> None:
        """Note both before the job's first line, with the motors standing."""
        logbook = self._channel.logbook
        fault = logbook.fault
        answers = self._asked_twice()
        logbook.excuse(fault)  # a question that this build doesn't know
        if answers is not None:
            self._told, self._offset = answers
            self._unshifted = not answers[1]
            self._declared, self._begun = (0, self._motors), self._ordered
            logbook.record("frame", told=answers[0], offset=answers[1])

    def _asked_twice(self) -> tuple[Place, Place] | None:
        before: tuple[Place, Place] | None = None
        for _ in range(RETRIES):
            now = self._asked(journalled=False)
            if now == before:
                return now
            before = now
        return None

    @property
    def tells_shifts(self) -> bool:
        """Whether the printer answers by how much places are shifted, without standing still."""
        return bool(self._question and self._offset)

    def restore(self, told: Place, offset: Place) -> None:
        """Take both as they were before the job's first line, from its journal."""
        self._told, self._offset = told, offset

    def note_plunger(self) -> None:
        """Take the plunger's shift as it is: the link has counted it anew (pause, new syringe)."""
        if self._question and self._offset:
            _, offset = self._asked(journalled=True)
            self._plunger = (self._channel.logbook.progress.done, offset["E"]) if offset else None

    def renamed(self, *, waited: bool = False) -> str:
        """Return which axes are called otherwise than by the job, or ''; waits for the motors.

        Parameters
        ----------
        waited : bool
            Whether M400 was just answered.
        """
        if not self._applies():
            return ""
        if not waited and not self._question:
            self._channel.command(b"M400")
        wrong = ""
        for _ in range(RETRIES):  # a reply may be garbled
            told, offset = self._asked(journalled=True)
            if not offset:
                continue
            wrong = self._aside(told, offset)
            if not wrong or self._question:  # a wire without noise
                break
        return wrong

    def compare_end(self, at: Modal) -> tuple[str, Place, bool]:
        """Compare place and motors' steps with the job's end, by one answer; the motors rest.

        Parameters
        ----------
        at : Modal
            Where the job ends.

        Returns
        -------
        wrong : str
            What disagrees; empty for nothing.
        told : dict
            The place that the printer tells, mm; empty where it tells none.
        by_steps : bool
            Whether it tells its motors' own steps, and they were compared.
        """
        wrong, told, compared = "", Place(), False
        before = self._channel.logbook.fault
        if self._axes_question:
            kind = b"".join(self._channel.command(self._axes_question))
            self._cartesian = b"Cartesian" in kind
            self._by_order = b"inematics" not in kind  # Cartesian, unless configured otherwise
        for _ in range(RETRIES):
            answer, offset = self._asked(journalled=True)
            if not answer:
                continue
            told, compared = answer, self._applies() and bool(offset)
            wrong = disagreement(at, told)
            self._end_mm = self._limits_at_end()
            if not wrong and compared:
                wrong = self._aside(told, self._exact(at, told, offset))
            if self._driven:
                wrong, compared = wrong or self._undriven(told, self._driven), True
            elif self._by_order and self._begun and self._ordered and not self._homed():
                wrong, compared = wrong or self._unmoved(told), True
            if not wrong:
                break
        self._channel.logbook.excuse(before)  # a question that this build doesn't know
        limits = ", ".join(f"{axis} {self._within(axis):.3f}" for axis in _AXES)
        self._end_mm = {}
        return wrong and f"{wrong} (steps compared to {limits} mm)", told, compared

    @staticmethod
    def _exact(at: Modal, told: Place, offset: Place) -> Place:
        """Return an offset from the job's place, which isn't rounded to decimals as ``told``."""
        place = {axis: getattr(at, axis.lower()) for axis in offset}
        return {
            axis: mm if place[axis] is None else mm + told[axis] - place[axis]
            for axis, mm in offset.items()
        }

    def _limits_at_end(self) -> Place:
        """Return by how much steps may be aside at the end, mm; empty for as anywhere else.

        The job's last move tells: one long enough is made, with all that was left before it.
        """
        progress, printer = self._channel.logbook.progress, self._channel.wiring.printer
        if self._question or not self._steps_told:
            return {}
        per_mm = {axis: getattr(printer.steps_per_mm, axis.lower()) for axis in "XYZE"}
        lines = progress.job.lines
        for k in range(progress.done - 1, max(progress.done - _LAST_MOVES, 0) - 1, -1):
            if code_of(lines[k]) not in (b"G0", b"G1"):
                if is_motion(lines[k]):
                    return {}
                continue
            before, after = places(lines, k), places(lines, k + 1)
            steps = [abs(mm - before.get(a, mm)) * per_mm[a] for a, mm in after.items()]
            if max(steps, default=0.0) > printer.min_steps_per_segment:
                return {a: _ROUNDED_MM + _ROUNDED_STEPS / per_mm[a] for a in _AXES}
            if max(steps, default=0.0) > 0.0:
                return {}
        return {}

    def _unmoved(self, told: Place) -> str:
        """Return which axes' steps, in the axes' order, lead elsewhere than the job, or ''.

        Right is what follows from the steps at the job's begin, and steps of the place that is
        told (RepRapFirmware counts them anew at G92).
        """
        before = {axis: made - self._told[axis] for axis, (made, _) in self._begun.items()}
        now = {axis: made - told[axis] for axis, (made, _) in self._ordered.items()}
        stand = all(self._begun[axis][0] == self._ordered[axis][0] for axis in self._ordered)
        wrong = self._difference(self._expected(before), told, now)
        return wrong if stand or self._undriven(told, self._ordered) else ""

    def _aside(self, told: Place, offset: Place) -> str:
        """Return which axes' names and steps differ from the job's, or ''."""
        wrong = self._difference(self._expected(), told, offset)
        if self._question:
            return wrong or self._plunger_difference(offset) or self._declared_difference()
        # a build without workspace offsets counts its steps from the place's name
        return wrong if self._difference(self._offset, told, offset) else ""

    def _undriven(self, told: Place, driven: dict[str, tuple[float, float]]) -> str:
        """Return which axes' motors stand elsewhere than the place that is told, or ''."""
        return ", ".join(
            f"{axis} is told at {told[axis]:.2f} mm, and its motors' steps make "
            f"{told[axis] + made - meant:.2f} mm"
            for axis, (made, meant) in driven.items()
            if abs(made - meant) > self._within(axis)
        )

    def stands_at(self, at: Modal) -> bool:
        """Whether two answers alike tell that the motors' steps have come to ``at``; no waiting."""
        if not self._applies() or self._question:
            return False
        told, offset = self._asked(journalled=True)
        there = bool(offset) and not (disagreement(at, told) or self._aside(told, offset))
        return there and self._asked(journalled=True) == (told, offset)

    def doubtful(self) -> bool:
        """Whether the motors are where the moves that they may be making don't lead; no waiting."""
        if not self._applies() or self._question:
            return bool(self._question)
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
        return bool(self._offset) and not self._homed()

    def _homed(self) -> bool:
        taken = self._channel.logbook.progress.taken
        return any(code_of(line) in HOMING for line in taken)

    def _asked(self, *, journalled: bool) -> tuple[Place, Place]:
        """Return the place as the printer calls it, and the steps' place less that, mm."""
        per_mm = self._channel.wiring.printer.steps_per_mm
        if self._question and not self._unshifted:
            replies = self._channel.command(self._question, journalled)
            self._motors = {
                axis: steps / getattr(per_mm, axis.lower()) - mm
                for axis, (steps, mm) in parse_motors(replies).items()
            }
            self._driven = parse_driven(replies)
            return parse_shifted(replies)
        replies = self._channel.command(b"M114", journalled)
        told, steps = parse_position(replies), {axis: getattr(per_mm, axis.lower())
                                                for axis in _AXES}  # fmt: skip
        self._ordered = parse_machine(replies, steps) if self._axes_question else {}
        self._driven = self._ordered if self._cartesian else {}
        self._steps_told = not tells_counts_in_mm(replies)
        at = parse_counts(replies, steps)
        if not set(_AXES) <= set(told):
            return {}, {}
        return told, {axis: mm - told[axis] for axis, mm in at.items()}

    def _expected(self, begun: Place | None = None) -> Place:
        """Offset that the job's own renamings have led to, mm, from the one at its begin."""
        offset = dict(self._offset if begun is None else begun)
        progress = self._channel.logbook.progress
        for one in self._renamings():
            if one.index >= progress.done:
                break
            if self._question and code_of(one.line) != b"G92":
                continue  # it shifts nothing: the machine's own place is another
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

    def _difference(self, expected: Place, told: Place, offset: Place) -> str:
        aside = {axis: expected[axis] - offset[axis] for axis in _AXES}
        steps = "" if self._question else " ({:.2f} mm, where its motor's steps make {:.2f} mm)"
        return ", ".join(
            f"{axis} is called {mm:+.2f} mm otherwise than by the job"
            + steps.format(told[axis], told[axis] - mm)
            for axis, mm in aside.items()
            if abs(mm) > self._within(axis)
        )

    def _plunger_difference(self, offset: Place) -> str:
        if "E" not in offset or len(self._channel.wiring.printer.heads) > 1:
            return ""
        progress = self._channel.logbook.progress
        index, shift = self._plunger or (0, self._offset["E"])
        for k in range(index, progress.done):
            line = progress.job.lines[k]
            e = read_sent(line).number("E") if code_of(line) == b"G92" else None
            if e is not None:
                before = modal_state(progress.job.lines, k).e
                shift += (self._told["E"] if before is None else before) - e
        self._plunger = progress.done, shift
        aside = shift - offset["E"]
        if abs(aside) <= self._within("E"):
            return ""
        return f"the plunger is called {aside:+.2f} mm otherwise than by the job"

    def _declared_difference(self) -> str:
        """Return which axes' places were declared anew, but by the job; or ''."""
        progress = self._channel.logbook.progress
        done, before = self._declared
        ours = any(
            declared_axes(line) and code_of(line) != b"G92"
            for line in progress.job.lines[done : progress.done]
        )
        self._declared = progress.done, self._motors if ours or not before else before
        aside = {axis: mm - before.get(axis, mm) for axis, mm in self._motors.items()}
        return ", ".join(
            f"the place of {axis} was declared {-mm:+.2f} mm aside by another client, or the "
            f"profile's steps_per_mm aren't this Klipper's"
            for axis, mm in aside.items()
            if not ours and abs(mm) > self._within(axis)
        )

    def _within(self, axis: str) -> float:
        if axis in self._end_mm:
            return self._end_mm[axis]
        printer = self._channel.wiring.printer
        per_mm: float = getattr(printer.steps_per_mm, axis.lower())
        # Marlin adds a shorter move to the one after it: behind the last one it is never made
        steps = 1 if self._question else printer.min_steps_per_segment
        return _WITHIN_MM + steps / per_mm
