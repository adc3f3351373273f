"""Resume a print whose host died, from the printer's last accepted line."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

from printctl.machine.control.channel import Channel
from printctl.machine.control.excursion import Excursion
from printctl.machine.control.firmware_check import FirmwareCheck
from printctl.machine.control.foreign_changes import ForeignCommands
from printctl.machine.control.frame_check import FrameCheck
from printctl.machine.control.head_choice import HeadChoice
from printctl.machine.control.heat_check import HeatCheck
from printctl.machine.control.looks import Looks
from printctl.machine.control.parking import Park, Parking
from printctl.machine.control.pauses import Pauses
from printctl.machine.control.position_check import PositionCheck
from printctl.machine.control.print_requests import PrintRequests
from printctl.machine.control.returning import Returning
from printctl.machine.control.valve_switch import ValveSwitch
from printctl.machine.control.watch import Watch
from printctl.machine.families import link_facts
from printctl.machine.job.coordinates import Modal
from printctl.machine.job.dispensing import is_open
from printctl.machine.records.journalled_print import JournalledPrint
from printctl.machine.records.states import LinkState, PrintEnded


@dataclass(frozen=True)
class Resumption:
    """Finds a printer in mid-job, and goes on from there if all agrees.

    Attributes
    ----------
    channel : Channel
    firmware : FirmwareCheck
    frame : FrameCheck
    heat : HeatCheck
    meddling : ForeignCommands
    heads : HeadChoice
    position : PositionCheck
    valve : ValveSwitch
    watch : Watch
    pauses : Pauses
    looks : Looks
    parking : Parking
    excursion : Excursion
    returning : Returning
    requests : PrintRequests
    """

    channel: Channel
    firmware: FirmwareCheck
    frame: FrameCheck
    heat: HeatCheck
    meddling: ForeignCommands
    heads: HeadChoice
    position: PositionCheck
    valve: ValveSwitch
    watch: Watch
    pauses: Pauses
    looks: Looks
    parking: Parking
    excursion: Excursion
    returning: Returning
    requests: PrintRequests

    def find_again(self, history: JournalledPrint) -> None:
        """Ask the printer for its last line; come back to where the job was.

        Raises
        ------
        PrintEnded
            Where the printer can't tell, or its line or position isn't the job's.
        """
        channel, logbook = self.channel, self.channel.logbook
        logbook.enter(LinkState.CHECKING, "asking the printer for the last line that it took")
        done, number = self._last_line(history)
        self.looks.restore(history, done)
        channel.wiring.protocol.load(logbook.progress.job.lines, done, number)
        self._shut_valve(done)
        self.firmware.check_keepalive(journalled=True)
        logbook.enter(LinkState.CHECKING, "waiting until the printer has made what it took")
        channel.command(b"M400")
        self.firmware.restore_settings(history.settings)
        if history.heat:
            self.heat.restore(history.heat["targets"], history.heat["line"])
        self.meddling.set_anew()
        if history.frame:
            self.frame.restore(**history.frame)
            self.position.refuse_renamed(waited=True)
        at = self.position.expected(history.left)
        if history.reload_at is not None:
            self.watch.plan(history.reload_at, history.reload_heads)
        self.pauses.change.filled.update(history.filled)
        changing = history.changing(number)
        if changing or history.reloaded == done:
            self.watch.paused(done)
        self.requests.remember(history.wanted)
        if changing or done == len(logbook.progress.job):
            self._found(done)
        if changing:
            head = None if history.reload is None else history.reload.get("head")
            self.pauses.await_syringe(at, head)
        elif done < len(logbook.progress.job):
            self._rejoin(at, history.park, done)
            if history.in_ink:
                logbook.progress.stood_without_host(time.time() - history.written_s)
        # else it died behind the last line, when settings may be as before the job: no move is left

    def _last_line(self, history: JournalledPrint) -> tuple[int, int]:
        """Return the printer's last line, as a line of the job and by its number."""
        wiring, progress = self.channel.wiring, self.channel.logbook.progress
        if not link_facts(wiring.printer).remembers:
            raise PrintEnded(
                LinkState.POSITION_UNKNOWN,
                f"{wiring.printer.firmware} can't tell which line it took last; at least "
                f"{history.done} job lines were taken; `printctl status` says what next",
                known=False,
            )
        number = self.channel.agree(wiring.protocol.ask)
        done = history.job_line(number)
        reset = self.channel.heard.booted or (number == 0 and history.done > 0)
        if reset or not history.done <= done <= len(progress.job):
            raise PrintEnded(
                LinkState.POSITION_UNKNOWN,
                f"the printer's last line is {number}, the journal knows of {history.done} job "
                "lines: it was reset or used by another program since; `printctl status` says "
                "what next",
                known=False,
            )
        return done, number

    def _found(self, done: int) -> None:
        """Take the printer's own count for the print's."""
        logbook = self.channel.logbook
        logbook.progress.journalled = None
        logbook.record("ack", done=done)

    def _shut_valve(self, done: int) -> None:
        self.valve.shut()
        logbook, printer = self.channel.logbook, self.channel.wiring.printer
        if is_open(logbook.progress.job.lines, done, printer):
            logbook.alarm(f"the valve stood open after line {done} while no host was there; look")

    def _rejoin(self, at: Modal, park: Park | None, done: int) -> None:
        logbook = self.channel.logbook
        self.excursion.begin(at, logbook.progress.relieved_mm, None)
        logbook.enter(LinkState.RESUMING, "returning to where the print was left")
        self.heads.take()
        if park is not None and self.parking.is_there(at, park):
            self.parking.come(at, park)
        self.position.verify(replace(at, z=None, e=None))  # a pause may have lifted and relieved
        self._found(done)
        self.returning.come_back(at)
