"""Make room for a syringe change in a pause, set the plunger's new count, replan later changes.

Each step is journalled before it is made, so that a host that dies in the middle of it knows
afterwards whether the plunger's count was set anew or not (`History`).
"""

from __future__ import annotations

from printctl.machine.control.channel import Channel
from printctl.machine.control.head_choice import HeadChoice
from printctl.machine.control.position_check import PositionCheck
from printctl.machine.control.syringe_change import SyringeChange
from printctl.machine.control.watch import Watch
from printctl.machine.job.care import NewSyringe
from printctl.machine.job.coordinates import Modal
from printctl.machine.job.job import Job
from printctl.machine.job.retreat import count_from
from printctl.machine.job.syringes import Filling, Plan, grown_plan, plan_reloads


class SyringeChanger:
    """Performs a syringe change.

    Parameters
    ----------
    channel : Channel
    change : SyringeChange
    heads : HeadChoice
    position : PositionCheck
    watch : Watch
    """

    def __init__(
        self,
        channel: Channel,
        change: SyringeChange,
        heads: HeadChoice,
        position: PositionCheck,
        watch: Watch,
    ) -> None:
        self._channel, self._change, self._heads = channel, change, heads
        self._position, self._watch, self._care = position, watch, watch.care
        self._wiring, self._logbook = channel.wiring, channel.logbook
        self._progress = channel.logbook.progress

    def begin(self, at: Modal) -> None:
        """Write down that the plunger's count is about to lose its meaning, and make room."""
        change = self._change
        change.begin()
        head = {} if change.planned_head is None else {"head": change.planned_head}
        self._logbook.record("reload", done=self._progress.done, e=at.e, **head)
        self._channel.commands(self._wiring.retreat.rise(at, self._wiring.printer, self._room_mm))
        self._take_idle_head()

    def found_again(self, at: Modal, head: int | None) -> None:
        """Make room once more: the host died while a syringe was changed.

        The plunger is left alone, since nobody knows what is in front of it.
        """
        self._change.begin()
        self._change.plan(head)
        z, room = self._position.compare(Modal())[1].get("Z"), self._room_mm
        for command in self._wiring.retreat.rise(at, self._wiring.printer, room):
            if z is None or at.z is None or z < at.z + room:
                self._channel.command(command)
        self._take_idle_head()

    def _take_idle_head(self) -> None:
        """Have E move the plunger whose syringe is changed, where that isn't the one in use.

        The needle stands high above the bath behind M400; whoever says at once that a syringe is in
        has places compared that must stand still.
        """
        self._channel.command(b"M400")
        idle = self._change.idle_head
        if idle is not None:
            self._heads.choose(idle)

    @property
    def _room_mm(self) -> float:
        return max(self._wiring.retreat.park_mm, self._wiring.retreat.lift_mm)

    def replan(self, new: NewSyringe) -> None:
        """Plan where a syringe must be changed again, after this one.

        Raises
        ------
        LinkError
            Where the job can't be made so.
        """
        head, watch, done = self._change.head, self._watch, self._progress.done
        capacity = new.capacity_mm or self._last(head).capacity_mm
        if not capacity or self._wiring.printer.pneumatic:  # no plunger tells what is used up
            return
        planned = dict(zip(watch.reload_at, watch.reload_heads, strict=False))
        others = {index: whose for index, whose in planned.items() if whose != head}
        taken = () if head is None else tuple(others)
        job, used = self._progress.job, new.plunger_mm
        own = plan_reloads(job, capacity, used, done, head=head, taken=taken)
        if head is None:
            watch.plan(own, ())
            return
        all_of_them = others | dict.fromkeys(own, head)
        order = sorted(all_of_them)
        watch.plan(tuple(order), tuple(all_of_them[index] for index in order))

    def _last(self, head: int | None) -> Filling:
        """What is in use: what was put in last, else what the print began with."""
        name, capacity = self._care.of_head(head)
        used = self._care.used_mm if head is None else 0.0
        return self._change.filled.get(head, Filling(0, used, capacity, name))

    def replanned(self, grown: Job) -> Plan:
        """Return where a syringe must be changed once the job is ``grown`` by one more insert.

        Raises
        ------
        Refused
            Where the syringe in use doesn't last for it.
        """
        watch, head = self._watch, self._progress.head
        filling = self._last(head)
        if self._wiring.printer.pneumatic is not None:
            filling = Filling()
        plan = watch.reload_at, watch.reload_heads
        return grown_plan(self._progress.job, grown, plan, filling, head)

    def count(self, at: Modal, new: NewSyringe) -> None:
        """Call the new plunger's place what the job goes on from, relieved like the old one.

        A pneumatic head has none to count; its valve is shut once more, so that a host that dies
        now finds by the number of that line that the change was told. Where another head's syringe
        was changed than the one's in use, that one's count is said again: it is the printer's only
        one, and the other head's plunger moved it. The other's own is said by the job's change.
        """
        self._heads.take()
        pneumatic = self._wiring.printer.pneumatic
        if at.e is None and pneumatic is None:
            return
        e = self._heads.retreat.relieved_e(at.e or 0.0, self._progress.relieved_mm)
        command = count_from(e) if pneumatic is None else pneumatic.closes.encode("ascii")
        self._record(command, new)
        self._channel.command(command)
        if pneumatic is None:
            self._position.verify(Modal(e=e))

    def _record(self, command: bytes, new: NewSyringe) -> None:
        head = self._change.head
        last, done = self._last(head), self._progress.done
        capacity, name = new.capacity_mm or last.capacity_mm, new.name or last.name
        self._change.filled[head] = Filling(done, new.plunger_mm, capacity, name)
        self._logbook.record(
            "syringe",
            n=self._wiring.protocol.number + 1,
            command=command.decode(),
            done=done,
            name=name,
            plunger_mm=new.plunger_mm,
            capacity_mm=capacity,
            **({} if head is None else {"head": head}),
            reload_at=self._watch.reload_at,
            reload_heads=self._watch.reload_heads,
        )
