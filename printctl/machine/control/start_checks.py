"""Reset firmware settings before a print; refuse a tip that isn't at the checked start position."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, NoReturn

from firmware_profiles import Printer
from firmware_profiles.families.position_reply import parse_position
from printctl.checks.gate.firmware import (
    Difference,
    blind_resets,
    differences,
    questions,
    reported_settings,
)
from printctl.machine.control.channel import Channel
from printctl.machine.errors import HandshakeError
from printctl.machine.families import link_facts

Ask = Callable[[bytes], tuple[bytes, ...]]
Place = tuple[float, float, float]
ASIDE_MM: Final = 0.05
"""Most between the place where the tip stands and the one that checks took it to stand at."""
_TRIES: Final = 4
REST_LIMIT_S: Final = 30.0
"""Longest wait for a machine that is still moving when a print is to start."""
_APART_S: Final = 0.5
_BUSY_S: Final = 1.0
"""Most that a machine at rest takes to answer M400."""


def agree_settings(
    ask: Ask, printer: Printer, note: Callable[[str], None], begun: bool = False
) -> dict[str, str]:
    """Reset what the firmware has otherwise; give the settings that a job may change, as told.

    Parameters
    ----------
    ask : callable
        Sends a command and gives the printer's reply.
    printer : Printer
    note : callable
        Told of each reset, for the journal.
    begun : bool
        Whether the job's moves have begun.

    Raises
    ------
    HandshakeError
        For a difference that no command takes back, or that comes back.
    """
    for command in blind_resets(printer):
        ask(command.encode("ascii"))
    answers = _asked(ask, printer)
    for _ in range(_TRIES):  # a garbled answer differs, too
        every = differences(answers, printer)
        refused = [one for one in every if not one.tolerated]
        if not refused:
            break
        for one in refused:
            if one.reset:
                note(f"{one.what}; reset by {one.reset}")
                ask(one.reset.encode("ascii"))
        answers = _asked(ask, printer)
    else:
        raise HandshakeError(_refusal(refused, begun))
    for one in every:
        note(f"{one.what}: {one.remedy}")
    return reported_settings(answers, printer)


class RestWait:
    """Wait until the machine stands still: a former job may have moves left, or go on.

    Parameters
    ----------
    channel : Channel

    Attributes
    ----------
    moved : str
        What was seen of its moves, or how long it was busy; empty for nothing.
    """

    def __init__(self, channel: Channel) -> None:
        self._channel, self._clock = channel, channel.wiring.clock
        self._since: float | None = None
        self._told = self._busy = False
        self.moved = ""

    def step(self) -> None:
        """Say that a printer is busy, from the first step on; end where it takes too long.

        Raises
        ------
        HandshakeError
        """
        now, heard = self._clock.now(), self._channel.heard
        self._since = now if self._since is None else self._since
        self._busy |= "busy:" in heard.last
        if heard.count and now - self._since > 2.0 * _BUSY_S:
            self._tell()
        if heard.count and now - self._since > REST_LIMIT_S and self._says_busy:
            self._refuse(now - self._since)

    def wait(self) -> None:
        """Return once it stands.

        Raises
        ------
        HandshakeError
            Where it moves, or makes what it was sent before, for longer than `REST_LIMIT_S`.
        """
        began, before = self._clock.now(), self._place()
        while (place := self._next_place()) != before:
            pairs = zip(before.split(), place.split(), strict=False)
            changed = ", ".join(f"{a} became {b}" for a, b in pairs if a != b)
            self.moved, before = changed or f"{before!r} became {place!r}", place
            self._tell()
            if self._clock.now() - began > REST_LIMIT_S:
                self._refuse(self._clock.now() - began)

    def _next_place(self) -> str:
        """Return the place a while after the machine has made what it was sent."""
        channel, clock = self._channel, self._clock
        began, troubles = clock.now(), channel.troubles
        self._since, self._busy, channel.on_step = began, False, self.step
        channel.ask(b"M400")
        channel.on_step = None
        busy_s = clock.now() - began
        if self._says_busy and busy_s > _BUSY_S and channel.troubles == troubles:
            self.moved = self.moved or f"it made for {busy_s:.1f} s what it was sent before"
        until = clock.now() + _APART_S
        while clock.now() < until:
            channel.pump(until)
        return self._place()

    @property
    def _says_busy(self) -> bool:
        """Whether it is the machine that is slow; of one that says so, not the line's answers."""
        return self._busy or not link_facts(self._channel.wiring.printer).keepalive

    def _refuse(self, waited_s: float) -> NoReturn:
        seen = self.moved or "it hasn't answered yet, as if behind moves or a wait for heat"
        raise HandshakeError(
            f"the machine still moves, or is busy, after {waited_s:.0f} s (at most "
            f"{REST_LIMIT_S:g}; {seen}): a former job, its card or another program drives it; no "
            "line of the job was sent. End that, see where the needle stands, and start again"
        )

    def refuse_declared(self, declared: Place | None) -> None:
        """Refuse a job whose first lines say where the tip stands, as that has changed.

        Raises
        ------
        HandshakeError
        """
        if self.moved and declared is not None:
            raise HandshakeError(
                f"the machine still moved when the print was to start ({self.moved}), and the "
                f"job's first lines say that the tip stands at {_told(declared)}: no line of "
                "the job was sent. It stands now; bring the tip to where the print starts, and "
                "start again"
            )

    def _tell(self) -> None:
        if not self._told:
            self._told = True
            words = f"the printer still moves, or is busy; waiting for it, up to {REST_LIMIT_S:g} s"
            self._channel.logbook.enter(self._channel.logbook.state, words)

    def _place(self) -> str:
        """Return all that the firmware tells of its place, its motors' steps too.

        Twice alike, if it stands: no checksum guards an answer.
        """
        question, place = link_facts(self._channel.wiring.printer).place_question or b"M114", ""
        for _ in range(_TRIES):
            before, replies = place, self._channel.ask(question)
            place = " ".join(one.decode("ascii", "replace") for one in replies if b"X:" in one)
            if place == before:
                break
        return place


def _asked(ask: Ask, printer: Printer) -> dict[str, list[str]]:
    return {
        question: [line.decode("ascii", "replace") for line in ask(question.encode("ascii"))]
        for question in questions(printer)
    }


def _refusal(refused: list[Difference], begun: bool) -> str:
    told = "; ".join(
        f"{one.what}: {one.remedy or f'{one.reset} was sent and changed nothing'}"
        for one in refused
    )
    moved = "" if begun else ", and nothing was moved"
    return f"the firmware isn't as the checks count on{moved}: {told}"


def agree_start(ask: Ask, start_mm: Place, declared: Place | None) -> None:
    """Refuse a tip that stands elsewhere than checks took it to stand.

    Parameters
    ----------
    ask : callable
        As for `agree_settings`.
    start_mm : (x, y, z), mm
        Where preflight began.
    declared : (x, y, z) or None, mm
        Where the job's own first lines tell the firmware that the tip stands.

    Raises
    ------
    HandshakeError
        With both places.
    """
    if declared is not None:
        _refuse_apart(start_mm, declared, "the job's first lines say that it stands at")
        return
    for _ in range(_TRIES):
        told = parse_position(ask(b"M114"))
        if {"X", "Y", "Z"} <= set(told):
            break
    else:
        raise HandshakeError("the printer doesn't tell its position (M114); reset it")
    _refuse_apart(start_mm, (told["X"], told["Y"], told["Z"]), "the printer says that it stands at")


def _refuse_apart(start_mm: Place, other: Place, says: str) -> None:
    away = math.dist(start_mm, other)
    if away > ASIDE_MM:
        raise HandshakeError(
            f"checks took the tip to stand at {_told(start_mm)} (--start), and {says} "
            f"{_told(other)}, {away:.2f} mm away (at most {ASIDE_MM:g}): nothing was moved. Give "
            f"--start {','.join(f'{mm:g}' for mm in other)} if that is where it stands, or bring "
            "it there"
        )


def _told(place: Place) -> str:
    return " ".join(f"{axis}{mm:.2f}" for axis, mm in zip("XYZ", place, strict=True))
