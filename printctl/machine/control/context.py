"""Context of one print: what its modes work on, and the small states that they share."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

from firmware_profiles import Printer
from printctl.machine.control.channel import Channel
from printctl.machine.control.excursion import Excursion, SyringeChange
from printctl.machine.control.firmware_check import FirmwareCheck
from printctl.machine.control.foreign_changes import ForeignCommands
from printctl.machine.control.frame_check import FrameCheck
from printctl.machine.control.gauges import Gauge, Gauges, next_due
from printctl.machine.control.heat_check import HeatCheck
from printctl.machine.control.interruption import Interruption
from printctl.machine.control.logbook import Logbook
from printctl.machine.control.look_book import LookBook
from printctl.machine.control.other_clients import OtherClients
from printctl.machine.control.position_check import PositionCheck
from printctl.machine.control.print_events import print_channel
from printctl.machine.control.progress import JobProgress
from printctl.machine.control.requests import RequestQueue
from printctl.machine.control.slips import SlipWatch
from printctl.machine.control.watch import Watch
from printctl.machine.control.wiring import Wiring
from printctl.machine.job.care import Care
from printctl.machine.job.frame import frame_at
from printctl.machine.job.job import Job
from printctl.machine.job.marks import MarkKind
from printctl.machine.job.reach import JobReach
from printctl.machine.job.retreat import Retreat
from printctl.machine.records.states import LinkState, Status


@dataclass
class Print:
    """One print; the modules of its modes are functions of it.

    Attributes
    ----------
    wiring : Wiring
    first_job : Job
        As given at the start; `progress.job` grows by inserts.
    watch : Watch
    queue : RequestQueue
    progress, logbook, channel
        How far it is, what is written down, and the way to the printer.
    gauges, frame, position, firmware, heat, foreign, clients, slips
        Checks; each owns what it has read.
    interruption : Interruption
    change : SyringeChange
    book : LookBook
    excursion : Excursion
    valve_shut : bool
        Whether the link shut the valve within a path, so that it is opened again.
    answers_due : float, s
    answers_troubles : int
        When answers are counted next, and the channel's troubles then.
    """

    wiring: Wiring
    first_job: Job
    watch: Watch
    queue: RequestQueue
    gauges: Gauges
    change: SyringeChange
    book: LookBook
    channel: Channel
    interruption: Interruption
    frame: FrameCheck
    position: PositionCheck
    firmware: FirmwareCheck
    heat: HeatCheck
    foreign: ForeignCommands
    clients: OtherClients
    slips: SlipWatch
    excursion: Excursion = field(default_factory=Excursion)
    valve_shut: bool = False
    answers_due: float = math.inf
    answers_troubles: int = 0

    @property
    def logbook(self) -> Logbook:
        """Its state and alarms, and its journal."""
        return self.channel.logbook

    @property
    def progress(self) -> JobProgress:
        """How far the job is."""
        return self.channel.logbook.progress

    @property
    def job(self) -> Job:
        """The job as it has grown."""
        return self.channel.logbook.progress.job

    @property
    def printer(self) -> Printer:
        """Its profile."""
        return self.wiring.printer

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


def new_print(wiring: Wiring, job: Job, care: Care) -> Print:
    """Return a print that hasn't begun."""
    progress, queue = JobProgress(wiring, job), RequestQueue()
    watched = [Gauge(one) for one in wiring.printer.watch]
    logbook = Logbook(
        wiring, progress, lambda status: _with_details(run, status), lambda: next_due(watched)
    )
    channel, interruption = print_channel(wiring, logbook, queue)
    frame, heat, gauges = FrameCheck(channel), HeatCheck(channel), Gauges(channel, watched)
    position, firmware = PositionCheck(channel, frame), FirmwareCheck(channel, gauges)
    run = Print(
        wiring=wiring,
        first_job=job,
        watch=Watch(job.marks, care, job.lines, job.positions),
        queue=queue,
        gauges=gauges,
        change=SyringeChange(progress),
        book=LookBook(),
        channel=channel,
        interruption=interruption,
        frame=frame,
        position=position,
        firmware=firmware,
        heat=heat,
        foreign=ForeignCommands(channel, firmware, position, heat),
        clients=OtherClients(channel, position, heat),
        slips=SlipWatch(channel, position),
    )
    return run


def _with_details(run: Print, status: Status) -> Status:
    """Return a status with readings, look, dead-man's time and what the print waits for."""
    left = run.watch.care.deadman_s or None  # it stands still in a pause
    if status.state is LinkState.PRINTING:
        left = run.watch.deadman_left(run.wiring.clock.now())
    return replace(
        status,
        readings=run.gauges.readings,
        waits_for=_awaited(run, status.state),
        deadman_left_s=left,
        look=run.book.status(),
    )


def _awaited(run: Print, state: LinkState) -> str:
    look, after = run.book.current, run.watch.after
    if state is LinkState.LOOKING and look is not None:
        return f"a decision on look {look.number}"
    if run.change.going_on:
        number = run.change.head
        return "syringe" if number is None else f"syringe {number}"
    if after is None:
        return ""
    return "reload" if after is MarkKind.RELOAD else f"pause after {after}"
