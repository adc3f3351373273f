"""Reset firmware settings before a print; refuse a tip that isn't at the checked start position."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from firmware_profiles import Printer
from firmware_profiles.families.position_reply import parse_position
from printctl.gate.firmware import (
    Difference,
    blind_resets,
    differences,
    questions,
    reported_settings,
)
from printctl.link.channel import Channel
from printctl.link.errors import HandshakeError
from printctl.link.families import link_facts

Ask = Callable[[bytes], tuple[bytes, ...]]
Place = tuple[float, float, float]
ASIDE_MM: Final = 0.05
"""Most between the place where the tip stands and the one that checks took it to stand at."""
_TRIES: Final = 4
REST_LIMIT_S: Final = 30.0
"""Longest wait for a machine that is still moving when a print is to start."""
_APART_S: Final = 0.5


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


def await_rest(channel: Channel) -> None:
    """Wait until the machine stands still: a former job may have moves left, or go on.

    Raises
    ------
    HandshakeError
        Where it moves for longer than `REST_LIMIT_S`.
    """
    clock, before = channel.wiring.clock, _place(channel)
    limit, told = clock.now() + REST_LIMIT_S, False
    while True:
        until = clock.now() + _APART_S
        while clock.now() < until:
            channel.pump(until)
        place = _place(channel)
        if place == before:
            channel.ask(b"M400")
            if _place(channel) == place:
                return
        if clock.now() > limit:
            raise HandshakeError(
                f"the machine moves on its own ({before} became {place} within {_APART_S:g} s, for "
                f"{REST_LIMIT_S:g} s): a former job, its card or another program drives it. End "
                "that, see where the needle stands, and start again"
            )
        if not told:
            told = True
            words = f"the machine still moves; waiting for it to stand, up to {REST_LIMIT_S:g} s"
            channel.logbook.enter(channel.logbook.state, words)
        before = place


def _place(channel: Channel) -> str:
    """Return all that the firmware tells of its place, its motors' steps too."""
    question = link_facts(channel.wiring.printer).place_question or b"M114"
    replies = channel.ask(question)
    return " ".join(line.decode("ascii", "replace") for line in replies if b"X:" in line)


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
