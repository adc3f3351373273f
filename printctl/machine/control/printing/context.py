"""Context of one print: what its modes work on, and the small states that they share."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property

from printctl.machine.control.board.channel import Channel
from printctl.machine.control.board.gauges import Gauge, next_due
from printctl.machine.control.board.halting import Kill
from printctl.machine.control.board.heat import HeatCheck
from printctl.machine.control.board.logbook import Logbook
from printctl.machine.control.board.progress import JobProgress, Pace
from printctl.machine.control.board.wiring import Wiring
from printctl.machine.control.events import PrintEvents
from printctl.machine.control.excursion import Excursion, SyringeChange
from printctl.machine.control.interruption import Interruption
from printctl.machine.control.look_book import LookBook
from printctl.machine.control.position.firmware import FirmwareCheck
from printctl.machine.control.position.place import PositionCheck, SlipWatch
from printctl.machine.control.requests import RequestQueue
from printctl.machine.control.watch import Watch
from printctl.machine.job.care import Care
from printctl.machine.job.coordinates import frame_at
from printctl.machine.job.insert_check import JobReach
from printctl.machine.job.job import Job
from printctl.machine.job.marks import MarkKind
from printctl.machine.job.retreat import Retreat
from printctl.machine.records.states import LinkState, Status


class Print:
    """Everything of one print; the modules of its modes are functions of it."""

    def __init__(self, wiring: Wiring, job: Job, care: Care) -> None:
        self.wiring, self.printer = wiring, wiring.printer
        self.first_job = job  # `job` grows by inserts
        self.progress, self.queue = JobProgress(wiring, job), RequestQueue()
        self.watch = Watch(job.marks, care, job.lines, job.positions)
        self.change, self.excursion = SyringeChange(self.progress), Excursion()
        self.book = LookBook()
        self.gauges = [Gauge(one) for one in wiring.printer.watch]
        self.logbook = Logbook(
            wiring, self.progress, self._with_details, lambda: next_due(self.gauges)
        )
        self.channel = Channel(wiring, self.logbook, Kill(wiring))
        self.interruption = Interruption(self.channel, self.queue)
        self.channel.handler = PrintEvents(self.channel, self.queue, self.interruption)
        self.heat, self.firmware = HeatCheck(self.channel), FirmwareCheck(self.channel)
        self.position = PositionCheck(self.channel)
        self.slips = SlipWatch(self.channel, self.position)
        self.pace, self.changes = Pace(), list[str]()  # changes at the panel, in words
        self.valve_shut = False  # by the link, within a path: it is opened again
        self.clients_due = math.inf  # s: when other clients' changes are polled
        # s: when answers are counted; the channel's troubles at the last count
        self.answers_due, self.answers_troubles = math.inf, 0

    @property
    def job(self) -> Job:
        """The job as it has grown."""
        return self.progress.job

    @property
    def retreat(self) -> Retreat:
        """Relief and prime of the head in use."""
        return self.wiring.retreat.of_head(self.progress.head)

    @cached_property
    def reach(self) -> JobReach:
        """Space that the job's own moves keep to, counted from the touch-off.

        Raises
        ------
        LinkError
            Where the job's renamings of places can't be followed.
        """
        own, start = self.first_job.own, self.watch.care.start_mm
        frame = frame_at(own, len(own), self.printer, start)
        return JobReach.of(own.lines, start, frame.shift_at)

    def shift_mm(self) -> tuple[float, float, float]:
        """Return what the job calls places here beyond the count from the touch-off, mm.

        Raises
        ------
        LinkError
            As `reach`.
        """
        done = self.progress.done
        frame = frame_at(self.job, done, self.printer, self.watch.care.start_mm)
        return frame.shift_at(done - 1)

    def begin_pace(self) -> None:
        """Compare the pace, and settings that a panel can change, from here on."""
        errors = self.wiring.protocol.line_errors
        self.pace = Pace(self.progress.done, self.channel.now, errors)

    def _with_details(self, status: Status) -> Status:
        """Return a status with readings, look, dead-man's time and what the print waits for."""
        left = self.watch.care.deadman_s or None  # it stands still in a pause
        if status.state is LinkState.PRINTING:
            left = self.watch.deadman_left(self.channel.now)
        return replace(
            status,
            readings=tuple(map(str, self.gauges)),
            waits_for=self._awaited(status.state),
            deadman_left_s=left,
            look=self.book.status(),
        )

    def _awaited(self, state: LinkState) -> str:
        look, after = self.book.current, self.watch.after
        if state is LinkState.LOOKING and look is not None:
            return f"a decision on look {look.number}"
        if self.change.going_on:
            number = self.change.head
            return "syringe" if number is None else f"syringe {number}"
        if after is None:
            return ""
        return "reload" if after is MarkKind.RELOAD else f"pause after {after}"
