"""Answer clients' inserts and decisions in a held print; put inserts, once journalled, into it."""

from __future__ import annotations

from printctl.machine.control.board.steps import Steps, carried_out
from printctl.machine.control.look_book import LookRequest, insert_answer
from printctl.machine.control.printing.context import Print
from printctl.machine.control.printing.syringes import replanned
from printctl.machine.errors import LinkError, Refused
from printctl.machine.job.coordinates import Modal
from printctl.machine.job.dispensing import is_open
from printctl.machine.job.insert_check import InsertPlace, check_factor, check_flow, judged_lines
from printctl.machine.job.job import Insert


def answer_clients(run: Print, at: Modal) -> Steps[LookRequest | None]:
    """Answer what clients request; return a decision of theirs, which is still to be made.

    ``at``: where the print is held, mm.
    """
    while run.queue.looks:
        request = run.queue.looks.popleft()
        try:
            answer = run.book.repeated(request)
            if answer is None and request.decision is not None:
                return request
            answer = answer or (yield from _insert(run, request, at))
            run.channel.tell(request.done, answer)
        except LinkError as exc:
            run.channel.tell(request.refused, str(exc))
    return None


def refuse_rest(run: Print) -> None:
    """Answer what came too late: the print goes on or ends."""
    while run.queue.looks:
        request = run.queue.looks.popleft()
        try:
            answer = run.book.repeated(request)
            if answer:
                run.channel.tell(request.done, answer)
            else:
                run.channel.tell(request.refused, "the print continued")
        except Refused as exc:
            run.channel.tell(request.refused, str(exc))


def _insert(run: Print, request: LookRequest, at: Modal) -> Steps[dict[str, object]]:
    """Judge an insert, write it down, and let the job grow by it.

    Where it isn't taken (`LinkError`) nothing has changed.
    """
    logbook, progress, watch = run.logbook, run.progress, run.watch
    done, name = progress.done, f"the injected G-code of look {request.look}"
    if is_open(progress.job.lines, done, run.printer):
        raise Refused(f"{name} isn't accepted: the job has the valve open there")
    bears = run.wiring.limits().plunger_mm_s
    place = InsertPlace(at, run.reach, run.printer, bears, run.shift_mm())
    lines: tuple[bytes, ...] = ()
    if request.lines or request.flow is None:
        lines = judged_lines(request.lines, place, name)
    if request.flow is not None:
        check_factor(request.flow, place, name)
    flow = progress.job.flow if request.flow is None else request.flow
    again = request.again and bool(lines)
    insert = Insert(request.look, done, lines, request.why, flow, again)
    grown = progress.job.grown(insert)
    if request.flow is not None:
        check_flow(progress.job, grown, place, name)
    plan = replanned(run, grown)
    logbook.refuse_without_room(insert.to_record(), name)
    if fault := logbook.fault or run.wiring.exchange.journal_fault:
        raise Refused(f"{name} isn't accepted: {fault}")
    logbook.record("insert", **insert.to_record(), reload_at=plan[0], reload_heads=plan[1])
    yield from carried_out()
    backlog = run.wiring.exchange.backlog
    for record in [one for one in backlog if one.sort == "insert"]:
        backlog.remove(record)  # nor is it to be found there later
        raise Refused(f"{name} isn't accepted: the journal can't be written")
    progress.grow(grown)
    watch.grow(progress.job.marks, done, len(lines))
    watch.reload_at, watch.reload_heads = plan
    if insert.again:
        watch.insert_end = done + len(lines)
    run.wiring.protocol.grow(progress.job.lines)
    run.book.inserts[insert.look] = insert, request.lines
    return insert_answer(insert)
