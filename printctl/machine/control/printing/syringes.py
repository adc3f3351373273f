"""Change a syringe in a pause: make room, choose the head, count the plunger anew, plan further.

Each step is journalled before it is made, so that a host that dies in the middle of it knows
afterwards whether the plunger's count was set anew or not (`JournalledPrint`).
"""

from __future__ import annotations

from printctl.machine.control.board.steps import Steps
from printctl.machine.control.position.firmware import RETRIES
from printctl.machine.control.printing.context import Print
from printctl.machine.job.care import NewSyringe
from printctl.machine.job.coordinates import Modal
from printctl.machine.job.dispensing import choose, confirms, keep_raised, pressures
from printctl.machine.job.job import Job
from printctl.machine.job.retreat import count_from
from printctl.machine.job.syringes import Filling, Plan, grown_plan, plan_reloads
from printctl.machine.records.states import LinkState, PrintEnded


def take_head(run: Print) -> Steps[None]:
    """Choose the job's head and raise the others: another program may have chosen another.

    Pressures that a pause let down are the job's again before its needle goes down.
    """
    number, at = run.progress.head, (run.job.lines, run.progress.done, run.printer)
    yield from run.channel.commands([*keep_raised(*at), *pressures(*at)])
    if number is not None:
        yield from _choose_head(run, number)


def _choose_head(run: Print, number: int) -> Steps[None]:
    """Have the firmware use a head; end the print where it doesn't confirm that."""
    printer = run.printer
    if printer.airs:
        return
    for _ in range(RETRIES):  # an answer may be garbled
        if confirms((yield from run.channel.command(choose(printer, number))), printer, number):
            return
    raise PrintEnded(
        LinkState.POSITION_UNKNOWN,
        f"the firmware doesn't confirm head {number} ({choose(printer, number)!r}): nothing was "
        "moved; check that it was built with that many heads, then `printctl status`",
        known=False,
    )


def begin_change(run: Print, at: Modal) -> Steps[None]:
    """Write down that the plunger's count is about to lose its meaning, and make room."""
    run.excursion.counted = False
    _begin(run, run.change.planned_head)
    head = {} if run.change.planned_head is None else {"head": run.change.planned_head}
    run.logbook.record("reload", done=run.progress.done, e=at.e, **head)
    yield from run.channel.commands(run.wiring.retreat.rise(at, run.printer, _room_mm(run)))
    yield from _take_idle_head(run)


def find_change_again(run: Print, at: Modal, head: int | None) -> Steps[None]:
    """Make room once more: the host died while a syringe was changed.

    The plunger is left alone: what is in front of it is unknown.
    """
    _begin(run, head)
    z, room = (yield from run.position.compare(Modal()))[1].get("Z"), _room_mm(run)
    for command in run.wiring.retreat.rise(at, run.printer, room):
        if z is None or at.z is None or z < at.z + room:
            yield from run.channel.command(command)
    yield from _take_idle_head(run)


def _begin(run: Print, head: int | None) -> None:
    change = run.change
    change.going_on, change.begun, change.planned_head = True, change.begun + 1, head


def _take_idle_head(run: Print) -> Steps[None]:
    """Have E move the plunger whose syringe is changed, where that isn't the one in use."""
    # the needle stands high above the bath behind it; a client that says at once that a syringe is
    # in has places compared that must stand still
    yield from run.channel.command(b"M400")
    if run.change.idle_head is not None:
        yield from _choose_head(run, run.change.idle_head)


def _room_mm(run: Print) -> float:
    return max(run.wiring.retreat.park_mm, run.wiring.retreat.lift_mm)


def replan(run: Print, new: NewSyringe) -> None:
    """Plan where a syringe must be changed after this one; `LinkError` where that can't be."""
    head, watch, done = run.change.head, run.watch, run.progress.done
    capacity = new.capacity_mm or _filling(run, head).capacity_mm
    if not capacity or run.printer.pneumatic:  # no plunger tells what is used up
        return
    planned = dict(zip(watch.reload_at, watch.reload_heads, strict=False))
    others = {index: whose for index, whose in planned.items() if whose != head}
    taken = () if head is None else tuple(others)
    own = plan_reloads(run.job, capacity, new.plunger_mm, done, head=head, taken=taken)
    if head is None:
        watch.reload_at, watch.reload_heads = own, ()
        return
    whose_at = others | dict.fromkeys(own, head)
    watch.reload_at = tuple(sorted(whose_at))
    watch.reload_heads = tuple(whose_at[index] for index in watch.reload_at)


def replanned(run: Print, grown: Job) -> Plan:
    """Plan changes for the job ``grown`` by an insert; `Refused` where the ink doesn't last."""
    head = run.progress.head
    filling = Filling() if run.printer.pneumatic is not None else _filling(run, head)
    plan = run.watch.reload_at, run.watch.reload_heads
    return grown_plan(run.job, grown, plan, filling, head)


def _filling(run: Print, head: int | None) -> Filling:
    """Return what is in use: what was put in last, else what the print began with."""
    care = run.watch.care
    name, capacity = care.of_head(head)
    used = care.used_mm if head is None else 0.0
    return run.change.filled.get(head, Filling(0, used, capacity, name))


def count_plunger(run: Print, at: Modal, new: NewSyringe) -> Steps[None]:
    """Call the new plunger's place what the job goes on from, relieved like the old one.

    A pneumatic head has none to count; its valve is shut once more, so that a host that dies
    now finds by the number of that line that the change was reported. Where another head's syringe
    was changed than the one's in use, that one's count is set again: it is the printer's only
    one, and the other head's plunger moved it. The other's own is set by the job's change.
    """
    yield from take_head(run)
    pneumatic = run.printer.pneumatic
    if at.e is None and pneumatic is None:
        return
    e = run.retreat.relieved_e(at.e or 0.0, run.progress.relieved_mm)
    command = count_from(e) if pneumatic is None else pneumatic.closes.encode("ascii")
    head, done = run.change.head, run.progress.done
    last = _filling(run, head)
    capacity, name = new.capacity_mm or last.capacity_mm, new.name or last.name
    run.change.filled[head] = Filling(done, new.plunger_mm, capacity, name)
    run.logbook.record(
        "syringe",
        n=run.wiring.protocol.number + 1,
        command=command.decode(),
        done=done,
        name=name,
        plunger_mm=new.plunger_mm,
        capacity_mm=capacity,
        **({} if head is None else {"head": head}),
        reload_at=run.watch.reload_at,
        reload_heads=run.watch.reload_heads,
    )
    yield from run.channel.command(command)
    if pneumatic is None:
        yield from run.position.verify(Modal(e=e))
