"""Insert a client's G-code lines into a job held for inspection, after journalling them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from printctl.machine.control.channel import Channel
from printctl.machine.control.look_book import LookBook, LookWord, insert_answer
from printctl.machine.control.requests import RequestQueue
from printctl.machine.control.syringe_changer import SyringeChanger
from printctl.machine.control.watch import Watch
from printctl.machine.errors import LinkError, Refused
from printctl.machine.job.coordinates import Modal, frame_at
from printctl.machine.job.dispensing import is_open
from printctl.machine.job.insert_check import (
    InsertPlace,
    JobReach,
    check_factor,
    check_flow,
    judged_lines,
)
from printctl.machine.job.job import Insert, Job


@dataclass
class Inserting:
    """Answers what clients say of looks, while the print is held.

    Attributes
    ----------
    channel : Channel
    queue : RequestQueue
    watch : Watch
    changer : SyringeChanger
    book : LookBook
    job : Job
        Its own lines are what counts.
    """

    channel: Channel
    queue: RequestQueue
    watch: Watch
    changer: SyringeChanger
    book: LookBook
    job: Job

    @cached_property
    def reach(self) -> JobReach:
        """Space that the job's own moves keep to, counted from the touch-off.

        Raises
        ------
        LinkError
            Where the job calls places otherwise in a way that nobody can follow.
        """
        own, start = self.job.own, self.watch.care.start_mm
        frame = frame_at(own, len(own), self.channel.wiring.printer, start)
        return JobReach.of(own.lines, start, frame.shift_at)

    def shift_mm(self) -> tuple[float, float, float]:
        """Return what the job calls places here beyond the count from the touch-off, mm.

        Raises
        ------
        LinkError
            As `reach`.
        """
        progress, start = self.channel.logbook.progress, self.watch.care.start_mm
        frame = frame_at(progress.job, progress.done, self.channel.wiring.printer, start)
        return frame.shift_at(progress.done - 1)

    def answer_all(self, at: Modal) -> LookWord | None:
        """Answer what clients have said; return a decision of theirs, which is still to be made.

        Parameters
        ----------
        at : Modal
            Where the print is held, mm.
        """
        while (word := self.queue.take_look()) is not None:
            try:
                answer = self.book.answer(word)
                if answer is None and word.decision is not None:
                    return word
                word.done(answer or self._insert(word, at))
            except LinkError as exc:
                word.refused(str(exc))
        return None

    def refuse_rest(self) -> None:
        """Answer what came too late: the print goes on or ends."""
        while (word := self.queue.take_look()) is not None:
            try:
                answer = self.book.answer(word)
                word.done(answer) if answer else word.refused("the print goes on")
            except Refused as exc:
                word.refused(str(exc))

    def _insert(self, word: LookWord, at: Modal) -> dict[str, object]:
        """Judge an insert, write it down, and let the job grow by it.

        Raises
        ------
        LinkError
            Where it isn't taken; nothing has changed then.
        """
        channel, progress = self.channel, self.channel.logbook.progress
        done, name = progress.done, f"the insert of look {word.look}"
        place = self._place(at, name)
        lines: tuple[bytes, ...] = ()
        if word.lines or word.flow is None:
            lines = judged_lines(word.lines, place, name)
        if word.flow is not None:
            check_factor(word.flow, place, name)
        flow = progress.job.flow if word.flow is None else word.flow
        insert = Insert(word.look, done, lines, word.why, flow, word.again and bool(lines))
        grown = progress.job.grown(insert)
        if word.flow is not None:
            check_flow(progress.job, grown, place, name)
        plan = self.changer.replanned(grown)
        channel.logbook.refuse_without_room(insert.to_record(), name)
        if channel.logbook.fault:
            raise Refused(f"{name} isn't taken: {channel.logbook.fault}")
        written = channel.logbook.record(
            "insert", **insert.to_record(), reload_at=plan[0], reload_heads=plan[1]
        )
        if not written:
            raise Refused(f"{name} isn't taken: the journal can't be written")
        progress.grow(grown)
        self.watch.grow(progress.job.marks, done, len(lines))
        self.watch.plan(*plan)
        if insert.again:
            self.watch.look_behind(done + len(lines))
        channel.wiring.protocol.grow(progress.job.lines)
        self.book.insert(insert, word.lines)
        return insert_answer(insert)

    def _place(self, at: Modal, name: str) -> InsertPlace:
        wiring, progress = self.channel.wiring, self.channel.logbook.progress
        if is_open(progress.job.lines, progress.done, wiring.printer):
            raise Refused(f"{name} isn't taken: the job has the valve open there")
        bears = wiring.limits().plunger_mm_s
        return InsertPlace(at, self.reach, wiring.printer, bears, self.shift_mm())
