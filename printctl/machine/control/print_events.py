"""Handle a printer's events (errors, resets, lost port) during a print."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final, NoReturn

from firmware_profiles.families import link_protocol as said
from printctl.machine.control.channel import Channel, PrinterReplies
from printctl.machine.control.interruption import Interruption
from printctl.machine.control.kill import HALTED_BEFORE, Kill
from printctl.machine.control.logbook import Logbook
from printctl.machine.control.requests import Request, RequestQueue, ResumeRequest
from printctl.machine.control.wiring import Wiring
from printctl.machine.errors import HandshakeError
from printctl.machine.job.motor_run_on import MotorRunOn
from printctl.machine.records.states import EARLY, LinkState, PrintEnded
from sim.gcode.reading import is_motion

OWN_MOVES: Final = frozenset({LinkState.PAUSING, LinkState.RESUMING, LinkState.STOPPING})
"""States in which the link sends commands of its own alone."""
_HEADER_LINES: Final = 200
UNANSWERED_S: Final = 5.0
"""A line that isn't answered for so long is a cause to look for other programs at the port."""
LOOK_S: Final = 1.0
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


class PrintEvents:
    """Handles the events of one print.

    Parameters
    ----------
    wiring : Wiring
    logbook : Logbook
    kill : Kill
    requests : RequestQueue
    heard : PrinterReplies
    interruption : Interruption
    """

    def __init__(
        self,
        wiring: Wiring,
        logbook: Logbook,
        kill: Kill,
        requests: RequestQueue,
        heard: PrinterReplies,
        interruption: Interruption,
    ) -> None:
        self._interruption = interruption
        self._wiring, self._logbook, self._progress = wiring, logbook, logbook.progress
        self._kill, self._requests, self._heard = kill, requests, heard
        self._stolen, self._held = 0, False
        self._missing, self._next_look_s = 0, -math.inf
        self._number, self._number_s = -1, math.inf
        self._handlers: dict[type, Callable[[Any], None]] = {
            said.Fault: self._on_fault,
            said.Notice: self._on_notice,
            said.Remark: self._on_remark,
            said.LinesResent: self._on_went_back,
            said.StrayOk: self._on_stray,
            said.TokenSent: self._on_token_sent,
            said.Waiting: self._on_waiting,
            said.Action: self._on_action,
            said.WaitingForPerson: self._on_person_awaited,
            said.Noisy: self._on_noisy,
            said.LineRefused: self._on_line_refused,
            said.Halting: self._on_halting,
            said.FirmwareHalted: self._on_halted,
            said.FirmwareStarted: self._on_booted,
            said.FirmwareReset: self._on_reset,
            said.Renumbered: self._on_renumbered,
            said.LostSynchronisation: self._on_out_of_step,
            said.NoReply: self._on_silent,
        }

    def handle(self, event: said.Event) -> None:
        """See `EventHandler`."""
        if not self._kill.asked.is_set() and not isinstance(event, said.TokenSent):
            if isinstance(event, said.Notice) and self._logbook.begun:
                self._missing += 1
            self._look_for_programs()
        self._handlers[type(event)](event)

    def step_made(self) -> None:
        """Act on a stop that was asked for meanwhile; notice another reader of the port."""
        self._interruption.look()
        if self._wiring.transport.stolen > self._stolen:
            self._stolen = self._wiring.transport.stolen
            text = (
                f"another program reads this port ({self._wiring.transport.name}): answers of the "
                "printer are missing here; close it there"
            )
            self._logbook.alarm(text, kind="stolen")
            self._look_for_programs()
            self._hold(text)
        self._look_behind_silence()

    def _look_behind_silence(self) -> None:
        """Name who else has the port open where a line isn't answered for long: once a line."""
        protocol, now = self._wiring.protocol, self._wiring.clock.now()
        if protocol.idle or protocol.number != self._number:
            self._number, self._number_s = protocol.number, now
        elif now - self._number_s > UNANSWERED_S:
            self._number_s = math.inf
            self._look_for_programs(hold=False)  # a long move isn't answered either

    def _look_for_programs(self, hold: bool = True) -> None:
        """Name who else has the port open, once something odd was seen."""
        transport, now = self._wiring.transport, self._wiring.clock.now()
        if now < self._next_look_s:
            return
        self._next_look_s = now + LOOK_S
        found = transport.programs()
        if found.names:
            text = (
                f"another program ({'; '.join(found.names)}) has this port open "
                f"({transport.name}): it may take answers of the printer, or write to it; close it"
            )
            self._logbook.alarm(text, kind=text)
            if hold:
                self._hold(text)
        elif not (found.complete or self._wiring.protocol.line_errors) and (
            self._missing >= MISSING_ANSWERS
        ):
            self._logbook.alarm(
                f"{self._missing} answers of the printer were missing or cut, and no line to it "
                f"was garbled: another program may read this port ({transport.name}); "
                "see that nothing else uses it, then check the cable",
                kind="missing answers",
            )

    def _hold(self, why: str) -> None:
        """Have the print paused where another program uses the port; once, then a person knows.

        Before the job's first move the needle isn't in anything.
        """
        moved = any(map(is_motion, self._progress.taken[:_HEADER_LINES]))
        if not self._held and moved and self._logbook.state is LinkState.PRINTING:
            self._held = True
            self._requests.add(Request.PAUSE, why=why)

    def between_commands(self) -> None:
        """Go no further where a stop was asked for."""
        self._interruption.check()

    # --- for the journal -------------------------------------------------------------------------

    def _on_notice(self, event: said.Notice) -> None:
        self._logbook.notice(event.text)

    def _on_remark(self, event: said.Remark) -> None:
        self._logbook.remark(event.text, event.known)

    def _on_went_back(self, event: said.LinesResent) -> None:
        self._logbook.alarm(
            f"lines {event.first} to {event.last} weren't taken after all; sent again"
        )
        self._progress.went_back()
        if self._logbook.begun:  # else lines are numbered anew before the job
            self._logbook.record_back(event.first - 1, event.controls)

    def _on_token_sent(self, event: said.TokenSent) -> None:
        if self._logbook.begun:
            self._logbook.record_control(event.number, event.command)

    def _on_waiting(self, event: said.Waiting) -> None:
        self._logbook.alarm(
            f"no usable answer for {event.seconds:.0f} s after {self._progress.words()}; asked "
            f"on, the print ends after {event.limit:.0f} s (--silent-limit)"
        )

    def _on_stray(self, event: said.StrayOk) -> None:
        if self._kill.asked.is_set():  # its own M410 is answered by an ok, too
            return
        self._progress.doubt()
        if not event.foreign:
            self._logbook.notice(f"an ok without a line, near line {event.number}")
            return
        self._progress.count_foreign(event.foreign)
        self._logbook.alarm(
            f"{self._progress.foreign_words()} (noticed after {self._progress.words()}); see that "
            "nothing else uses its port, and look at the part",
            kind="foreign lines",
        )
        self._hold(self._progress.foreign_words())

    def _on_renumbered(self, event: said.Renumbered) -> None:
        self._progress.doubt()
        self._progress.count_foreign(1)
        text = (
            f"the printer's count of lines became {event.last}, and this print's is "
            f"{event.expected}: another program writes to this port (M110), or the board was reset "
            "without a word; the count is set back, the position compared"
        )
        self._logbook.alarm(text, kind="renumbered")
        self._hold(text)

    # --- what holds the print --------------------------------------------------------------------

    def _on_fault(self, event: said.Fault) -> None:
        job = self._progress.job
        where = f"line {job.file_line(event.line)} of {job.name}"
        if event.refused and self._progress.refuse(event.line, event.about_command):
            text = f"the printer refused {where}: {event.text!r}"
        elif self._logbook.state in OWN_MOVES or self._progress.done == len(job):
            text = (
                f"the printer says {event.text!r} (to a command of the link's own, behind {where})"
            )
        else:
            text = f"the printer says {event.text!r} ({where})"
        self._logbook.complain(text, event.about_command)
        self._logbook.alarm(text)

    def _on_action(self, event: said.Action) -> None:
        if event.name in _ACTIONS:
            self._logbook.alarm(f"the printer asks for {event.name!r}")
            self._requests.add(_ACTIONS[event.name], by=f"the printer (//action:{event.name})")
        elif event.name.startswith(_PROMPT):
            text = event.name.removeprefix(_PROMPT).strip()
            self._logbook.alarm(f"the printer asks at its own screen: {text!r}")

    def _on_person_awaited(self, event: said.WaitingForPerson) -> None:
        self._logbook.alarm(
            "the printer waits for somebody to press its own button (paused for user): press it or "
            "stop the print"
        )

    def _on_noisy(self, event: said.Noisy) -> None:
        why = f"{event.errors} line errors in {event.lines} lines"
        self._logbook.alarm(f"{why}; pausing: check cable and earthing")
        self._requests.add(Request.PAUSE, why=f"{why}; check cable and earthing")

    # --- what ends it ----------------------------------------------------------------------------

    def _on_halting(self, event: said.Halting) -> None:
        if self._kill.asked.is_set():  # it is known why
            self._on_halted(said.FirmwareHalted(event.text))
        self._kill.halted()
        self._logbook.alarm(f"the firmware halted itself ({event.text}); it is asked why")

    def _on_halted(self, event: said.FirmwareHalted) -> None:
        itself = self._kill.halted_itself
        self._kill.halted()
        if itself and self._kill.asked.is_set():
            message = f"{HALTED_BEFORE} ({event.text})"
            raise PrintEnded(LinkState.KILLED, message, known=False)
        run_on = self._run_on()
        if self._kill.asked.is_set():
            raise PrintEnded(LinkState.KILLED, self._kill.words(run_on), known=False)
        because = f": {self._logbook.fault}" if self._logbook.fault else ""
        raise PrintEnded(
            LinkState.KILLED,
            f"the firmware halted itself ({event.text}){because}; "
            f"{self._kill.halting.told(run_on, stopped=False)}",
            known=False,
        )

    def _run_on(self) -> MotorRunOn | None:
        """How far motors may run on; None where other moves than the job's may be under way."""
        if self._logbook.state is not LinkState.PRINTING:
            return None
        return self._progress.run_on(self._wiring.clock.now())

    def _on_booted(self, event: said.FirmwareStarted) -> None:
        if self._kill.asked.is_set():
            raise PrintEnded(LinkState.KILLED, "killed by the user, by the reset line", known=False)

    def _on_reset(self, event: said.FirmwareReset) -> None:
        self._on_booted(said.FirmwareStarted())
        if not self._logbook.begun:
            raise HandshakeError(
                f"the printer at {self._wiring.transport.name} was reset during the handshake; "
                "check its power and cable, and try again"
            )
        raise PrintEnded(
            LinkState.POSITION_UNKNOWN,
            f"the printer was reset after {self._progress.words()}; `printctl status` says what "
            "next",
            known=False,
        )

    def _on_out_of_step(self, event: said.LostSynchronisation) -> None:
        raise PrintEnded(
            LinkState.POSITION_UNKNOWN,
            f"the printer's last line is {event.last}, the host's {event.expected}; another "
            "program may have spoken to it; `printctl status` says what next",
            known=False,
        )

    def _on_silent(self, event: said.NoReply) -> None:
        if self._logbook.state in EARLY:
            printer = self._wiring.printer
            raise HandshakeError(
                f"{self._unanswered(event.seconds)}; check that the "
                f"printer is on, its baud rate (profile: {printer.baud}) and its firmware "
                f"(profile: {printer.firmware})"
            )
        silent = f"the printer gave no usable answer for {event.seconds:.0f} s after "
        words = self._progress.words()
        self._give_up(silent + words, "; the next line may or may not have been taken")

    def _on_line_refused(self, event: said.LineRefused) -> None:
        job = self._progress.job
        where = f"line {job.file_line(event.line)} of {job.name}" if event.line else "a command"
        why = (
            f"the printer didn't take {event.command!r} ({where}, sent as N{event.number}) in "
            f"{event.times} tries, and nothing else in between"
        )
        why += f"; it answers {event.text!r}" if event.text else ""
        remedy = "check cable, earthing and firmware"
        if self._logbook.state in EARLY:
            lost = ", which loses its position: `printctl recover` goes on then"
            restart = "restart the printer" + (lost if self._logbook.resumed else "")
            raise HandshakeError(f"{why}; {remedy}; if it stays so, {restart}")
        self._give_up(f"{why}, after {self._progress.words()}", f"; {remedy}")

    def _give_up(self, why: str, more: str) -> NoReturn:
        """End the print of a printer that does nothing that it is told."""
        complaint = self._complaint
        if complaint:
            message = f"{complaint}; then {why}: cut its power"
        else:
            message = f"{why}{more}"
            if self._logbook.state is not LinkState.PAUSED:
                stands = self._progress.standing_words() or "where its motors stand isn't known"
                message += (
                    f"; {stands}, and the needle wasn't lifted, it may be in the ink: cut the "
                    "printer's power, then lift the needle straight up by hand"
                )
        raise PrintEnded(LinkState.FAILED, message, known=False)

    def _unanswered(self, seconds: float) -> str:
        """Say whether nothing came, or nothing that can be understood."""
        name, heard = self._wiring.transport.name, self._heard
        if not heard.count:
            return f"no firmware answers at {name} (0 bytes heard in {seconds:.0f} s)"
        return (
            f"what answers at {name} can't be understood ({heard.count} bytes heard in "
            f"{seconds:.0f} s, the last: {heard.last!r})"
        )

    @property
    def _complaint(self) -> str:
        """The error for which the print is being ended, or is to be; empty for none."""
        if self._logbook.state is LinkState.STOPPING:
            return self._logbook.status.message
        return self._logbook.fault


def print_channel(
    wiring: Wiring, logbook: Logbook, requests: RequestQueue
) -> tuple[Channel, Interruption]:
    """Return a conversation whose events are a print's, and what stops it in mid-wait."""
    kill, heard = Kill(wiring), PrinterReplies()
    interruption = Interruption(wiring, logbook, requests, kill, heard)
    handler = PrintEvents(wiring, logbook, kill, requests, heard, interruption)
    return Channel(wiring, logbook, kill, handler, heard), interruption
