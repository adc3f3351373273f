"""End a print in a controlled way: plunger relieved, needle up, heaters off, settings restored."""

from __future__ import annotations

import re
from dataclasses import asdict
from typing import Final, NoReturn

from printctl.machine.control.channel import Channel
from printctl.machine.control.excursion import Excursion
from printctl.machine.control.firmware_check import FirmwareCheck
from printctl.machine.control.head_choice import HeadChoice
from printctl.machine.control.interruption import Interruption
from printctl.machine.control.position_check import PositionCheck, Standstill
from printctl.machine.control.valve_switch import ValveSwitch
from printctl.machine.families import link_facts
from printctl.machine.job.coordinates import Modal
from printctl.machine.job.dispensing import shut
from printctl.machine.job.retreat import count_from, heaters_off
from printctl.machine.job.stop_place import StopPlace
from printctl.machine.records.states import LinkState, PrintEnded

_OTHERS: Final = (
    "another program's command was refused; see that nothing else drives this printer, and look at "
    "the part"
)
_BED_OFF: Final = b"M140 S0"
_NOZZLE: Final = re.compile(rb"\bT0?: ?\d")
_BED: Final = re.compile(rb"\bB\d*: ?-?\d")
_OWN: Final = "the fault is the printer's own; look at the part"


class Ending:
    """Ends a print whose printer still answers.

    Parameters
    ----------
    channel : Channel
    firmware : FirmwareCheck
    heads : HeadChoice
    position : PositionCheck
    valve : ValveSwitch
    excursion : Excursion
    interruption : Interruption
    """

    def __init__(
        self,
        channel: Channel,
        firmware: FirmwareCheck,
        heads: HeadChoice,
        position: PositionCheck,
        valve: ValveSwitch,
        excursion: Excursion,
        interruption: Interruption,
    ) -> None:
        self._excursion, self._interruption = excursion, interruption
        self._channel, self._firmware, self._heads = channel, firmware, heads
        self._position, self._valve = position, valve
        self._logbook, self._printer = channel.logbook, channel.wiring.printer

    def stop(self) -> NoReturn:
        """End the print as somebody asked, wherever the link has the needle.

        Raises
        ------
        PrintEnded
            Always: stopped.
        """
        who = self._interruption.stopped_by
        self.retreat(LinkState.STOPPED, f"stopped by {who}{self._excursion.words()}")

    def retreat(self, state: LinkState, message: str) -> NoReturn:
        """Relieve the plunger, lift the needle, switch off; nothing may be in flight.

        Raises
        ------
        PrintEnded
            Always, in ``state``.
        """
        facts = link_facts(self._printer)
        self._interruption.disarm()
        self._channel.commands(shut(self._printer))
        self._logbook.enter(LinkState.STOPPING, message)
        self._logbook.take_fault()
        complaints = self._logbook.complaints
        refused = self._logbook.progress.refused
        stop = self._stop_motors()
        self._logbook.progress.leaves()
        carried_out = self._logbook.progress.refused != refused
        if carried_out:
            whose = _OTHERS if self._logbook.progress.about_command else _OWN
            message += f", but the line was carried out: {whose}"
        message += stop.words()
        self._valve.shut()
        if facts.place_question or self._logbook.progress.meddled:
            self._firmware.set_modes(journalled=True)  # others may have left them otherwise
        way = self._way_out(stop)
        self._channel.commands(way)
        complaints += self._heaters_off()
        self._channel.command(b"M400")
        # one that has complained may ignore moves and say ok to them
        missed = self._position.missed_height(way) if self._logbook.complaints else ""
        known = stop.read and self._logbook.complaints == complaints and not missed
        if known and (state is LinkState.STOPPED or self._logbook.disk_full or carried_out):
            self._record_stood(stop)
        self._firmware.undo_settings()
        fault = self._logbook.fault
        if fault:
            message += f"; the way out wasn't made as meant: {fault}"
        if missed:
            message += f"; the needle wasn't lifted as told: {missed}"
        if not known:
            message += "; where the needle is isn't known: look before anything moves"
        raise PrintEnded(state, message, known)

    def _stop_motors(self) -> Standstill:
        """Have the firmware drop the moves that it holds, where it can."""
        quickstop = link_facts(self._printer).quickstop
        if self._excursion.going_on:
            if quickstop:
                self._channel.command(quickstop)
            return self._position.standing_away()
        if not quickstop:
            return Standstill(self._position.actual(), read=True, dropped=False)
        progress = self._logbook.progress
        if progress.all_made() and self._position.made():
            progress.stands_still()
            return self._position.standstill()
        progress.moves_dropped()
        self._channel.command(quickstop)
        return self._position.standstill()

    def _record_stood(self, stop: Standstill) -> None:
        """Write down with which line of the job it can be gone on, and from where."""
        progress = self._logbook.progress
        all_made = self._excursion.going_on or stop.place == Modal()
        stop_place = (
            StopPlace(progress.done, None, True) if all_made else progress.stood(stop.place)
        )
        progress.stopped_at(stop_place)
        self._logbook.record(
            "stood",
            done=progress.done,
            line=stop_place.line,
            begin_at=None if stop_place.at is None else asdict(stop_place.at),
            certain=stop_place.certain,
            dropped=stop.dropped,
            place=asdict(stop.place),
        )

    def _way_out(self, stop: Standstill) -> list[bytes]:
        """Commands that relieve the plunger and lift the needle from there.

        M114 rounds E, so it is counted from what was read. What the job had drawn back already is
        known only where none of its moves was dropped.
        """
        at, printer = stop.at, self._printer
        retreat = self._heads.retreat
        if self._excursion.going_on:
            return self._excursion.way_out(at, retreat, printer)
        if not stop.dropped:
            return retreat.leave(at, printer, self._logbook.progress.relieved_mm)
        counted = [] if at.e is None or printer.pneumatic else [count_from(at.e)]
        return [*counted, *retreat.leave(at, printer)]

    def end_on_fault(self) -> None:
        """End the print where printer or journal complained of something."""
        if self._logbook.fault:
            self._channel.settle()
            self.retreat(LinkState.FAILED, self._logbook.fault)

    def _heaters_off(self) -> int:
        """Switch heaters off; return how many refusals came of heaters that it doesn't have."""
        before, count = self._logbook.fault, self._logbook.complaints
        off = heaters_off(self._printer)
        if _BED_OFF in off:
            told = b" ".join(self._channel.command(b"M105"))
            if _NOZZLE.search(told) and not _BED.search(told):
                off.remove(_BED_OFF)  # it would be refused
        self._channel.commands(off)
        if not self._logbook.excuse(before) or self._logbook.fault:
            return 0
        return self._logbook.complaints - count
