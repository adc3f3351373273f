"""The change of a syringe in a pause: of the head in use, or of another.

It is journalled before each of its steps, so that a host that dies in the middle of it knows
afterwards whether the plunger's count was set anew or not (`History`).
"""

from __future__ import annotations

from typing import Final

from printctl.link.care import Care, NewSyringe
from printctl.link.channel import Wiring
from printctl.link.checking import Checking
from printctl.link.job import Job
from printctl.link.modal import Modal, relieved_mm
from printctl.link.reloading import plan_reloads
from printctl.link.retreat import count_from
from printctl.link.watch import Watch

CHANGE: Final = (
    "change the syringe and prime it to the needle's tip, then `printctl resume RUN --plunger-mm "
    "USED` (0 for a full one) or `--syringe PROFILE`; `--unchanged` if you didn't"
)


class Changing(Checking):
    """Has a syringe changed; see `Checking` for what it is given.

    Parameters
    ----------
    wiring : Wiring
    job : Job
    care : Care, optional
    """

    def __init__(self, wiring: Wiring, job: Job, care: Care | None = None) -> None:
        super().__init__(wiring, job)
        self.care = care or Care()
        self.watch = Watch(job.marks, self.care)
        self._changing = False
        self._change_head: int | None = None

    def _reloads_with(self, change: NewSyringe) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Where a syringe must be changed again, after this one; of several heads, whose."""
        head, watch, done = self._changed_head, self.watch, self.protocol.lines_done
        capacity = change.capacity_mm or self.care.of_head(head)[1]
        if not capacity or self.wiring.printer.pneumatic:  # no plunger tells what is used up
            return watch.reload_at, watch.reload_heads
        planned = dict(zip(watch.reload_at, watch.reload_heads, strict=False))
        others = {index: whose for index, whose in planned.items() if whose != head}
        taken = () if head is None else tuple(others)
        used = change.plunger_mm
        own = plan_reloads(self.job, capacity, used, done, head=head, taken=taken)
        if head is None:
            return own, ()
        all_of_them = others | dict.fromkeys(own, head)
        order = sorted(all_of_them)
        return tuple(order), tuple(all_of_them[index] for index in order)

    @property
    def _changed_head(self) -> int | None:
        """Whose syringe is changed; None where there is one head."""
        return self._head if self._change_head is None else self._change_head

    def _is_idle(self, head: int | None) -> bool:
        """Whether that is another head than the one in use."""
        return head is not None and self._head is not None and head != self._head

    def _what_to_change(self) -> str:
        number = self._changed_head
        if number is None:
            return CHANGE
        name = self.wiring.printer.heads[number].name
        return f"head {number} ({name}): {CHANGE}"

    def _begin_change(self, at: Modal) -> None:
        """Write down that the plunger's count is about to lose its meaning, and make room."""
        self._changing = True
        head = {} if self._change_head is None else {"head": self._change_head}
        self._record("reload", done=self.protocol.lines_done, e=at.e, **head)
        for command in self.wiring.retreat.rise(at, self.wiring.printer, self._room_mm):
            self._command(command)
        self._take_idle_head()

    def _take_idle_head(self) -> None:
        """Have E move the plunger whose syringe is changed, where that isn't the one in use.

        The needle stands high above the bath by now.
        """
        if self._is_idle(self._change_head) and self._change_head is not None:
            self._command(b"M400")
            self._choose(self._change_head)

    @property
    def _room_mm(self) -> float:
        return max(self.wiring.retreat.park_mm, self.wiring.retreat.lift_mm)

    def _count_new_syringe(self, at: Modal, change: NewSyringe) -> None:
        """Call the new plunger's place what the job goes on from, relieved like the old one.

        A pneumatic head has none to count; its valve is shut once more, so that a host that dies
        now finds by the number of that line that the change was told. Where another head's syringe
        was changed than the one's in use, that one's count is said again: it is the printer's only
        one, and the other head's plunger moved it. The other's own is said by the job's change.
        """
        self._take_head()
        head = self.wiring.printer.pneumatic
        if at.e is None and head is None:
            return
        relieved = relieved_mm(self.job.lines, self.protocol.lines_done)
        e = self._retreat.relieved_e(at.e or 0.0, relieved)
        command = count_from(e) if head is None else head.closes.encode("ascii")
        self._record(
            "syringe",
            n=self.protocol.number + 1,
            command=command.decode(),
            done=self.protocol.lines_done,
            name=change.name or self.care.of_head(self._changed_head)[0],
            plunger_mm=change.plunger_mm,
            reload_at=self.watch.reload_at,
            reload_heads=self.watch.reload_heads,
        )
        self._command(command)
        if head is None:
            self._verify(Modal(e=e))
