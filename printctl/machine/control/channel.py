"""Communication channel to one printer: send commands, match replies, pass on its events.

Everything here runs in one thread, the one that owns the port. Other threads leave requests
(`printctl.machine.control.requests`), or halt the firmware (`printctl.machine.control.halting`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final, Protocol

from firmware_profiles.families import link_protocol as wire
from printctl.machine.control.halting import Kill
from printctl.machine.control.logbook import Logbook
from printctl.machine.control.wiring import Wiring
from printctl.machine.families import link_facts

POLL_S: Final = 0.04
"""Longest wait for the printer before requests are looked at."""
_LAST_BYTES: Final = 80


class EventHandler(Protocol):
    """What becomes of a printer's events; `Replied` and `Synchronised` are the channel's own."""

    def handle(self, event: wire.Event) -> None:
        """Handle an event; raise `PrintEnded` or `LinkError` where it ends all."""
        ...

    def step_made(self) -> None:
        """Do what is due after each step of a wait."""
        ...

    def between_commands(self) -> None:
        """Check before a command is sent and once it was answered; raise to end there."""
        ...


class PrinterReplies:
    """Bytes received from a printer."""

    def __init__(self) -> None:
        self.count, self._last = 0, b""
        self.booted = False  # its firmware has said that it starts
        self.heard_s = math.inf  # when the last of them came; of a job's lines, too

    def add(self, data: bytes, now: float) -> None:
        """Count what came by ``now``, s."""
        self.heard_s = now
        self.count += len(data)
        self._last = (self._last + data)[-_LAST_BYTES:]

    @property
    def last(self) -> str:
        """The last words, for a message."""
        return b" ".join(self._last.split()).decode("ascii", "backslashreplace")


class Channel:
    """Communication with one printer."""

    handler: EventHandler  # set before anything is sent

    def __init__(self, wiring: Wiring, logbook: Logbook, kill: Kill) -> None:
        self.wiring, self.logbook, self.kill = wiring, logbook, kill
        self.heard = PrinterReplies()
        self.on_step: Callable[[], None] | None = None  # in each step of a wait; may raise
        self.troubles = 0  # events beside answers: what came garbled, late or not at all
        self._awaited = -1
        self._replies: list[wire.CommandReplied] = []
        self._in_step: list[int] = []

    # --- one step --------------------------------------------------------------------------------

    def pump(self, until: float | None = None) -> None:
        """Write what is due, hear what comes, for at most `POLL_S`."""
        wiring, protocol = self.wiring, self.wiring.protocol
        if self.kill.asked.is_set():
            self.await_halt()
        output = protocol.take_output()
        if output:
            wiring.transport.write(output)
        now = wiring.clock.now()
        due = protocol.deadline if until is None else min(protocol.deadline, until)
        data = wiring.transport.read(min(POLL_S, max(0.0, due - now)))
        now = wiring.clock.now()
        if data:
            self.heard.add(data, now)
            self.handle(protocol.feed(data, now))
        if now >= protocol.deadline:
            self.handle(protocol.tick(now))
        if now >= self.logbook.next_note:
            self.logbook.note(now)
        self.handler.step_made()
        if self.on_step is not None:
            self.on_step()

    def listen(self, seconds: float) -> None:
        """Hear the printer for so long."""
        clock = self.wiring.clock
        until = clock.now() + seconds
        while clock.now() < until:
            self.pump(until)

    def look_around(self) -> None:
        """Have what goes on beside the protocol noticed, where a loop reads by itself."""
        self.handler.step_made()

    def settle(self) -> None:
        """Send no further job line; wait until what is in flight is taken."""
        protocol = self.wiring.protocol
        protocol.held = True
        while not protocol.idle:
            self.pump()

    def await_halt(self) -> None:
        """Wait for the printer to say that it was halted, by another thread."""
        self.kill.await_halt(self._hear)

    def _hear(self) -> None:
        if self.kill.halted_itself and (question := self.wiring.protocol.take_output()):
            self.wiring.transport.write(question)  # why: nothing else is left
        data = self.wiring.transport.read(POLL_S)
        if data:
            self.kill.heard()
            self.handle(self.wiring.protocol.feed(data, self.wiring.clock.now()))

    # --- commands and agreements -----------------------------------------------------------------

    def command(self, text: bytes, journalled: bool = True) -> tuple[bytes, ...]:
        """Send a control command with nothing in flight; return the printer's reply.

        Behind M400 the printer has to confirm that it is idle: an ok alone may be another line's.
        """
        protocol = self.wiring.protocol
        self.handler.between_commands()
        self._replies.clear()
        self._awaited = protocol.number + 1
        if journalled:
            self.logbook.record_control(self._awaited, text)
        protocol.submit(text, self.wiring.clock.now())
        while not self._replies:
            self.pump()
        if text == b"M400":
            self.agree(protocol.confirm)
            self._ask_board(journalled)
            self.logbook.progress.stands_still()
        self.handler.between_commands()
        return self._replies[0].lines

    def _ask_board(self, journalled: bool) -> None:
        """Have the board itself say that it has come to rest, where M400 doesn't reach it."""
        question = link_facts(self.wiring.printer).rest_question
        if question:
            before, replies = self.logbook.fault, list(self._replies)
            self.command(question, journalled)
            self._replies[:] = replies
            if question.decode() in self.logbook.fault:  # a build without endstops doesn't know it
                self.logbook.excuse(before)

    def commands(self, texts: Sequence[bytes]) -> None:
        """Send several, one after the other."""
        for text in texts:
            self.command(text)

    def ask(self, text: bytes) -> tuple[bytes, ...]:
        """Send a command that isn't journalled; return the printer's reply."""
        return self.command(text, journalled=False)

    def agree(self, begin: Callable[[float], None]) -> int:
        """Renumber or ask (``begin``); return the printer's last line."""
        self._in_step.clear()
        begin(self.wiring.clock.now())
        while not self._in_step:
            self.pump()
        return self._in_step[0]

    # --- events ----------------------------------------------------------------------------------

    def handle(self, events: Sequence[wire.Event]) -> None:
        """Take what is the channel's own; hand on the rest."""
        for event in events:
            if isinstance(event, wire.CommandReplied):
                if event.number == self._awaited:  # another's is of a command that was sent again
                    self._replies.append(event)
            elif isinstance(event, wire.Synchronised):
                self._in_step.append(event.number)
            else:
                self.troubles += not isinstance(event, wire.TokenSent)
                if isinstance(event, wire.LinesResent) and event.controls:
                    # the newest is the one whose reply is waited for
                    self._awaited = event.first + len(event.controls) - 1
                elif isinstance(event, (wire.FirmwareStarted, wire.FirmwareReset)):
                    self.heard.booted = True
                self.handler.handle(event)
