"""Main loop of a print: handshake, stream job lines, serve requests, await the last moves."""

from __future__ import annotations

import contextlib
from typing import Final

from printctl.machine.control.channel import POLL_S
from printctl.machine.control.connecting import RestWait, agree_start, connect
from printctl.machine.control.context import Print
from printctl.machine.control.ending import end_on_fault, retreat
from printctl.machine.control.gauges import next_due, read_high
from printctl.machine.control.interruption import StopRequested
from printctl.machine.control.looking import do_what_is_due
from printctl.machine.control.others import begin_polling, compare_clients, poll_clients, take_back
from printctl.machine.control.pausing import pause, reopen_valve, send_manual, want_pause
from printctl.machine.control.requests import Request, ResumeRequest
from printctl.machine.control.resuming import find_again
from printctl.machine.errors import HandshakeError, LinkError
from printctl.machine.families import link_facts
from printctl.machine.job.coordinates import declared_start
from printctl.machine.job.marks import MarkKind
from printctl.machine.records.replay import JournalledPrint
from printctl.machine.records.states import LinkState, PrintEnded

COUNT_ANSWERS_S: Final = 5.0
"""Interval of counts of answers: each costs a line and its answer, while the planner goes on."""


def run_print(run: Print, history: JournalledPrint | None) -> None:
    """Print, from handshake to end; with a history go on from the printer's last line.

    Raises `PrintEnded` always, but for a `LinkError`.
    """
    try:
        _begin(run, history)
        while (compared := _end_compared(run)) is None:
            _stream(run)
            _obey(run)
            do_what_is_due(run)
    except StopRequested:
        words = f"stopped by {run.queue.stopped_by}{run.excursion.words()}"
        retreat(run, LinkState.STOPPED, words)
    others = run.progress.foreign_words()
    look = f"; {others}: look at the part" if others else ""
    message = f"all {len(run.job)} lines done{compared}{look}{run.logbook.remarks}"
    raise PrintEnded(LinkState.DONE, message, known=not others)


def _begin(run: Print, history: JournalledPrint | None) -> None:
    """Contact the printer; leave it where the job's next line may go out."""
    logbook = run.logbook
    if history is not None:
        logbook.go_on(history)
    logbook.enter(LinkState.CONNECTING, f"opening {run.wiring.transport.name}")
    if history is None:
        _start(run)
    else:
        find_again(run, history)
    now = run.wiring.clock.now
    run.watch.begin(now())
    run.answers_due, run.answers_troubles = now() + COUNT_ANSWERS_S, run.channel.troubles
    begin_polling(run, now())
    logbook.enter(LinkState.PRINTING, f"printing {run.job.name}")
    reopen_valve(run)
    if history is not None:
        do_what_is_due(run)  # it died before it held the print here


def _start(run: Print) -> None:
    """Check and set up the printer before the job's first line."""
    channel, logbook, protocol = run.channel, run.logbook, run.wiring.protocol
    rest = RestWait(channel)
    connect(channel, rest.step)
    logbook.enter(LinkState.CHECKING, "asking the firmware what it is")
    rest.wait()
    run.firmware.check(run.gauges)
    declared = None
    with contextlib.suppress(LinkError):  # only a part of the place is declared: ask the printer
        declared = declared_start(run.job)
    # a tip that stands elsewhere than preflight, or the job, takes it to stand
    agree_start(channel, rest.moved, declared, run.watch.care.start_mm)
    run.heat.begin()
    run.position.frame.begin()
    # Marlin cuts the motors' power two minutes into a dwell, or a wait for heat, of the job itself.
    # No firmware tells the time that was in force, so that it isn't set back: they stay powered
    if link_facts(run.printer).m84_sets_timeout:
        channel.command(b"M84 S0", journalled=False)
    number = channel.agree(protocol.renumber)
    if logbook.fault and not logbook.disk_full:
        raise HandshakeError(f"{logbook.fault}; no line of the job was sent")
    protocol.load(run.job.lines, 0, number)


def _stream(run: Print) -> None:
    """Send lines until the job is at a mark or its end, or anything is requested.

    This loop is the hot path of the link: one write, one poll and one read a line.
    """
    protocol, transport, channel = run.wiring.protocol, run.wiring.transport, run.channel
    now_s, read, take = run.wiring.clock.now, transport.read, protocol.take_output
    feed, progress, logbook = protocol.feed, run.progress, run.logbook
    requests, commands = run.queue.requests, run.queue.commands
    killed, heard = channel.kill.asked.is_set, channel.heard
    _check_gauges(run, now_s())
    _count_answers(run, now_s())
    poll_clients(run, now_s())
    end_on_fault(run)
    if progress.foreign and progress.unverified:
        _verify(run)  # before a slip is looked for: that waits for moves that lead astray
    if run.slips.due:
        run.slips.look()
    now = now_s()
    limit = protocol.limit = _next_stop(run, now)
    taken = protocol.lines_done
    progress.caught_up(now)
    if not progress.unverified:
        protocol.held = False
        protocol.go(now)
    while protocol.lines_done < limit and not requests and not commands:
        output = take()
        if output:
            transport.write(output)
        wait = protocol.deadline - now
        data = read(wait if wait < POLL_S else POLL_S)
        now = now_s()
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
            end_on_fault(run)
        if progress.unverified:
            _verify(run)
            protocol.held = False
            protocol.go(now_s())
        if killed():
            channel.await_halt()


def _next_stop(run: Print, now: float) -> int:
    """Return the command lines after which to look at what is due."""
    done = run.progress.done
    limit = run.watch.next_stop(now, done, run.wiring.protocol.idle, len(run.job))
    due_s = min(next_due(run.gauges), run.answers_due, run.clients_due)
    if run.slips.due or now >= due_s:
        return done
    return run.slips.next_stop(limit)


def _verify(run: Print) -> None:
    """Compare positions between two lines; take back what another program has set."""
    run.position.verify_in_passing()
    take_back(run)


def _check_gauges(run: Print, now: float) -> None:
    """Read the gauges that are due; end the print where a reading is above its limit."""
    if now < next_due(run.gauges):
        return
    run.channel.settle()
    high = read_high(run.channel, run.gauges, now)
    if high and not run.logbook.fault:
        run.logbook.alarm(high)
        retreat(run, LinkState.FAILED, high)


def _count_answers(run: Print, now: float) -> None:
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
    run.channel.settle()
    run.channel.agree(run.wiring.protocol.confirm)
    run.answers_due = run.wiring.clock.now() + COUNT_ANSWERS_S


def _obey(run: Print) -> None:
    """Do what is requested, with no line in flight."""
    run.channel.settle()
    if run.progress.foreign and run.progress.unverified:
        _verify(run)  # before a pause: that waits for moves that lead astray
    send_manual(run)
    while (request := run.queue.take()) is not None:
        if request is Request.STOP:
            raise StopRequested
        if request is Request.PAUSE:
            pause(run, run.queue.pause_words)
        elif isinstance(request, ResumeRequest):
            want_pause(run, None)  # a pause that is waited for no longer
            request.answer("")
        elif request is Request.RELOAD:  # requested in a pause that is over
            want_pause(run, MarkKind.RELOAD)


def _end_compared(run: Print) -> str | None:
    """Return words on how the end was compared once every move is made; None to go on."""
    channel, protocol = run.channel, run.wiring.protocol
    if run.progress.done < len(run.job):
        return None
    channel.settle()
    run.progress.caught_up(run.wiring.clock.now())
    channel.command(b"M400")
    end_on_fault(run)  # of the last moves, or M400 was refused
    compared = run.position.verify_end()
    compare_clients(run)
    run.heat.take_back()
    number = protocol.number
    confirmed = channel.agree(protocol.ask) == number
    end_on_fault(run)
    # a stop while the last moves were made: the way out needs the job's settings
    _obey(run)
    if not confirmed:
        return None
    run.interruption.disarm()  # it is done, and nothing moves any more
    run.firmware.undo_settings()
    run.logbook.excuse()  # a setting that isn't taken back spoils no part
    end_on_fault(run)
    return compared
