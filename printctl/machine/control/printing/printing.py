"""Main loop of a print: handshake, stream job lines, serve requests, await the last moves."""

from __future__ import annotations

import contextlib
from functools import partial
from typing import Final

from printctl.machine.control.board.connecting import RestWait, agree_start, connect
from printctl.machine.control.board.gauges import next_due, read_high
from printctl.machine.control.board.steps import Steps, Wait
from printctl.machine.control.interruption import StopRequested
from printctl.machine.control.printing.context import Print
from printctl.machine.control.printing.ending import end_on_fault, retreat
from printctl.machine.control.printing.factors import notice_changes
from printctl.machine.control.printing.looking import do_what_is_due
from printctl.machine.control.printing.others import (
    begin_polling,
    compare_clients,
    poll_clients,
    take_back,
)
from printctl.machine.control.printing.pausing import (
    compare_away,
    hold_for_room,
    pause,
    reopen_valve,
    send_manual,
    want_pause,
)
from printctl.machine.control.printing.resuming import find_again
from printctl.machine.control.requests import Request, ResumeRequest
from printctl.machine.errors import HandshakeError, LinkError, PrintChanged
from printctl.machine.families import link_facts
from printctl.machine.job.coordinates import declared_start
from printctl.machine.job.marks import MarkKind
from printctl.machine.records.replay import JournalledPrint
from printctl.machine.records.states import LinkState, PrintEnded

COUNT_ANSWERS_S: Final = 5.0
"""Interval of counts of answers: each costs a line and its answer, while the planner goes on."""
NOT_PAUSED: Final = "the print isn't paused and no pause is pending: nothing was done"


def run_print(run: Print, history: JournalledPrint | None) -> Steps[None]:
    """Print, from handshake to end; with a history go on from the printer's last line.

    Raises `PrintEnded` always, but for a `LinkError`.
    """
    try:
        yield from _begin(run, history)
        while (compared := (yield from _end_compared(run))) is None:
            yield from _stream(run)
            yield from _obey(run)
            yield from do_what_is_due(run)
    except StopRequested:
        words = f"cancelled by {run.queue.stopped_by}{run.excursion.words()}"
        yield from retreat(run, LinkState.STOPPED, words)
    others = run.progress.foreign_words()
    look = f"; {others}: inspect the part" if others else ""
    changes = "".join(f"; {one}" for one in run.changes)
    message = f"all {len(run.job)} lines done{compared}{look}{changes}{run.logbook.remarks}"
    error = PrintChanged.__name__ if run.changes else ""
    raise PrintEnded(LinkState.DONE, message, known=not others, error=error)


def _begin(run: Print, history: JournalledPrint | None) -> Steps[None]:
    """Contact the printer; leave it where the job's next line may go out."""
    logbook = run.logbook
    run.channel.compare_place = partial(compare_away, run)
    if history is not None:
        logbook.go_on(history)
        run.channel.kill.learn(history.capabilities)
    logbook.enter(LinkState.CONNECTING, f"opening {run.wiring.transport.name}")
    if history is None:
        yield from _start(run)
    else:
        yield from find_again(run, history)
    now = run.channel.now
    run.watch.begin(now)
    run.answers_due, run.answers_troubles = now + COUNT_ANSWERS_S, run.channel.troubles
    begin_polling(run, now)
    run.begin_pace()
    logbook.enter(LinkState.PRINTING, f"printing {run.job.name}")
    yield from reopen_valve(run)
    if history is not None:
        yield from do_what_is_due(run)  # it died before it held the print here


def _start(run: Print) -> Steps[None]:
    """Check and set up the printer before the job's first line."""
    channel, logbook, protocol = run.channel, run.logbook, run.wiring.protocol
    rest = RestWait(channel)
    yield from connect(channel, rest.step)
    logbook.enter(LinkState.CHECKING, "identifying the firmware")
    yield from run.firmware.check_keepalive(journalled=False)  # a machine that moves then says so
    yield from rest.wait()
    yield from run.firmware.check(run.gauges)
    yield from run.heat.begin()
    declared = None
    with contextlib.suppress(LinkError):  # only a part of the place is declared: ask the printer
        declared = declared_start(run.job)
    # a tip that stands elsewhere than preflight, or the job, takes it to stand
    yield from agree_start(channel, rest.moved, declared, run.watch.care.start_mm)
    yield from run.position.frame.begin()
    # Marlin cuts the motors' power two minutes into a dwell, or a wait for heat, of the job itself.
    # No firmware tells the time that was in force, so that it isn't set back: they stay powered
    if link_facts(run.printer).m84_sets_timeout:
        yield from channel.command(b"M84 S0", journalled=False)
    number = yield from channel.agree(protocol.renumber)
    if fault := logbook.fault or run.wiring.exchange.journal_fault:
        raise HandshakeError(f"{fault}; no line of the job was sent")
    protocol.load(run.job.lines, 0, number)


def _stream(run: Print) -> Steps[None]:
    """Send lines until the job is at a mark or its end, or anything is requested.

    This loop is the hot path of the link: one write, one poll and one read a line.
    """
    protocol, channel, exchange = run.wiring.protocol, run.channel, run.wiring.exchange
    take, send, wait = protocol.take_output, exchange.effects.append, Wait(0.0)
    feed, progress, logbook = protocol.feed, run.progress, run.logbook
    requests, commands = run.queue.requests, run.queue.commands
    killed, heard = channel.kill.asked.is_set, channel.heard
    yield from _check_gauges(run, exchange.now_s)
    yield from _count_answers(run, exchange.now_s)
    yield from poll_clients(run, exchange.now_s)
    yield from end_on_fault(run)
    if progress.foreign and progress.unverified:
        # before a slip is looked for: that waits for moves that lead astray
        yield from _verify(run)
    if run.slips.due:
        yield from run.slips.look()
    now = exchange.now_s
    limit = protocol.limit = _next_stop(run, now)
    taken = protocol.lines_done
    progress.caught_up(now)
    yield from _go_on_verified(run)
    while protocol.lines_done < limit and not requests and not commands:
        output = take()
        if output:
            send(output)
        wait.until_s = protocol.deadline
        now, data = yield wait
        if data:
            heard.heard_s = now
            events = feed(data, now)
            if events:
                channel.handle(events)
            if protocol.lines_done != taken:
                taken = protocol.lines_done
                progress.answered(taken, now)
        if now >= protocol.deadline:
            channel.handle(protocol.tick(now))
        if now >= logbook.next_note:
            logbook.note(now)
            channel.look_around()
            limit = protocol.limit = min(limit, _next_stop(run, now))
        if logbook.fault:
            yield from end_on_fault(run)
        if exchange.journal_fault:
            hold_for_room(run)
        if progress.unverified:
            yield from _go_on_verified(run)
        if killed():
            yield from channel.await_halt()


def _next_stop(run: Print, now: float) -> int:
    """Return the command lines after which to look at what is due."""
    done = run.progress.done
    limit = run.watch.next_stop(now, done, run.wiring.protocol.idle, len(run.job))
    due_s = min(next_due(run.gauges), run.answers_due, run.clients_due)
    if run.slips.due or now >= due_s:
        return done
    return run.slips.next_stop(limit)


def _go_on_verified(run: Print) -> Steps[None]:
    """Let the next line go; compare the place before, where there is doubt of it.

    Once: where answers come late, one of the comparison's own may make a new doubt each time.
    """
    if run.progress.unverified:
        yield from _verify(run)
    run.wiring.protocol.held = False
    run.wiring.protocol.go(run.channel.now)


def _verify(run: Print) -> Steps[None]:
    """Compare positions between two lines; take back what another program has set."""
    yield from run.position.verify_in_passing()
    yield from take_back(run)


def _check_gauges(run: Print, now: float) -> Steps[None]:
    """Read the gauges that are due; end the print where a reading is above its limit."""
    if now < next_due(run.gauges):
        return
    yield from run.channel.settle()
    high = yield from read_high(run.channel, run.gauges, now)
    if high and not run.logbook.fault:
        run.logbook.alarm(high)
        yield from retreat(run, LinkState.FAILED, high)


def _count_answers(run: Print, now: float) -> Steps[None]:
    """Notice lines that another program wrote to the printer, where a count is due.

    Such a line is answered by an ok that is taken for the next line's, and so on: from then on each
    ok is one line early. What the protocol asks to `confirm` shows it: one ok more comes before.
    """
    if now < run.answers_due:
        return
    troubles, run.answers_troubles = run.answers_troubles, run.channel.troubles
    if troubles != run.answers_troubles:  # answers that were late may come yet
        run.answers_due = now + 2.0 * COUNT_ANSWERS_S
        return
    yield from run.channel.settle()
    yield from run.channel.agree(run.wiring.protocol.confirm)
    run.answers_due = run.channel.now + COUNT_ANSWERS_S


def _obey(run: Print) -> Steps[None]:
    """Do what is requested, with no line in flight."""
    yield from run.channel.settle()
    if run.progress.foreign and run.progress.unverified:
        yield from _verify(run)  # before a pause: that waits for moves that lead astray
    yield from send_manual(run)
    while (request := run.queue.take()) is not None:
        if request is Request.STOP:
            raise StopRequested
        if request is Request.PAUSE:
            yield from pause(run, run.queue.pause_words)
        elif isinstance(request, ResumeRequest):
            waited = run.watch.after is not None
            want_pause(run, None)  # a pause that is waited for no longer
            run.channel.tell(request.answer, "" if waited else NOT_PAUSED)
        elif request is Request.RELOAD:  # requested in a pause that is over
            want_pause(run, MarkKind.RELOAD)


def _end_compared(run: Print) -> Steps[str | None]:
    """Return words on how the end was compared once every move is made; None to go on."""
    channel, protocol = run.channel, run.wiring.protocol
    if run.progress.done < len(run.job):
        return None
    yield from channel.settle()
    run.progress.caught_up(run.channel.now)
    yield from channel.command(b"M400")
    yield from end_on_fault(run)  # of the last moves, or M400 was refused
    compared = yield from run.position.verify_end()
    yield from compare_clients(run)
    yield from notice_changes(run)
    yield from run.heat.take_back()
    number = protocol.number
    confirmed = (yield from channel.agree(protocol.ask)) == number
    yield from end_on_fault(run)
    # a stop while the last moves were made: the way out needs the job's settings
    yield from _obey(run)
    if not confirmed:
        return None
    run.interruption.disarm()  # it is done, and nothing moves any more
    yield from run.firmware.undo_settings()
    run.logbook.excuse()  # a setting that isn't taken back spoils no part
    yield from end_on_fault(run)
    return compared
