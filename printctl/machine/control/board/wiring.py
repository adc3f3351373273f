"""Data class of what a print or station runs on: transport, protocol, clock, journal, profile."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from firmware_profiles import Printer
from firmware_profiles.families.link_protocol import LinkProtocol
from printctl.checks.gate import Bounds, Phase, PrinterSituation
from printctl.machine.control.board.steps import Exchange
from printctl.machine.job.retreat import Retreat
from printctl.machine.ports.clock import Clock
from printctl.machine.ports.transport import Transport
from printctl.machine.records.journal import Journal
from printctl.machine.records.states import Status


@dataclass(frozen=True)
class Wiring:
    """What a print, or a station between prints, is given."""

    transport: Transport
    protocol: LinkProtocol
    clock: Clock
    journal: Journal
    printer: Printer
    retreat: Retreat = field(default_factory=Retreat)
    exchange: Exchange = field(default_factory=Exchange)  # between steps and their shell
    fresh: bool = True  # the port has just been opened, so that the board may be starting
    # given every change of state, and progress every `NOTE_S`, in the streamer's thread
    on_status: Callable[[Status], None] = lambda status: None
    wall_s: Callable[[], float] = time.time  # s since 1970
    # what a station knows of the room around the tip, and of heat
    room: Callable[[], PrinterSituation] | None = None

    def printing_limits(self) -> PrinterSituation:
        """Return `limits` for the time in which the job's lines go out, or a look is made."""
        return replace(self.limits(), phase=Phase.PRINTING)

    def limits(self) -> PrinterSituation:
        """Return what the gate judges by: a station's knowledge, or the profile alone."""
        return self.room() if self.room is not None else PrinterSituation(Bounds(self.printer))
