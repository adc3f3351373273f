"""End a print in a controlled way: plunger relieved, needle up, heaters off, settings restored."""

from __future__ import annotations

import contextlib
import re
from dataclasses import asdict
from typing import Final, NoReturn

from printctl.machine.control.board.steps import Steps
from printctl.machine.control.position.place import Standstill
from printctl.machine.control.printing.context import Print
from printctl.machine.errors import PortLost
from printctl.machine.families import link_facts
from printctl.machine.job.coordinates import Modal
from printctl.machine.job.dispensing import shut, shut_and_wait
from printctl.machine.job.retreat import count_from, heaters_off
from printctl.machine.job.stop_place import StopPlace
from printctl.machine.records.states import LinkState, PrintEnded

_OTHERS: Final = (
    "another program's command was rejected; check that nothing else controls this printer, and "
    "inspect the part"
)
_BED_OFF: Final = b"M140 S0"
_NOZZLE: Final = re.compile(rb"\bT0?: ?\d")
_BED: Final = re.compile(rb"\bB\d*: ?-?\d")
_OWN: Final = "the printer itself has a fault; inspect the part"


def end_on_fault(run: Print) -> Steps[None]:
    """End the print where the printer complained of something."""
    if run.logbook.fault:
        yield from run.channel.settle()
        yield from retreat(run, LinkState.FAILED, run.logbook.fault)


def retreat(run: Print, state: LinkState, message: str) -> Steps[NoReturn]:
    """Relieve the plunger, lift the needle, switch off; with nothing in flight."""
    channel, logbook, progress = run.channel, run.logbook, run.progress
    run.interruption.disarm()
    yield from channel.commands(shut(run.printer))
    logbook.enter(LinkState.STOPPING, message)
    logbook.take_fault()
    complaints, refused = logbook.complaints, progress.refused
    standstill = yield from _stop_motors(run)
    progress.leaves()
    set_backs = channel.set_backs
    line_made = progress.refused != refused
    if line_made:
        whose = _OTHERS if progress.about_command else _OWN
        message += f", but the line was executed: {whose}"
    message += standstill.words()
    yield from channel.commands(shut_and_wait(run.printer))
    if link_facts(run.printer).place_question or progress.meddled:
        yield from run.firmware.set_modes(journalled=True)  # others may have left them otherwise
    way = _way_out(run, standstill)
    yield from channel.commands(way)
    complaints += yield from _heaters_off(run)
    yield from channel.command(b"M400")
    # one that has complained may ignore moves and say ok to them; one that was reset made none
    doubted = logbook.complaints or channel.set_backs > set_backs
    missed = (yield from run.position.missed_height(way)) if doubted else ""
    known = standstill.read and not standstill.wrong
    known = known and logbook.complaints == complaints and not missed
    if known and (state is LinkState.STOPPED or line_made):
        _record_stood(run, standstill)
    yield from run.firmware.undo_settings()
    fault = logbook.fault
    if fault:
        message += f"; the retreat didn't run as planned: {fault}"
    if missed:
        message += f"; the needle wasn't lifted as commanded: {missed}"
    if not known:
        message += "; the needle position is unknown: check it before anything moves"
    raise PrintEnded(state, message, known)


def _stop_motors(run: Print) -> Steps[Standstill]:
    """Have the firmware drop the moves that it holds, where it can."""
    quickstop, progress = link_facts(run.printer).quickstop, run.progress
    if run.excursion.going_on:
        if quickstop:
            yield from run.channel.command(quickstop)
        return (yield from run.position.standing_away(run.excursion.counted))
    if not quickstop:
        return Standstill((yield from run.position.actual()), read=True, dropped=False)
    if progress.all_made() and (yield from run.position.made()):
        progress.stands_still()
        return (yield from run.position.standstill())
    # a stop has cut in, and each quickstop takes a second, with the needle in the print
    stopped = progress.dropped and (yield from run.position.stopped())
    progress.moves_dropped()
    if not stopped:
        yield from run.channel.command(quickstop)
    return (yield from run.position.standstill())


def _record_stood(run: Print, standstill: Standstill) -> None:
    """Write down with which line of the job it can be gone on, and from where."""
    progress, place = run.progress, standstill.place
    all_made = run.excursion.going_on or place == Modal()
    stop_place = StopPlace(progress.done, None, True) if all_made else progress.stood(place)
    progress.stopped_at(stop_place)
    run.logbook.record(
        "stood",
        done=progress.done,
        line=stop_place.line,
        begin_at=None if stop_place.at is None else asdict(stop_place.at),
        certain=stop_place.certain,
        dropped=standstill.dropped,
        place=asdict(place),
    )


def _way_out(run: Print, standstill: Standstill) -> list[bytes]:
    """Return the commands that relieve the plunger and lift the needle from there."""
    at, printer = standstill.at, run.printer
    if standstill.wrong:
        return []
    if run.excursion.going_on:
        return run.excursion.way_out(at, run.retreat, printer)
    # what the job had drawn back already is known only where none of its moves was dropped
    if not standstill.dropped:
        return run.retreat.leave(at, printer, run.progress.relieved_mm)
    # M114 rounds E, so it is counted from what was read
    counted = [] if at.e is None or printer.pneumatic else [count_from(at.e)]
    return [*counted, *run.retreat.leave(at, printer)]


def _heaters_off(run: Print) -> Steps[int]:
    """Switch heaters off; return how many refusals came of heaters that it doesn't have."""
    logbook = run.logbook
    before, count = logbook.fault, logbook.complaints
    off = heaters_off(run.printer)
    if _BED_OFF in off:
        reply = b" ".join((yield from run.channel.command(b"M105")))
        if _NOZZLE.search(reply) and not _BED.search(reply):
            off.remove(_BED_OFF)  # it would be refused
    yield from run.channel.commands(off)
    if not logbook.excuse(before) or logbook.fault:
        return 0
    return logbook.complaints - count


def shut_valve_past_protocol(run: Print, ended: PrintEnded) -> Steps[None]:
    """Shut the valve where the protocol can't go on but the wire is there.

    Without number and checksum, twice: the last thing that is sent, whatever the printer makes of
    it. A firmware that was killed takes nothing; one that was reset may take it.
    """
    lost = ended.state not in (LinkState.FAILED, LinkState.POSITION_UNKNOWN)
    portless = ended.error == PortLost.__name__
    if lost or ended.known or portless or not run.logbook.begun:
        return
    for command in shut(run.printer):
        run.logbook.notice("the valve is commanded to close, bypassing the protocol")
        with contextlib.suppress(PortLost):
            yield from run.channel.send_at_once(b"\n%b\n%b\n" % (command, command))
