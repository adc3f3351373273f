"""Handle a printer's events (errors, resets, lost port) during a print: one table of handlers."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final, NoReturn

from firmware_profiles.families import link_protocol as wire
from gcode.reading import is_motion
from printctl.machine.control.board.channel import Channel
from printctl.machine.control.board.halting import HALTED_BEFORE
from printctl.machine.control.interruption import Interruption
from printctl.machine.control.requests import PauseUntil, Request, RequestQueue, ResumeRequest
from printctl.machine.errors import HandshakeError
from printctl.machine.records.states import EARLY, LinkState, PrintEnded

OWN_MOVES: Final = frozenset({LinkState.PAUSING, LinkState.RESUMING, LinkState.STOPPING})
"""States in which the link sends commands of its own alone."""
_HEADER_LINES: Final = 200
UNANSWERED_S: Final = 5.0
"""A line that isn't answered for so long is a cause to look for other programs at the port."""
LOOK_INTERVAL_S: Final = 1.0
"""Least interval of looks for other programs at the port."""
MISSING_ANSWERS: Final = 2
"""From so many on, on a wire that garbles no line, another reader is suspected."""
_ACTIONS: Final[dict[str, Request | ResumeRequest]] = {
    "pause": Request.PAUSE,
    "paused": Request.PAUSE,
    "cancel": Request.STOP,
    "resume": ResumeRequest(),
}
"""What a printer may ask its host for (``//action:pause``)."""
_PROMPT: Final = "prompt_begin"
_WHAT_NEXT: Final = "`printctl status` lists the next steps"


class PrintEvents:
    """Handles the events of one print; a mode of other handlers overrides these.

    ``stop`` cuts waits short; None where nothing is to.
    """

    def __init__(
        self, channel: Channel, requests: RequestQueue, stop: Interruption | None = None
    ) -> None:
        self._channel, self._requests, self._stop = channel, requests, stop
        self._wiring, self._kill, self._logbook = channel.wiring, channel.kill, channel.logbook
        self._progress = channel.logbook.progress
        self._stolen, self._paused = 0, False
        self._missing, self._next_look_s = 0, -math.inf
        self._number, self._number_s = -1, math.inf
        self._handlers: dict[type, Callable[[Any], None]] = {
            wire.Fault: self._on_fault,
            wire.Notice: self._on_notice,
            wire.Remark: lambda event: self._logbook.remark(event.text, event.known),
            wire.LinesResent: self._on_went_back,
            wire.StrayOk: self._on_stray,
            wire.TokenSent: self._on_token_sent,
            wire.Waiting: self._on_waiting,
            wire.Action: self._on_action,
            wire.WaitingForPerson: self._on_person_awaited,
            wire.Noisy: self._on_noisy,
            wire.LineRefused: self._on_line_refused,
            wire.Halting: self._on_halting,
            wire.FirmwareHalted: self._on_halted,
            wire.FirmwareStarted: self._on_booted,
            wire.FirmwareReset: self._on_reset,
            wire.Renumbered: self._on_renumbered,
            wire.LostSynchronisation: self._on_out_of_step,
            wire.NoReply: self._on_silent,
        }

    def handle(self, event: wire.Event) -> None:
        """See `EventHandler`."""
        if not self._kill.asked.is_set() and not isinstance(event, wire.TokenSent):
            if isinstance(event, wire.Notice) and self._logbook.begun:
                self._missing += 1
            self._look_for_programs()
        self._handlers[type(event)](event)

    def between_commands(self) -> None:
        """Go no further where a stop was requested."""
        if self._stop is not None:
            self._stop.check()

    def step_made(self) -> None:
        """Act on a stop that was requested meanwhile; notice another reader of the port."""
        if self._stop is not None:
            self._stop.look()
        transport, protocol = self._wiring.transport, self._wiring.protocol
        if transport.stolen > self._stolen:
            self._stolen = transport.stolen
            text = (
                f"another program is reading this port ({transport.name}): printer replies are "
                "missing here; close that program"
            )
            self._logbook.alarm(text, kind="stolen")
            self._look_for_programs()
            self._pause_once(text)
        now = self._channel.now
        if protocol.idle or protocol.number != self._number:
            self._number, self._number_s = protocol.number, now
        elif now - self._number_s > UNANSWERED_S:  # once a line
            self._number_s = math.inf
            self._look_for_programs(pause=False)  # a long move isn't answered either

    def _look_for_programs(self, pause: bool = True) -> None:
        """Name what else has the port open, once something odd was seen."""
        transport, now = self._wiring.transport, self._channel.now
        if now < self._next_look_s:
            return
        self._next_look_s = now + LOOK_INTERVAL_S
        found = transport.programs()
        suspected = self._missing >= MISSING_ANSWERS and not self._wiring.protocol.line_errors
        if found.names:
            text = (
                f"another program ({'; '.join(found.names)}) has this port open "
                f"({transport.name}): it may read the printer's replies, or write to it; close it"
            )
            self._logbook.alarm(text, kind=text)
            if pause:
                self._pause_once(text)
        elif suspected and not found.complete:
            self._logbook.alarm(
                f"{self._missing} printer replies were missing or truncated, but no line sent was "
                f"garbled: another program may be reading this port ({transport.name}); check that "
                "nothing else uses it, then check the cable",
                kind="missing answers",
            )

    def _pause_once(self, why: str) -> None:
        """Have the print paused where another program uses the port; once, then a person knows.

        Before the job's first move the needle isn't in anything.
        """
        moved = any(map(is_motion, self._progress.taken[:_HEADER_LINES]))
        if not self._paused and moved and self._logbook.state is LinkState.PRINTING:
            self._paused = True
            self._requests.add(Request.PAUSE, why=why)

    # --- for the journal -------------------------------------------------------------------------

    def _on_notice(self, event: wire.Notice) -> None:
        self._logbook.notice(event.text)

    def _on_went_back(self, event: wire.LinesResent) -> None:
        self._logbook.alarm(
            f"lines {event.first} to {event.last} weren't accepted after all; sent again"
        )
        self._progress.went_back()
        if self._logbook.begun:  # else lines are numbered anew before the job
            self._logbook.record_back(event.first - 1, event.controls)

    def _on_token_sent(self, event: wire.TokenSent) -> None:
        if self._logbook.begun:
            self._logbook.record_control(event.number, event.command)

    def _on_waiting(self, event: wire.Waiting) -> None:
        self._logbook.alarm(
            f"no valid reply for {event.seconds:.0f} s after {self._progress.words()}; still "
            f"querying, the print ends after {event.limit:.0f} s (--silent-limit)"
        )

    def _on_stray(self, event: wire.StrayOk) -> None:
        if self._kill.asked.is_set():  # its own M410 is answered by an ok, too
            return
        self._progress.unverified = True
        if event.line:
            self._progress.doubled.append(event.line)
            self._logbook.alarm(self._progress.doubled_words(), kind="doubled lines")
        if not event.foreign:
            self._logbook.notice(f"an ok without a line, near line {event.number}")
            return
        self._progress.count_foreign(event.foreign)
        self._logbook.alarm(
            f"{self._progress.foreign_words()} (noticed after {self._progress.words()}); check "
            "that nothing else uses its port, and inspect the part",
            kind="foreign lines",
        )
        self._pause_once(self._progress.foreign_words())

    def _on_renumbered(self, event: wire.Renumbered) -> None:
        self._progress.unverified = True
        self._progress.count_foreign(1)
        text = (
            f"the printer's line counter became {event.last}, but this print's is "
            f"{event.expected}: another program writes to this port (M110), or the board was reset "
            "silently; the counter is set back and the position verified"
        )
        self._logbook.alarm(text, kind="renumbered")
        if self._channel.moving:  # it would go again before anything is compared
            raise PrintEnded(
                LinkState.POSITION_UNKNOWN,
                f"{text}, but a needle move was in progress: it wasn't sent again; check where the "
                f"needle is; {_WHAT_NEXT}",
                known=False,
            )
        self._pause_once(text)

    # --- what holds the print --------------------------------------------------------------------

    def _line(self, line: int) -> str:
        job = self._progress.job
        return f"line {job.file_line(line)} of {job.name}"

    def _on_fault(self, event: wire.Fault) -> None:
        where, says = self._line(event.line), f"the printer reports {event.text!r}"
        refused = event.refused and self._progress.refuse(event.line, event.about_command)
        if refused and event.about_command:
            text = f"the printer rejected {where}: {event.text!r}"
        elif self._logbook.state in OWN_MOVES or self._progress.done == len(self._progress.job):
            text = f"{says} (to a command sent by the link, after {where})"
        else:
            text = f"{says} ({where})"
        self._logbook.complain(text, event.about_command)
        self._logbook.alarm(text)

    def _on_action(self, event: wire.Action) -> None:
        if event.name in _ACTIONS:
            self._logbook.alarm(f"the printer requests {event.name!r}")
            self._requests.add(_ACTIONS[event.name], by=f"the printer (//action:{event.name})")
        elif event.name.startswith(_PROMPT):
            text = event.name.removeprefix(_PROMPT).strip()
            self._logbook.alarm(f"the printer prompts on its own screen: {text!r}")

    def _on_person_awaited(self, event: wire.WaitingForPerson) -> None:
        self._logbook.alarm(
            "the printer waits for its own button to be pressed (paused for user): press it or "
            "cancel the print"
        )

    def _on_noisy(self, event: wire.Noisy) -> None:
        why = f"{event.errors} line errors in {event.lines} lines"
        self._logbook.alarm(f"{why}; pausing: check cable and grounding")
        words = (
            f"{why}; check cable and grounding; the print resumes by itself once errors are rare"
        )
        self._requests.add(Request.PAUSE, why=words, until=PauseUntil.QUIET)

    # --- what ends it ----------------------------------------------------------------------------

    def _on_halting(self, event: wire.Halting) -> None:
        if self._kill.asked.is_set():  # it is known why
            self._on_halted(wire.FirmwareHalted(event.text))
        self._kill.halted()
        self._logbook.alarm(f"the firmware halted itself ({event.text}); querying the reason")

    def _on_halted(self, event: wire.FirmwareHalted) -> None:
        itself, killed = self._kill.halted_itself, self._kill.asked.is_set()
        self._kill.halted()
        run_on = None  # unknown where other moves than the job's may be under way
        if self._logbook.state is LinkState.PRINTING and not (itself and killed):
            run_on = self._progress.run_on(self._channel.now)
        if itself and killed:
            message = f"{HALTED_BEFORE} ({event.text})"
        elif killed:
            message = self._kill.words(run_on)
        else:
            because = f": {self._logbook.fault}" if self._logbook.fault else ""
            ran_on = self._kill.halting.words(run_on, stopped=False)
            message = f"the firmware halted itself ({event.text}){because}; {ran_on}"
        raise PrintEnded(LinkState.KILLED, message, known=False)

    def _on_booted(self, event: wire.FirmwareStarted) -> None:
        if self._kill.asked.is_set():
            raise PrintEnded(
                LinkState.KILLED, "emergency stop by the user (reset line)", known=False
            )
        if not self._wiring.fresh and not self._logbook.begun:
            self._lost_before_print()  # nobody has opened its port: it wasn't that

    def _lost_before_print(self) -> NoReturn:
        raise PrintEnded(
            LinkState.FAILED,
            f"the printer at {self._wiring.transport.name} was reset before the first line of the "
            "print: its position is lost; check its power and cable, check where the tip is, and "
            "try again",
            known=False,
            error=HandshakeError.__name__,
        )

    def _on_reset(self, event: wire.FirmwareReset) -> None:
        self._on_booted(wire.FirmwareStarted())
        if not self._logbook.begun:
            raise HandshakeError(
                f"the printer at {self._wiring.transport.name} was reset during the handshake; "
                "check its power and cable, and try again"
            )
        message = f"the printer was reset after {self._progress.words()}; {_WHAT_NEXT}"
        self._progress.reset()
        raise PrintEnded(LinkState.POSITION_UNKNOWN, message, known=False)

    def _on_out_of_step(self, event: wire.LostSynchronisation) -> None:
        raise PrintEnded(
            LinkState.POSITION_UNKNOWN,
            f"the printer's last line is {event.last}, the host's is {event.expected}; another "
            f"program may have sent commands; {_WHAT_NEXT}",
            known=False,
        )

    def _on_silent(self, event: wire.NoReply) -> None:
        if self._logbook.state not in EARLY:
            silent = f"no valid reply from the printer for {event.seconds:.0f} s after "
            words = self._progress.words()
            self._give_up(silent + words, "; the next line may or may not have been accepted")
        name, heard, printer = (
            self._wiring.transport.name,
            self._channel.heard,
            self._wiring.printer,
        )
        if heard.count:
            unanswered = (
                f"the replies at {name} can't be read ({heard.count} bytes received in "
                f"{event.seconds:.0f} s, the last: {heard.last!r})"
            )
        else:
            unanswered = (
                f"no firmware replies at {name} (0 bytes received in {event.seconds:.0f} s)"
            )
        raise HandshakeError(
            f"{unanswered}; check that the printer is on, its baud rate (profile: {printer.baud}) "
            f"and its firmware (profile: {printer.firmware})"
        )

    def _on_line_refused(self, event: wire.LineRefused) -> None:
        where = self._line(event.line) if event.line else "a command"
        why = (
            f"the printer didn't accept {event.command!r} ({where}, sent as N{event.number}) in "
            f"{event.times} attempts, and nothing else in between"
        )
        why += f"; it replies {event.text!r}" if event.text else ""
        remedy = "check cable, grounding and firmware"
        if self._logbook.state in EARLY:
            lost = ", which loses its position: then continue with `printctl recover`"
            restart = "restart the printer" + (lost if self._logbook.resumed else "")
            raise HandshakeError(f"{why}; {remedy}; if that doesn't help, {restart}")
        self._give_up(f"{why}, after {self._progress.words()}", f"; {remedy}")

    def _give_up(self, why: str, more: str) -> NoReturn:
        """End the print of a printer that obeys nothing."""
        logbook = self._logbook
        stopping = logbook.state is LinkState.STOPPING  # then its message is the error
        complaint = logbook.status.message if stopping else logbook.fault
        message = f"{complaint}; then {why}: cut its power" if complaint else f"{why}{more}"
        raise PrintEnded(LinkState.FAILED, message, known=False)
