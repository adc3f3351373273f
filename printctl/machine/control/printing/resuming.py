"""Resume a print whose host died, from the printer's last accepted line."""

from __future__ import annotations

from dataclasses import replace

from printctl.machine.control.board.steps import Steps
from printctl.machine.control.excursion import Excursion
from printctl.machine.control.printing.context import Print
from printctl.machine.control.printing.looking import Park, is_parked, lead_needle, restore_looks
from printctl.machine.control.printing.others import set_anew
from printctl.machine.control.printing.pausing import lower, shut_valve, wait_and_come_back
from printctl.machine.control.printing.syringes import find_change_again, take_head
from printctl.machine.families import link_facts
from printctl.machine.job.coordinates import Modal
from printctl.machine.job.dispensing import is_open
from printctl.machine.job.marks import MarkKind
from printctl.machine.records.replay import JournalledPrint
from printctl.machine.records.states import LinkState, PrintEnded


def find_again(run: Print, history: JournalledPrint) -> Steps[None]:
    """Ask the printer for its last line; come back to where the job was, if all agrees.

    Ends the print where the printer can't tell, or its line or position isn't the job's.
    """
    logbook, progress, watch = run.logbook, run.progress, run.watch
    logbook.enter(LinkState.CHECKING, "querying the printer's last line")
    done, number = yield from _last_line(run, history)
    restore_looks(run, history, done)
    run.wiring.protocol.load(progress.job.lines, done, number)
    yield from shut_valve(run)
    if is_open(progress.job.lines, done, run.printer):
        logbook.alarm(
            f"the valve was open after line {done} while no host was connected; inspect the part"
        )
    yield from run.firmware.check_keepalive(journalled=True)
    logbook.enter(LinkState.CHECKING, "waiting until the printer has executed its queued moves")
    yield from run.channel.command(b"M400")
    run.firmware.restore_settings(history.settings)
    if history.heat:
        run.heat.restore(history.heat["targets"], history.heat["line"])
    yield from set_anew(run)
    if history.frame:
        run.position.frame.restore(**history.frame)
        yield from run.position.refuse_renamed(waited=True)
    at = yield from run.position.expected(history.left)
    if history.reload_at is not None:
        watch.reload_at, watch.reload_heads = history.reload_at, history.reload_heads
    run.change.filled.update(history.filled)
    changing = history.changing(number)
    if changing or history.reloaded == done:
        watch.paused(done)
    if history.wanted is not None:  # requested from the process that died
        run.change.wanted_head = history.wanted.get("head")
        watch.after = MarkKind(history.wanted["after"])
    if changing or done == len(progress.job):
        _confirm_count(run, done)
    if changing:
        xy = replace(at, z=None, e=None)
        run.channel.led = {axis.upper(): [mm] for axis, mm in xy.place().items()}
        head = None if history.reload is None else history.reload.get("head")
        run.excursion = Excursion(True, at, counted=False)
        yield from find_change_again(run, at, head)
        words = run.change.words(run.printer)
        yield from wait_and_come_back(run, at, f"paused, found again: {words}")
    elif done < len(progress.job):
        yield from _rejoin(run, at, history.park, done)
        if history.in_ink:
            progress.stood_without_host(run.wiring.wall_s() - history.written_s)
    # else it died behind the last line, when settings may be as before the job: no move is left


def _last_line(run: Print, history: JournalledPrint) -> Steps[tuple[int, int]]:
    """Return the printer's last line, as a line of the job and by its number."""
    if not link_facts(run.printer).remembers:
        raise PrintEnded(
            LinkState.POSITION_UNKNOWN,
            f"{run.printer.firmware} can't report its last accepted line; at least {history.done} "
            "job lines were accepted; `printctl status` lists the next steps",
            known=False,
        )
    number = yield from run.channel.agree(run.wiring.protocol.ask)
    done = history.job_line(number)
    reset = run.channel.heard.booted or (number == 0 and history.done > 0)
    if reset or not history.done <= done <= len(run.job):
        raise PrintEnded(
            LinkState.POSITION_UNKNOWN,
            f"the printer's last line is {number}, but the journal has {history.done} job lines: "
            "it was reset or used by another program since; `printctl status` lists the next steps",
            known=False,
        )
    return done, number


def _confirm_count(run: Print, done: int) -> None:
    """Take the printer's own count for the print's."""
    run.progress.journalled = None
    run.logbook.record("ack", done=done)


def _rejoin(run: Print, at: Modal, park: Park | None, done: int) -> Steps[None]:
    run.excursion = Excursion(True, at, run.progress.relieved_mm)
    run.logbook.enter(LinkState.RESUMING, "returning to the print position")
    yield from take_head(run)
    if park is not None and (yield from is_parked(run, at, park)):
        yield from lead_needle(run, at, park, back=True)
    # a pause may have lifted and relieved
    xy = replace(at, z=None, e=None)
    yield from run.position.verify(xy)
    run.channel.led = {axis.upper(): [mm] for axis, mm in xy.place().items()}
    _confirm_count(run, done)
    yield from lower(run, at)
