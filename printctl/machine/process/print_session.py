"""Run one print on a station's open port, then return to standby."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from printctl.machine.control.known_state import Knowledge
from printctl.machine.control.station_status import Place, StationState
from printctl.machine.control.streamer import Streamer
from printctl.machine.errors import BY_NAME, LinkError, PortLost
from printctl.machine.job.job import Job, load_job
from printctl.machine.process.executed_note import record_for, write_note
from printctl.machine.process.link_owner import LinkOwner
from printctl.machine.process.plunger_travel import pushed_mm
from printctl.machine.process.printer_connection import PrinterConnection
from printctl.machine.process.process import Order, Wire, serve
from printctl.machine.process.station_orders import (
    check_homing,
    check_start,
    leaves_motors_on,
    read_order,
)
from printctl.machine.process.station_port import StationPort
from printctl.machine.process.station_report import StationReport, refusal
from printctl.machine.process.station_requests import Request, StationRequests
from printctl.machine.records.record import JOURNAL
from printctl.machine.records.replay import grown_in
from printctl.machine.records.states import LinkState, Status
from sim.gcode.motion.executed import ExecutedMotion

_REPORT: Final = b"M155 S2"
_NO_REPORT: Final = "M155 S0"


@dataclass(frozen=True)
class _Print:
    """A print that goes on here."""

    order: Order
    job: Job
    at: Place | None
    declared: Place | None
    record: Path


@dataclass(frozen=True)
class PrintSession:
    """Prints, and has the station stand by again.

    Attributes
    ----------
    port : StationPort
    known : Knowledge
    report : StationReport
    requests : StationRequests
    speaker : LinkOwner
    connection : PrinterConnection
    leave : callable
        Closes the station when the system shuts down.
    """

    port: StationPort
    known: Knowledge
    report: StationReport
    requests: StationRequests
    speaker: LinkOwner
    connection: PrinterConnection
    leave: Callable[[], None]

    def print(self, request: Request) -> None:
        """Print, and stand by again where the printer still knows its place.

        Raises
        ------
        LinkError
            When it may not begin; the station stands by as before.
        """
        order = read_order(request.values, self.port.socket)
        order = replace(order, care=replace(order.care, used_mm=self.known.plunger_mm or 0.0))
        job = load_job(order.job, self.known.printer)
        standby = self.speaker.standby
        at = standby.position if standby else None
        check_homing(job, self.known.mounted.needle)
        declared = check_start(job, at, self.known.trusted)
        here = _Print(order, job, at, declared, record_for(order.folder))
        order.folder.mkdir(parents=True, exist_ok=True)
        self.report.write_down(
            "asked", do="print", values={"job": str(order.job), "sha256": job.sha256}
        )
        self.speaker.switch()
        try:
            self.report.tell(
                StationState.PRINTING, f"printing {job.name}", print_folder=str(order.folder)
            )
            status, begun = self._serve(here, request)
        finally:
            self.speaker.end_print()
        if begun:
            self._learn(here, status)
        else:
            kind = BY_NAME.get(status.error, LinkError)
            self.requests.answer(request, refusal(kind(status.message)))
        self._after(here, status)

    def _serve(self, here: _Print, request: Request) -> tuple[Status, bool]:
        """Run the print in its own folder, on the open port; whether it got so far as to begin."""
        begun = False

        def on_start(streamer: Streamer) -> None:
            nonlocal begun
            begun = True
            self._begin(here, request, streamer)

        try:
            return serve(here.order, self._wire(here, on_start)), begun
        except LinkError as exc:
            return Status(LinkState.FAILED, message=str(exc), error=type(exc).__name__), begun
        finally:
            signal.signal(signal.SIGTERM, lambda *_: self.leave())

    def _begin(self, here: _Print, request: Request, streamer: Streamer) -> None:
        """Hand the port over to the print."""
        self.speaker.begin_print(streamer)
        signal.signal(signal.SIGTERM, lambda *_: self.leave())
        if self.connection.reports:
            streamer.command(_REPORT, lambda lines: None)
        self.report.tell(StationState.PRINTING, f"printing {here.job.name}")
        self.requests.grant(request, {})

    def _wire(self, here: _Print, on_start: Callable[[Streamer], None]) -> Wire:
        port, fresh = self.port, self.port.socket.simulated
        if fresh:
            at = here.declared or here.at or port.start
            port.open_for(here.order.job, here.record, here.order.folder / JOURNAL, at)
        return Wire(
            port.opened(),
            on_start,
            lambda _: self.report.publish(),
            fresh,
            lambda: self.known.limits,
        )

    # --- after it --------------------------------------------------------------------------------

    def _learn(self, here: _Print, status: Status) -> None:
        """Take notice of what a print did to place, plunger and dish."""
        known, job = self.known, grown_in(here.order.folder, here.job)
        if here.declared is not None:
            known.count_anew(here.at or here.declared, here.declared, {"x", "y", "z"})
        if not status.position_known or not leaves_motors_on(job, status.lines_done, known.printer):
            known.lose_position()
        pushed = pushed_mm(job, here.order.folder, status.lines_done, known.plunger_mm)
        known.plunger_mm = pushed.plunger_mm
        if pushed.wrote and known.mounted.dish:
            known.part_in_dish = True

    def _after(self, here: _Print, status: Status) -> None:
        """Stand by again, or say why not."""
        ended = f"print {status.state.value}: {status.message}"
        if self.port.socket.simulated:
            self.port.close()
            self._remember_executed(here, status)
        if status.state is LinkState.KILLED:
            self.connection.down(StationState.HALTED, ended, status.error)
        elif status.error == PortLost.__name__:
            self.connection.down(StationState.LOST, ended, status.error)
        elif not status.position_known:
            self.connection.down(StationState.HALTED, ended, status.error)
        else:
            self._again(ended)

    def _again(self, ended: str) -> None:
        if not self.port.socket.simulated:
            self.connection.stand_by(fresh=False)
            if self.connection.reports and self.speaker.standby is not None:
                self.speaker.standby.do(_NO_REPORT)
            self.report.tell(StationState.READY, ended)
            return
        try:
            self.connection.connect(ended, trusted=self.known.trusted)
        except LinkError as exc:
            self.connection.down(StationState.LOST, f"{ended}; {exc}", type(exc).__name__)

    def _remember_executed(self, here: _Print, status: Status) -> None:
        """Where a simulated tip stands now; and that the record is whole, where it is."""
        with contextlib.suppress(OSError, ValueError, KeyError, IndexError):
            motion = ExecutedMotion.load(here.record)
            x, y, z = motion.end[-1].tolist()
            self.port.stands_at((x, y, z))
            if status.state is LinkState.DONE:
                write_note(here.record, here.job.sha256, self.known.printer, len(motion))
