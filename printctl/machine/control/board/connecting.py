"""First contact with a printer: protocol, boot, line numbers, standstill, the tip's start."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Final, NoReturn

from firmware_profiles import Printer
from firmware_profiles.families import LinkSetup, family_of
from firmware_profiles.families.link_protocol import LinkProtocol
from firmware_profiles.families.position_reply import parse_position
from firmware_profiles.families.timing import Timing
from printctl.machine.control.board.channel import Channel
from printctl.machine.control.board.steps import Steps
from printctl.machine.errors import HandshakeError
from printctl.machine.families import link_facts, unsent
from printctl.machine.job.care import Care
from printctl.machine.job.coordinates import places

BOOT_LISTEN_S: Final = 1.0
BOOT_QUIET_S: Final = 0.5
BOOT_LIMIT_S: Final = 10.0
CONNECT_LIMIT_S: Final = 15.0
ASIDE_MM: Final = 0.05
"""Most between the place where the tip stands and the one that checks took it to stand at."""
REST_LIMIT_S: Final = 30.0
"""Longest wait for a machine that is still moving when a print is to start."""
_PLACE_INTERVAL_S: Final = 0.5
_BUSY_S: Final = 1.0
"""Most that a machine at rest takes to answer M400."""
_TRIES: Final = 8

Place = tuple[float, float, float]


def protocol_for(printer: Printer, quiet_s: float, care: Care | None = None) -> LinkProtocol:
    """Return a printer's protocol on a wire of so much latency (`Transport`).

    Its limits on silence and noise are those of ``care``. A printer that takes no lines is refused.
    """
    care = care or Care()
    family = family_of(printer)
    if family.make_protocol is None:
        raise unsent(printer)
    timing = Timing(quiet_s=quiet_s, noise_window=care.noise_window, noise_limit=care.noise_limit)
    if care.silent_limit_s is not None:
        seconds = care.silent_limit_s
        if family.remembers:
            timing = replace(timing, silent_limit_s=seconds)
        else:
            timing = replace(timing, busy_limit_s=seconds)
    setup = LinkSetup(
        timing, printer.lines_in_flight, printer.receive_buffer_bytes, places, printer.withholds
    )
    return family.make_protocol(setup)


def connect(channel: Channel, on_step: Callable[[], None] | None = None) -> Steps[None]:
    """Have the printer number its lines from 0; ``on_step`` is the channel's meanwhile."""
    wiring = channel.wiring
    if wiring.fresh and wiring.printer.resets_on_connect:
        yield from _await_boot(channel)
    limit = channel.now + CONNECT_LIMIT_S
    channel.on_step = on_step
    while True:
        try:
            yield from channel.agree(wiring.protocol.renumber)
        except HandshakeError:  # some boards sit in their boot loader for long
            if channel.now > limit:
                raise
        else:
            channel.on_step = None
            return


def _await_boot(channel: Channel) -> Steps[None]:
    """Give a board that resets when the port opens the time to say so, and to wake up."""
    heard = channel.heard
    listen_until = channel.now + BOOT_LISTEN_S
    while channel.now < listen_until and not heard.booted:
        yield from channel.pump(listen_until)
    limit, count = channel.now + BOOT_LIMIT_S, -1
    while heard.booted and count != heard.count and channel.now < limit:
        count = heard.count
        yield from channel.listen(BOOT_QUIET_S)


class RestWait:
    """Wait until the machine stands still: a former job may have moves left, or go on.

    ``moved``: what was seen of its moves, or how long it was busy; empty for nothing.
    """

    def __init__(self, channel: Channel) -> None:
        self._channel = channel
        self._since: float | None = None
        self._reported = self._busy = False
        self.moved = ""

    def step(self) -> None:
        """Say that a printer is busy, from the first step on; refuse one that is so too long."""
        now, heard = self._channel.now, self._channel.heard
        self._since = now if self._since is None else self._since
        self._busy |= "busy:" in heard.last
        if heard.count and now - self._since > 2.0 * _BUSY_S:
            self._report()
        if heard.count and now - self._since > REST_LIMIT_S and self._says_busy:
            self._refuse(now - self._since)

    def wait(self) -> Steps[None]:
        """Return once it stands; refuse one that moves, or is busy, beyond `REST_LIMIT_S`."""
        if self._busy:  # while its lines were numbered
            self.moved = "it was busy moving or heating at the first query"
        began, before = self._channel.now, (yield from self._place())
        while (place := (yield from self._next_place())) != before:
            pairs = zip(before.split(), place.split(), strict=False)
            changed = ", ".join(f"{a} became {b}" for a, b in pairs if a != b)
            self.moved, before = changed or f"{before!r} became {place!r}", place
            self._report()
            if self._channel.now - began > REST_LIMIT_S:
                self._refuse(self._channel.now - began)

    def _next_place(self) -> Steps[str]:
        """Return the place a while after the machine has made what it was sent."""
        channel = self._channel
        began = channel.now
        self._since, self._busy, channel.on_step = began, False, self.step
        yield from channel.ask(b"M400")
        channel.on_step = None
        busy_s = channel.now - began
        # a firmware that would say so, and doesn't, stands: it is the line that is slow
        if self._says_busy and busy_s > _BUSY_S:
            self.moved = self.moved or f"it executed earlier commands for {busy_s:.1f} s"
        yield from channel.listen(_PLACE_INTERVAL_S)
        return (yield from self._place())

    @property
    def _says_busy(self) -> bool:
        """Whether it is the machine that is slow; of one that says so, not the line's answers."""
        return self._busy or not self._channel.wiring.protocol.keepalive

    def _place(self) -> Steps[str]:
        """Return all that the firmware says of its place, its motors' steps too.

        Twice alike, if it stands: no checksum guards an answer.
        """
        question, place = link_facts(self._channel.wiring.printer).place_question or b"M114", ""
        for _ in range(_TRIES):
            before, replies = place, (yield from self._channel.ask(question))
            told = " ".join(one.decode("ascii", "replace") for one in replies if b"X:" in one)
            place = told or before  # else it was garbled, and is asked again
            if told and told == before:
                break
        return place

    def _report(self) -> None:
        if not self._reported:
            self._reported = True
            words = f"the printer is still moving or busy; waiting for it, up to {REST_LIMIT_S:g} s"
            self._channel.logbook.enter(self._channel.logbook.state, words)

    def _refuse(self, waited_s: float) -> NoReturn:
        seen = self.moved or "no reply yet, probably still moving or heating"
        raise HandshakeError(
            f"the printer is still moving or busy after {waited_s:.0f} s (maximum "
            f"{REST_LIMIT_S:g}; {seen}): an earlier job, its SD card or another program is "
            "controlling it; no line of the job was sent. End that, check where the needle is, and "
            "start again"
        )


def agree_start(
    channel: Channel, moved: str, declared: Place | None, start_mm: Place | None
) -> Steps[None]:
    """Refuse a tip that stands elsewhere than checks, or the job, take it to stand.

    ``moved``: what was seen of the machine's moves before (`RestWait`); ``declared``: where the
    job's own first lines tell the firmware that the tip stands; ``start_mm``: where preflight
    began, None for no matter where.
    """
    if moved and declared is not None:
        raise HandshakeError(
            f"the printer was still moving at the start of the print ({moved}), but the job's "
            f"first lines set the tip position to {_words(declared)}: no line of the job was sent. "
            "It is at rest now; move the tip to the start position, and start again"
        )
    if start_mm is None:
        return
    if declared is not None:
        _refuse_apart(start_mm, declared, "the job's first lines set its position to")
        return
    for _ in range(_TRIES):
        at = parse_position((yield from channel.ask(b"M114")))
        if {"X", "Y", "Z"} <= set(at):
            break
    else:
        raise HandshakeError("the printer doesn't report its position (M114); reset it")
    _refuse_apart(start_mm, (at["X"], at["Y"], at["Z"]), "the printer reports it at")


def _refuse_apart(start_mm: Place, other: Place, says: str) -> None:
    away = math.dist(start_mm, other)
    if away > ASIDE_MM:
        raise HandshakeError(
            f"the checks assumed the tip at {_words(start_mm)} (--start), but {says} "
            f"{_words(other)}, {away:.2f} mm away (maximum {ASIDE_MM:g}): nothing was moved. "
            f"Specify --start {','.join(f'{mm:g}' for mm in other)} if it is there, or move it to "
            "the start"
        )


def _words(place: Place) -> str:
    return " ".join(f"{axis}{mm:.2f}" for axis, mm in zip("XYZ", place, strict=True))
