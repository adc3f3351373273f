"""A printer being spoken to: one step at a time, with journal, status, wishes and kill.

Everything here runs in one thread, the one that calls `Streamer.run`. Other threads only leave a
wish (`stop`, `pause`, `resume`, `command`), which is looked at between two lines, or `kill`,
which writes to the wire at once from the thread that calls it.
"""

from __future__ import annotations

import contextlib
import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

from firmware_profiles.families import link_protocol as said
from printctl.gate import Known, Phase, Refusal
from printctl.link.errors import HandshakeError, LinkError, PortLost
from printctl.link.firmware import Firmware
from printctl.link.gating import Manual, is_of_the_line, judge_typed, let_through
from printctl.link.halting import Halting, halting_of
from printctl.link.job import Job
from printctl.link.logbook import Logbook, Over, Wiring
from printctl.link.states import LinkState

__all__ = ["Channel", "Over", "Wiring"]

POLL_S: Final = 0.1
"""Longest wait for the printer before wishes are looked at."""
KILL_REPEAT_S: Final = 0.2
KILL_ATTEMPTS: Final = 10
KILL_WAIT_S: Final = 4.0
EARLY: Final = frozenset({LinkState.CONNECTING, LinkState.CHECKING})
"""States in which the printer hasn't got the job's first line."""
OWN_MOVES: Final = frozenset({LinkState.PAUSING, LinkState.RESUMING, LinkState.STOPPING})
"""States in which the link sends commands of its own alone."""


class Channel(Logbook):
    """One printer and one job.

    Parameters
    ----------
    wiring : Wiring
    job : Job
    """

    def __init__(self, wiring: Wiring, job: Job) -> None:
        super().__init__(wiring, job)
        self.firmware = Firmware()
        self._wishes: deque[str] = deque()
        self._commands: deque[Manual] = deque()
        self._resumed = self._unverified = False
        self._awaited = -1
        self._replies: list[said.Replied] = []
        self._in_step: list[int] = []
        self._settings: dict[str, str] = {}
        self._booted = False
        self._heard = 0
        self._kill_left = self._kill_host_s = 0.0
        self._kill_sent = False
        self._killed = threading.Event()
        self._halted = threading.Event()
        self._ended = threading.Event()

    # --- for any thread --------------------------------------------------------------------

    @property
    def halting(self) -> Halting:
        """How the firmware is halted: by what it says of itself (M115), else by its profile."""
        printer = self.wiring.printer
        parser = self.firmware.capabilities.get("EMERGENCY_PARSER", printer.emergency_parser)
        return halting_of(printer, self.protocol.kill_bytes, parser)

    def stop(self) -> None:
        """Ask for a controlled stop."""
        self._wishes.append("stop")

    def pause(self) -> None:
        """Ask for a pause."""
        self._wishes.append("pause")

    def resume(self) -> None:
        """Ask to go on after a pause."""
        self._wishes.append("resume")

    def command(self, text: bytes, done: Callable[[tuple[bytes, ...]], None]) -> None:
        """Ask for a command of the product's own between two lines; ``done`` is told the reply."""
        self._commands.append(Manual(text.decode("ascii"), done))

    def typed(
        self,
        text: str,
        done: Callable[[tuple[bytes, ...]], None],
        refused: Callable[[str], None],
    ) -> None:
        """Ask for a command that a person typed; the gate judges it once more when it is sent.

        Raises
        ------
        Refused
            When it passes in no state, or not while the print goes on.
        """
        if self._state is not LinkState.PAUSED:
            known = replace(self.wiring.limits(), phase=Phase.PRINTING)
            text = let_through(judge_typed(text, known)).text
        self._commands.append(Manual(text, done, refused))

    def kill(self) -> None:
        """Halt the firmware at once, from any thread and any state.

        The family's `halting` goes to the wire before anything else is done. M112 is repeated
        until the printer says that it has halted; after `KILL_ATTEMPTS` the reset line is pulled.
        """
        if self._ended.is_set():
            return
        asked = self._kill_left = self.wiring.clock.now()
        self._killed.set()
        halting = self.halting
        halts = ((halting.last, KILL_REPEAT_S),) * KILL_ATTEMPTS
        for attempt, (data, wait_s) in enumerate(halting.first + halts):
            with contextlib.suppress(PortLost):  # it may be full: the wire's end is found elsewhere
                self.wiring.transport.write_urgent(data)
                self._kill_sent |= data == halting.last
            if attempt == 0:
                self._kill_left = self.wiring.clock.now()
                self._kill_host_s = self._kill_left - asked
            if self._halted.wait(wait_s) or self._ended.is_set():
                return
        self._kill_sent = True
        self.wiring.transport.reset()

    # --- one step ----------------------------------------------------------------------------

    def _pump(self, until: float | None = None) -> None:
        """Write what is due, hear what comes, for at most `POLL_S`."""
        protocol, transport = self.protocol, self.wiring.transport
        if self._killed.is_set():
            self._await_halt()
        output = protocol.take_output()
        if output:
            transport.write(output)
        now = self.wiring.clock.now()
        due = protocol.deadline if until is None else min(protocol.deadline, until)
        data = transport.read(min(POLL_S, max(0.0, due - now)))
        now = self.wiring.clock.now()
        if data:
            self._heard += len(data)
            self._handle(protocol.feed(data, now))
        if now >= protocol.deadline:
            self._handle(protocol.tick(now))
        if now >= self._next_note:
            self._note(now)
        if self._state in EARLY and "stop" in self._wishes:
            self._stop_early()

    def _stop_early(self) -> None:
        if self._resumed:
            message = "stopped by the user before the printer was found again"
            raise Over(LinkState.FAILED, message, known=False)
        raise Over(LinkState.STOPPED, "stopped by the user before the first line")

    def _command(self, text: bytes, journalled: bool = True) -> tuple[bytes, ...]:
        """Send a control command with nothing in flight; give the printer's reply.

        Behind M400 the printer has to confirm that it is idle: an ok alone may be another line's.
        """
        self._replies.clear()
        self._awaited = self.protocol.number + 1
        if journalled:
            self._record("control", n=self._awaited, command=text.decode("ascii"))
        self.protocol.submit(text, self.wiring.clock.now())
        while not self._replies:
            self._pump()
        if text == b"M400":
            self._agree(self.protocol.confirm)
            self._made.waited(self.protocol.lines_done)
        return self._replies[0].lines

    def _carry_out(self, manual: Manual, known: Callable[[], Known]) -> None:
        """Send a manual command, if the gate lets it pass as things stand.

        What the printer says against it ends no print: nothing else was under way.
        """
        if manual.refused is None:
            manual.done(self._command(manual.text.encode("ascii")))
            return
        verdict = judge_typed(manual.text, known())
        if isinstance(verdict, Refusal):
            self._record("notice", text=verdict.message)
            manual.refused(verdict.message)
            return
        before = self._fault
        lines = self._command(verdict.text.encode("ascii"))
        if not before and is_of_the_line(self._fault):
            lines, self._fault = (*lines, self._fault.encode("ascii", "replace")), ""
        manual.done(lines)

    def _agree(self, begin: Callable[[float], None]) -> int:
        """Renumber or ask (``begin``); give the printer's last line."""
        self._in_step.clear()
        begin(self.wiring.clock.now())
        while not self._in_step:
            self._pump()
        return self._in_step[0]

    def _await_halt(self) -> None:
        """M112 was sent by another thread: wait for the printer to say so, send nothing more."""
        clock = self.wiring.clock
        limit = clock.now() + KILL_WAIT_S
        while clock.now() < limit or not self._kill_sent:
            if not self._kill_sent:
                limit = clock.now() + KILL_WAIT_S
            try:
                data = self.wiring.transport.read(POLL_S)
            except PortLost:
                break
            self._handle(self.protocol.feed(data, clock.now()) if data else ())
        raise Over(
            LinkState.KILLED,
            "killed by the user; the printer has NOT confirmed: cut its power",
            known=False,
        )

    # --- events ------------------------------------------------------------------------------

    def _handle(self, events: Sequence[said.Event]) -> None:
        for event in events:
            getattr(self, _ON_EVENT[type(event)])(event)

    def _on_replied(self, event: said.Replied) -> None:
        if event.number == self._awaited:  # another's is of a command that was sent again
            self._replies.append(event)

    def _on_in_step(self, event: said.InStep) -> None:
        self._in_step.append(event.number)

    def _on_notice(self, event: said.Notice) -> None:
        self._record("notice", text=event.text)

    def _on_went_back(self, event: said.WentBack) -> None:
        self._alarm(f"lines {event.first} to {event.last} weren't taken after all; sent again")
        self._unverified = True
        self._made.back(self.protocol.lines_done)
        if event.controls:  # the newest is what `_command` waits for
            self._awaited = event.first + len(event.controls) - 1
        if self._state in EARLY and not self._resumed:
            return  # lines are numbered anew before the job
        self._noted = self.protocol.lines_done
        self._record("back", done=self._noted, n=event.first - 1)
        for number, command in enumerate(event.controls, event.first):
            self._record("control", n=number, command=command.decode("ascii"))

    def _on_token_sent(self, event: said.TokenSent) -> None:
        if self._state not in EARLY or self._resumed:  # else lines are numbered anew
            self._record("control", n=event.number, command=event.command.decode("ascii"))

    def _on_waiting(self, event: said.Waiting) -> None:
        self._alarm(
            f"no usable answer for {event.seconds:.0f} s after {self._progress()}; asked on, the "
            f"print ends after {event.limit:.0f} s (--silent-limit)"
        )

    def _on_stray(self, event: said.Stray) -> None:
        self._record("notice", text=f"an ok without a line, near line {event.number}")
        self._unverified = True

    def _on_fault(self, event: said.Fault) -> None:
        where = f"line {self.job.file_line(event.line)} of {self.job.name}"
        if self._state in OWN_MOVES:
            where = f"to a command of the link's own, behind {where}"
        text = f"the printer says {event.text!r} ({where})"
        self._fault = self._fault or text
        self._alarm(text)

    def _on_action(self, event: said.Action) -> None:
        wish = {"pause": "pause", "paused": "pause", "cancel": "stop", "resume": "resume"}
        if event.name in wish:
            self._alarm(f"the printer asks for {event.name!r}")
            self._wishes.append(wish[event.name])

    def _on_noisy(self, event: said.Noisy) -> None:
        self._alarm(
            f"{event.errors} line errors in {event.lines} lines; pausing: check cable and earthing"
        )
        self._wishes.append("pause")

    def _on_halted(self, event: said.Halted) -> None:
        self._halted.set()
        if self._killed.is_set():
            printer_s = self.wiring.clock.now() - self._kill_left
            raise Over(
                LinkState.KILLED,
                f"killed by the user; {self.halting.words} left the host after "
                f"{self._kill_host_s * 1e3:.1f} ms, the printer said {printer_s * 1e3:.0f} ms "
                f"later that it has halted; "
                f"{self.halting.told(self._speed_mm_s)}",
                known=False,
            )
        because = f": {self._fault}" if self._fault else ""
        raise Over(
            LinkState.KILLED,
            f"the firmware halted itself ({event.text}){because}; "
            f"{self.halting.told(self._speed_mm_s, by_itself=True)}",
            False,
        )

    @property
    def _speed_mm_s(self) -> float:
        """How fast the needle may be, mm/s."""
        return self.wiring.printer.max_speed_mm_s.x

    def _on_booted(self, event: said.Booted) -> None:
        self._booted = True
        if self._killed.is_set():
            raise Over(LinkState.KILLED, "killed by the user, by the reset line", known=False)

    def _on_reset(self, event: said.WasReset) -> None:
        self._on_booted(said.Booted())
        if self._state in EARLY and not self._resumed:
            raise HandshakeError(
                f"the printer at {self.wiring.transport.name} was reset during the handshake; "
                "check its power and cable, and try again"
            )
        raise Over(
            LinkState.POSITION_UNKNOWN,
            f"the printer was reset after {self._progress()}; `printctl status` says what next",
            known=False,
        )

    def _on_out_of_step(self, event: said.OutOfStep) -> None:
        raise Over(
            LinkState.POSITION_UNKNOWN,
            f"the printer's last line is {event.last}, the host's {event.expected}; another "
            "program may have spoken to it; `printctl status` says what next",
            known=False,
        )

    def _on_silent(self, event: said.Silent) -> None:
        if self._state in EARLY:
            raise HandshakeError(
                f"no firmware answers at {self.wiring.transport.name} "
                f"({self._heard} bytes heard in {event.seconds:.0f} s); check that the printer is "
                f"on, its baud rate (profile: {self.wiring.printer.baud}) and its firmware "
                f"(profile: {self.wiring.printer.firmware})"
            )
        raise Over(
            LinkState.FAILED,
            f"the printer gave no usable answer for {event.seconds:.0f} s after "
            f"{self._progress()}; the next line may or may not have been taken",
            known=False,
        )

    def _broken(self, exc: LinkError) -> Over:
        name = type(exc).__name__
        if self._killed.is_set():
            return Over(LinkState.KILLED, f"killed by the user; {exc}", False, name)
        if isinstance(exc, PortLost):
            message = f"{exc}; {self._progress()}, the next may have been taken; position unknown"
            return Over(LinkState.FAILED, message, False, name)
        known = isinstance(exc, HandshakeError) and not self._resumed
        return Over(LinkState.FAILED, str(exc), known, name)


_ON_EVENT: Final[dict[type, str]] = {
    said.Replied: "_on_replied",
    said.InStep: "_on_in_step",
    said.Fault: "_on_fault",
    said.Notice: "_on_notice",
    said.WentBack: "_on_went_back",
    said.Stray: "_on_stray",
    said.TokenSent: "_on_token_sent",
    said.Waiting: "_on_waiting",
    said.Action: "_on_action",
    said.Noisy: "_on_noisy",
    said.Halted: "_on_halted",
    said.Booted: "_on_booted",
    said.WasReset: "_on_reset",
    said.OutOfStep: "_on_out_of_step",
    said.Silent: "_on_silent",
}
