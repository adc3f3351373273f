"""Communication channel to one printer: send commands, match replies, pass on its events.

Everything that waits here is steps (`printctl.machine.control.board.steps`), driven by one thread,
the one that owns the port. Other threads leave requests (`printctl.machine.control.requests`), or
halt the firmware (`printctl.machine.control.board.halting`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final, Protocol

from firmware_profiles.families import link_protocol as wire
from gcode.reading import code_of, is_motion, read_sent
from printctl.machine.control.board.halting import Kill
from printctl.machine.control.board.logbook import Logbook
from printctl.machine.control.board.steps import Steps, Urgent, Wait, carried_out
from printctl.machine.control.board.wiring import Wiring
from printctl.machine.families import link_facts
from printctl.machine.job.coordinates import AXES

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


def nothing_compared() -> Steps[None]:
    """Compare no place."""
    yield from ()


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
        # compares the place once the printer's count of lines was set back; may end the print
        self.compare_place: Callable[[], Steps[None]] = nothing_compared
        self.troubles = 0  # events beside answers: what came garbled, late or not at all
        # by axis: the places, mm, that commands between lines led to since the motors were at rest
        self.led: dict[str, list[float]] = {}
        self._awaited, self._recorded = -1, b""  # number and text of the command being waited for
        self._moving = False  # it leads somewhere
        self.set_backs = 0  # of the printer's count of lines
        self._compared = 0  # those of them at which the place was compared
        self._replies: list[wire.CommandReplied] = []
        self._in_step: list[int] = []

    @property
    def now(self) -> float:
        """Time of the last event, s."""
        return self.wiring.exchange.now_s

    # --- one step --------------------------------------------------------------------------------

    def pump(self, until: float = math.inf) -> Steps[None]:
        """Have written what is due, and hear what comes next."""
        protocol = self.wiring.protocol
        if self.kill.asked.is_set():
            yield from self.await_halt()
        self._write()
        now, data = yield Wait(min(protocol.deadline, until))
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

    def _write(self) -> None:
        """Have written what the protocol has ready."""
        output = self.wiring.protocol.take_output()
        if output:
            self.wiring.exchange.effects.append(output)

    def send_at_once(self, data: bytes) -> Steps[None]:
        """Send past the protocol, before all that hasn't left yet; `PortLost` where that fails."""
        self.wiring.exchange.effects.append(Urgent(data))
        yield from carried_out()

    def tell(self, report: Callable[..., None], *values: object) -> None:
        """Have something reported to a client, once what it is about is in the journal."""
        self.wiring.exchange.tell(report, *values)

    def listen(self, seconds: float) -> Steps[None]:
        """Hear the printer for so long."""
        until = self.now + seconds
        while self.now < until:
            yield from self.pump(until)

    def look_around(self) -> None:
        """Have what goes on beside the protocol noticed, where a loop reads by itself."""
        self.handler.step_made()

    def settle(self) -> Steps[None]:
        """Send no further job line; wait until what is in flight is taken."""
        protocol = self.wiring.protocol
        protocol.held = True
        while not protocol.idle:
            yield from self.pump()

    def await_halt(self) -> Steps[None]:
        """Wait for the printer to say that it was halted, by another thread; end the print."""
        protocol = self.wiring.protocol
        yield from self.kill.await_halt(lambda data, now: self.handle(protocol.feed(data, now)))

    # --- commands and agreements -----------------------------------------------------------------

    def command(self, text: bytes, journalled: bool = True) -> Steps[tuple[bytes, ...]]:
        """Send a control command with nothing in flight; return the printer's reply.

        Behind M400 the printer has to confirm that it is idle: an ok alone may be another line's.
        """
        yield from self._compare_where_set_back()
        protocol = self.wiring.protocol
        self.handler.between_commands()
        self._replies.clear()
        self._awaited, self._recorded = protocol.number + 1, text if journalled else b""
        if journalled:
            self.logbook.record_control(self._awaited, text)
        self._moving = self._note_way(text)
        protocol.submit(text, self.now)
        while not self._replies:
            yield from self.pump()
        if text == b"M400":
            yield from self.agree(protocol.confirm)
            yield from self._ask_board(journalled)
            self.logbook.progress.stands_still()
            if not self.logbook.progress.dropped:  # else M400 is answered where the motors stopped
                self.led = {axis: places[-1:] for axis, places in self.led.items()}
        lines = self._replies[0].lines
        yield from self._compare_where_set_back()
        self.handler.between_commands()
        return lines

    @property
    def moving(self) -> bool:
        """Whether a command that leads somewhere waits for its answer."""
        return self._moving and not self._replies

    def _compare_where_set_back(self) -> Steps[None]:
        """Have the place compared before anything else where the count of lines was set back."""
        if self.set_backs > self._compared:
            self._compared = self.set_backs
            yield from self.compare_place()

    def _note_way(self, text: bytes) -> bool:
        """Note where a command leads to, or what it calls the place; return whether it leads."""
        names, moves = code_of(text) == b"G92", is_motion(text)
        placed = False
        if names or moves:
            for axis, mm in read_sent(text).words.items():
                if axis in AXES and mm is not None:
                    before = self.led.get(axis, [])
                    if names and before:  # a move that goes on is renamed with the rest
                        before = [place + mm - before[-1] for place in before]
                    self.led[axis] = [*before, mm]
                    placed = True
        return moves and placed

    def _ask_board(self, journalled: bool) -> Steps[None]:
        """Have the board itself say that it has come to rest, where M400 doesn't reach it."""
        question = link_facts(self.wiring.printer).rest_question
        if question:
            before, replies = self.logbook.fault, list(self._replies)
            yield from self.command(question, journalled)
            self._replies[:] = replies
            if question.decode() in self.logbook.fault:  # a build without endstops doesn't know it
                self.logbook.excuse(before)

    def commands(self, texts: Sequence[bytes]) -> Steps[None]:
        """Send several, one after the other."""
        for text in texts:
            yield from self.command(text)

    def ask(self, text: bytes) -> Steps[tuple[bytes, ...]]:
        """Send a command that isn't journalled; return the printer's reply."""
        return (yield from self.command(text, journalled=False))

    def agree(self, begin: Callable[[float], None]) -> Steps[int]:
        """Renumber or ask (``begin``); return the printer's last line."""
        self._in_step.clear()
        begin(self.now)
        while not self._in_step:
            yield from self.pump()
        return self._in_step[0]

    def _yield_number(self) -> None:
        """Await the command under the next number: a token of the protocol's own has taken its.

        So where a garbled answer was still in doubt when the command was given.
        """
        if not self._replies:
            self._awaited += 1
            if self._recorded:
                self.logbook.record_control(self._awaited, self._recorded)

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
                self.set_backs += isinstance(event, wire.Renumbered)
                self.handler.handle(event)
                if isinstance(event, wire.TokenSent) and event.number == self._awaited:
                    self._yield_number()
