"""Detect that another program redefined the coordinates, from step counts or reported shifts.

Marlin counts steps from where it was switched on, whatever a place is called since. So what lies
between the count and the place's name changes by the job's own renamings alone. The motors must
stand: the name is that of the last command's place, the count that of the motors' own.

Klipper tells by how much places and the plunger's count are shifted, and nothing stands still for
it; and its motors' steps beside the place they stand for, which SET_KINEMATIC_POSITION changes.

Not found: a renaming of the plunger, whose steps M114 doesn't count; builds without workspace
offsets, whose count follows the name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
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
from gcode.reading import code_of, is_motion, read_sent
from printctl.machine.control.board.channel import Channel
from printctl.machine.control.board.steps import Steps
from printctl.machine.control.position.firmware import RETRIES
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

_AXES: Final = "XYZ"
_WITHIN_MM: Final = 0.02
"""Of two decimals, twice; steps come on top."""
_ROUNDED_MM: Final = 0.006
"""Of two decimals, once, where the job's end is compared."""
_ROUNDED_STEPS: Final = 2
_LAST_MOVES: Final = 64
"""Lines looked back for the job's last move."""

Place = Mapping[str, float]


@dataclass(frozen=True)
class PlaceAnswer:
    """One answer about a printer's place, mm, by axis letter; empty for what it doesn't tell."""

    # the last command's place as the printer calls it; of Klipper's E what was pushed
    place: Place = field(default_factory=dict)
    # the place of the motors' steps less that; Klipper: by how much places are shifted
    offset: Place = field(default_factory=dict)
    # Klipper: what the motors' steps make less the place that they stand for
    motors: Place = field(default_factory=dict)
    # where the motors' steps lead and where they should: Klipper
    driven: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    # the same of RepRapFirmware, true where each axis has its motor
    ordered: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    in_steps: bool = False  # motors' places are told in whole steps, not in rounded mm

    def agrees(self, other: PlaceAnswer) -> bool:
        """Whether both tell the same place and offset."""
        return (self.place, self.offset) == (other.place, other.offset)


class FrameCheck:
    """Compares what a printer calls its place with the steps that it counts.

    ``begun`` is the answer before the job's first line; after a restart its place and offset.
    """

    def __init__(self, channel: Channel) -> None:
        self._channel = channel
        self._progress, self._printer = channel.logbook.progress, channel.wiring.printer
        facts = link_facts(self._printer)
        self._question, self._axes_question = facts.place_question, facts.axes_question
        self._per_mm = {axis.upper(): steps for axis, steps in self._printer.steps_per_mm}
        # Marlin adds a shorter move to the one after it: behind the last one it is never made
        aside = 1 if self._question else self._printer.min_steps_per_segment
        self._limits = {axis: _WITHIN_MM + aside / steps for axis, steps in self._per_mm.items()}
        self.begun, self._unshifted = PlaceAnswer(), False
        self._plunger: tuple[int, float] | None = None
        self._declared: tuple[int, Place] = 0, {}
        self._named: tuple[list[bytes], list[Renaming]] | None = None

    # --- the job's begin -------------------------------------------------------------------------

    def begin(self) -> Steps[None]:
        """Note both before the job's first line, with the motors standing."""
        logbook = self._channel.logbook
        fault, begun = logbook.fault, (yield from self._ask_twice())
        logbook.excuse(fault)  # a question that this build doesn't know
        if begun is not None:
            self.begun, self._unshifted = begun, not begun.offset
            self._declared = 0, begun.motors
            logbook.record("frame", told=begun.place, offset=begun.offset)

    def _ask_twice(self) -> Steps[PlaceAnswer | None]:
        before: PlaceAnswer | None = None
        for _ in range(RETRIES):
            now = yield from self._ask(journalled=False)
            if before is not None and now.agrees(before):
                return now
            before = now
        return None

    def restore(self, told: Place, offset: Place) -> None:
        """Take both as they were before the job's first line, from its journal."""
        self.begun = PlaceAnswer(told, offset)

    @property
    def tells_shifts(self) -> bool:
        """Whether the printer answers by how much places are shifted, without standing still."""
        return bool(self._question and self.begun.offset)

    def note_plunger(self) -> Steps[None]:
        """Take the plunger's shift as it is: the link has counted it anew (pause, new syringe)."""
        if self.tells_shifts:
            offset = (yield from self._ask()).offset
            self._plunger = (self._progress.done, offset["E"]) if offset else None

    def _ask(self, *, journalled: bool = True) -> Steps[PlaceAnswer]:
        if self._question and not self._unshifted:
            replies = yield from self._channel.command(self._question, journalled)
            motors = {
                axis: steps / self._per_mm[axis] - mm
                for axis, (steps, mm) in parse_motors(replies).items()
            }
            return PlaceAnswer(*parse_shifted(replies), motors, parse_driven(replies))
        replies = yield from self._channel.command(b"M114", journalled)
        ordered = parse_machine(replies, self._per_mm) if self._axes_question else {}
        place, in_steps = parse_position(replies), not tells_counts_in_mm(replies)
        if not set(_AXES) <= set(place):
            return PlaceAnswer(ordered=ordered, in_steps=in_steps)
        counts = parse_counts(replies, self._per_mm)
        offset = {axis: mm - place[axis] for axis, mm in counts.items()}
        return PlaceAnswer(place, offset, ordered=ordered, in_steps=in_steps)

    # --- while it prints -------------------------------------------------------------------------

    def renamed(self, *, waited: bool = False) -> Steps[str]:
        """Return which axes are called otherwise than by the job, or ''; waits for the motors.

        ``waited``: M400 was just answered.
        """
        if not self._applies():
            return ""
        if not waited and not self._question:
            yield from self._channel.command(b"M400")
        wrong = ""
        for _ in range(RETRIES):  # a reply may be garbled
            answer = yield from self._ask()
            if not answer.offset:
                continue
            wrong = self._aside(answer, self._limits)
            if not wrong or self._question:  # a wire without noise
                break
        return wrong

    def stands_at(self, at: Modal) -> Steps[bool]:
        """Whether two answers alike tell that the motors' steps have come to ``at``; no waiting."""
        if not self._applies() or self._question:
            return False
        answer = yield from self._ask()
        there = bool(answer.offset) and not (
            disagreement(at, dict(answer.place)) or self._aside(answer, self._limits)
        )
        return there and (yield from self._ask()).agrees(answer)

    def doubtful(self) -> Steps[bool]:
        """Whether the motors are where the moves that they may be making don't lead; no waiting."""
        if not self._applies() or self._question:
            return bool(self._question)
        answer = yield from self._ask()
        if not answer.offset:
            return False
        expected, limits = self._expected(self.begun.offset), self._limits
        under_way = self._progress.places_under_way()
        for axis in _AXES:
            motor = answer.offset[axis] + answer.place[axis] - expected[axis]
            along = [place[axis.lower()] for place in under_way if axis.lower() in place]
            within = limits[axis]
            if along and not min(along) - within <= motor <= max(along) + within:
                return True
        return False

    # --- the job's end ---------------------------------------------------------------------------

    def compare_end(self, at: Modal) -> Steps[tuple[str, Place, bool]]:
        """Compare place and motors' steps with the job's end, by one answer; the motors rest.

        Return what disagrees with ``at``, where the job ends; the place that the printer tells,
        empty where it tells none; and whether its motors' own steps were compared.
        """
        wrong, compared, before, kind = "", False, self._channel.logbook.fault, b""
        place: Place = {}
        limits: Place = self._limits
        if self._axes_question:
            kind = b"".join((yield from self._channel.command(self._axes_question)))
        # an answer without the word is a Cartesian's, unless configured otherwise
        by_order = bool(self._axes_question) and b"inematics" not in kind
        for _ in range(RETRIES):
            answer = yield from self._ask()
            if not answer.place:
                continue
            place, compared = answer.place, self._applies() and bool(answer.offset)
            wrong, limits = disagreement(at, dict(place)), self._limits_at_end(answer)
            if not wrong and compared:
                wrong = self._aside(_exact(at, answer), limits)
            driven = answer.driven or (answer.ordered if b"Cartesian" in kind else {})
            if driven:
                wrong, compared = wrong or _undriven(place, driven, limits), True
            elif by_order and self.begun.ordered and answer.ordered and not self._homed():
                wrong, compared = wrong or self._unmoved(answer, limits), True
            if not wrong:
                break
        self._channel.logbook.excuse(before)  # a question that this build doesn't know
        words = ", ".join(f"{axis} {limits[axis]:.3f}" for axis in _AXES)
        return wrong and f"{wrong} (steps compared to {words} mm)", place, compared

    def _limits_at_end(self, answer: PlaceAnswer) -> Place:
        """Return by how much steps may be aside at the end, mm.

        The job's last move tells: one long enough is made, with all that was left before it.
        """
        usual, lines, done = self._limits, self._progress.job.lines, self._progress.done
        per_mm = self._per_mm
        if self._question or not answer.in_steps:
            return usual
        for k in range(done - 1, max(done - _LAST_MOVES, 0) - 1, -1):
            if code_of(lines[k]) not in (b"G0", b"G1"):
                if is_motion(lines[k]):
                    return usual
                continue
            before, after = places(lines, k), places(lines, k + 1)
            steps = max(
                (abs(mm - before.get(a, mm)) * per_mm[a] for a, mm in after.items()), default=0.0
            )
            if steps > self._printer.min_steps_per_segment:
                exact = {a: _ROUNDED_MM + _ROUNDED_STEPS / per_mm[a] for a in _AXES}
                return {**usual, **exact}
            if steps > 0.0:
                return usual
        return usual

    def _unmoved(self, answer: PlaceAnswer, limits: Place) -> str:
        """Return which axes' steps, in the axes' order, lead elsewhere than the job, or ''.

        Right is what follows from the steps at the job's begin, and steps of the place that is
        reported (RepRapFirmware counts them anew at G92).
        """
        begun, ordered = self.begun, answer.ordered
        before = {axis: made - begun.place[axis] for axis, (made, _) in begun.ordered.items()}
        now = {axis: made - answer.place[axis] for axis, (made, _) in ordered.items()}
        stand = all(begun.ordered[axis][0] == ordered[axis][0] for axis in ordered)
        wrong = self._difference(self._expected(before), replace(answer, offset=now), limits)
        return wrong if stand or _undriven(answer.place, ordered, limits) else ""

    # --- by how much names differ ----------------------------------------------------------------

    def _applies(self) -> bool:
        return bool(self.begun.offset) and not self._homed()

    def _homed(self) -> bool:
        return any(code_of(line) in HOMING for line in self._progress.taken)

    def _renamings(self) -> list[Renaming]:
        """Return the job's, read once for as long as no lines are put in."""
        lines = self._progress.job.lines
        if self._named is None or self._named[0] is not lines:
            self._named = lines, renamings(lines)
        return self._named[1]

    def _expected(self, begun: Place) -> Place:
        """Return the offset that the job's own renamings have led to, mm, from ``begun``."""
        offset = dict(begun)
        for one in self._renamings():
            if one.index >= self._progress.done:
                break
            if self._question and code_of(one.line) != b"G92":
                continue  # it shifts nothing: the machine's own place is another
            for axis, mm in one.moved.items():
                offset[axis] -= mm
            for axis, mm in one.declared.items():
                offset[axis] -= mm - self.begun.place[axis]
        return offset

    def _aside(self, answer: PlaceAnswer, limits: Place) -> str:
        """Return which axes' names and steps differ from the job's, or ''."""
        wrong = self._difference(self._expected(self.begun.offset), answer, limits)
        if self._question:
            return wrong or self._plunger_difference(answer) or self._declared_difference(answer)
        # a build without workspace offsets counts its steps from the place's name
        return wrong if self._difference(self.begun.offset, answer, limits) else ""

    def _difference(self, expected: Place, answer: PlaceAnswer, limits: Place) -> str:
        aside = {axis: expected[axis] - answer.offset[axis] for axis in _AXES}
        steps = (
            "" if self._question else (" ({:.2f} mm, but its motor steps correspond to {:.2f} mm)")
        )
        return ", ".join(
            f"{axis} is offset by {mm:+.2f} mm from the job's coordinates"
            + steps.format(answer.place[axis], answer.place[axis] - mm)
            for axis, mm in aside.items()
            if abs(mm) > limits[axis]
        )

    def _plunger_difference(self, answer: PlaceAnswer) -> str:
        if "E" not in answer.offset or len(self._printer.heads) > 1:
            return ""
        lines, done = self._progress.job.lines, self._progress.done
        index, shift = self._plunger or (0, self.begun.offset["E"])
        for k in range(index, done):
            e = read_sent(lines[k]).number("E") if code_of(lines[k]) == b"G92" else None
            if e is not None:
                before = modal_state(lines, k).e
                shift += (self.begun.place["E"] if before is None else before) - e
        self._plunger = done, shift
        aside = shift - answer.offset["E"]
        if abs(aside) <= self._limits["E"]:
            return ""
        return f"the plunger is offset by {aside:+.2f} mm from the job's coordinates"

    def _declared_difference(self, answer: PlaceAnswer) -> str:
        """Return which axes' places were declared anew, but by the job; or ''."""
        lines, done, limits = self._progress.job.lines, self._progress.done, self._limits
        since, before = self._declared
        ours = any(declared_axes(line) and code_of(line) != b"G92" for line in lines[since:done])
        self._declared = done, answer.motors if ours or not before else before
        aside = {axis: mm - before.get(axis, mm) for axis, mm in answer.motors.items()}
        return ", ".join(
            f"{axis} was redefined by {-mm:+.2f} mm by another client, or the profile's "
            "steps_per_mm don't match this Klipper"
            for axis, mm in aside.items()
            if not ours and abs(mm) > limits[axis]
        )


def _exact(at: Modal, answer: PlaceAnswer) -> PlaceAnswer:
    """Return an answer with its offset from the job's place, which isn't rounded as reported."""
    place = {axis: getattr(at, axis.lower()) for axis in answer.offset}
    offset = {
        axis: mm if place[axis] is None else mm + answer.place[axis] - place[axis]
        for axis, mm in answer.offset.items()
    }
    return replace(answer, offset=offset)


def _undriven(place: Place, driven: Mapping[str, tuple[float, float]], limits: Place) -> str:
    """Return which axes' motors stand elsewhere than the reported place, or ''."""
    return ", ".join(
        f"{axis} is reported at {place[axis]:.2f} mm, but its motor steps correspond to "
        f"{place[axis] + made - meant:.2f} mm"
        for axis, (made, meant) in driven.items()
        if abs(made - meant) > limits[axis]
    )
