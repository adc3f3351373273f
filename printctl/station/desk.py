"""One station: stands by, prints on the port that is open, and stands by again."""

from __future__ import annotations

import contextlib
import signal
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from printctl.link.errors import BY_NAME, LinkError, PortLost
from printctl.link.job import Job, load_job
from printctl.link.process import Order, Wire, serve
from printctl.link.states import LinkState, PrintEnded, Status
from printctl.link.streamer import Streamer
from printctl.printing.executed import record_for, write_note
from printctl.station.attending import Attending
from printctl.station.counter import DOWN, Wish, refusal
from printctl.station.orders import check_homing, check_start, leaves_motors_on, read_wish
from printctl.station.pushed import pushed_mm
from printctl.station.status import Place, StationState
from sim.executed import ExecutedMotion

_REPORT: Final = b"M155 S2"
_NO_REPORT: Final = "M155 S0"


@dataclass(frozen=True)
class _Print:
    """A print that goes on here."""

    order: Order
    job: Job
    declared: Place | None
    record: Path


class Desk(Attending):
    """See `Counter` for what it is given."""

    def run(self) -> None:
        """Serve until closed; the printer has been connected (`connect`)."""
        while not self.closing:
            try:
                if self._status.state in DOWN:
                    self._wait_down()
                else:
                    self._attend()
            except (PrintEnded, PortLost) as exc:
                self._go_down(exc)
        if self._status.state is not StationState.CLOSED:
            self._close(None)

    # --- a print -------------------------------------------------------------------------------

    def _print(self, wish: Wish) -> None:
        """Print, and stand by again where the printer still knows its place."""
        order = read_wish(wish.values, self.socket)
        job = load_job(order.job, self.known.printer)
        standby = self._standby
        at = standby.position if standby else None
        check_homing(job, self.known.mounted.needle)
        declared = check_start(job, at, self.known.trusted)
        here = _Print(order, job, declared, record_for(order.folder))
        order.folder.mkdir(parents=True, exist_ok=True)
        self._write_down("asked", do="print", values={"job": str(order.job), "sha256": job.sha256})
        self._switching = True
        try:
            self._tell(
                StationState.PRINTING, f"printing {job.name}", print_folder=str(order.folder)
            )
            status, begun = self._serve(here, at, wish)
        finally:
            self._streamer, self._switching = None, False
        if begun:
            self._learn(here, status, at)
        else:
            kind = BY_NAME.get(status.error, LinkError)
            self._answer(wish, refusal(kind(status.message)))
        self._after(here, status)

    def _serve(self, here: _Print, at: Place | None, wish: Wish) -> tuple[Status, bool]:
        """Run the print in its own folder, on the open port; whether it got so far as to begin."""
        begun = False

        def on_start(streamer: Streamer) -> None:
            nonlocal begun
            begun, self._streamer, self._switching = True, streamer, False
            if self._standby is not None:
                self._standby.end()
            signal.signal(signal.SIGTERM, lambda *_: self.leave())
            if self._reports:
                streamer.command(_REPORT, lambda lines: None)
            self._tell(StationState.PRINTING, f"printing {here.job.name}")
            self._answer(wish, self._reply("print", {}))

        try:
            transport = self._transport
            if self.socket.simulated:  # a fresh one, which records this print alone
                self._unplug()
                here.record.unlink(missing_ok=True)
                place = here.declared or at or self._start
                transport = self.socket.plug_in(place, here.order.job, here.record)
                self._transport = transport
            if transport is None:
                raise PortLost(f"{self.socket.port} isn't open")
            fresh = self.socket.simulated
            wire = Wire(
                transport,
                on_start,
                lambda _: self.on_change(self.status),
                fresh,
                lambda: self.known.limits,
            )
            return serve(here.order, wire), begun
        except LinkError as exc:
            return Status(LinkState.FAILED, message=str(exc), error=type(exc).__name__), begun
        finally:
            signal.signal(signal.SIGTERM, lambda *_: self.leave())

    @property
    def _reports(self) -> bool:
        """Whether the firmware can tell its temperatures unasked, so that no line waits for it."""
        standby = self._standby
        return standby is not None and standby.firmware.capabilities.get("AUTOREPORT_TEMP", False)

    def leave(self) -> None:
        """Close, because the system shuts down; a print is stopped first."""
        self.closing = True
        if self._streamer is not None:
            self._streamer.stop()

    def _learn(self, here: _Print, status: Status, at: Place | None) -> None:
        """Take notice of what a print did to place, plunger and dish."""
        known, job = self.known, here.job
        axes = {"x", "y", "z"}
        if here.declared is not None:
            known.count_anew(at or here.declared, here.declared, axes)
        if not status.position_known or not leaves_motors_on(job, status.lines_done, known.printer):
            known.lose_position()
        pushed = pushed_mm(job, here.order.folder, status.lines_done, known.plunger_mm)
        known.plunger_mm = pushed.plunger_mm
        if pushed.wrote and known.mounted.dish:
            known.part_in_dish = True

    def _after(self, here: _Print, status: Status) -> None:
        """Stand by again, or say why not."""
        ended = f"print {status.state.value}: {status.message}"
        if self.socket.simulated:
            self._unplug()
            self._remember_executed(here, status)
        if status.state is LinkState.KILLED:
            self.down(StationState.HALTED, ended, status.error)
        elif status.error == PortLost.__name__:
            self.down(StationState.LOST, ended, status.error)
        elif not status.position_known:
            self.down(StationState.HALTED, ended, status.error)
        else:
            self._again(ended)

    def _again(self, ended: str) -> None:
        if not self.socket.simulated:
            self._stand_by(fresh=False)
            if self._reports and self._standby is not None:
                self._standby.do(_NO_REPORT)
            self._tell(StationState.READY, ended)
            return
        try:
            self.connect(ended)
        except LinkError as exc:
            self.down(StationState.LOST, f"{ended}; {exc}", type(exc).__name__)

    def _remember_executed(self, here: _Print, status: Status) -> None:
        """Where a simulated tip stands now; and that the record is whole, where it is."""
        with contextlib.suppress(OSError, ValueError, KeyError, IndexError):
            motion = ExecutedMotion.load(here.record)
            x, y, z = motion.end[-1].tolist()
            self._start = (x, y, z)
            if status.state is LinkState.DONE:
                write_note(here.record, here.job.sha256, self.known.printer, len(motion))

    # --- the end -------------------------------------------------------------------------------

    def _close(self, wish: Wish | None) -> None:
        """Switch the heaters off where the printer answers, and let go of the port."""
        message = "closed"
        if self._status.state not in DOWN and self._standby is not None:
            with contextlib.suppress(LinkError, PrintEnded):
                on = ", ".join(self._standby.let_go())
                message = f"closed; {on} stays on (safe_state_on)" if on else "closed; heaters off"
        self.closing = True
        if self._standby is not None:
            self._standby.end()
        self._unplug()
        self.known.lose_position()
        self._write_down("state", state="closed", message=message)
        self._tell(StationState.CLOSED, message, position_mm=None)
        if wish is not None:
            self._answer(wish, self._reply("close", {}))
