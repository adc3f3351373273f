"""Pause a print at marks, on request or by dead-man's time; wait, resume, check positions.

How a syringe is changed meanwhile is in `printctl.machine.control.syringe_changer`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from printctl.machine.control.channel import Channel
from printctl.machine.control.ending import Ending
from printctl.machine.control.excursion import Excursion
from printctl.machine.control.foreign_changes import ForeignCommands
from printctl.machine.control.gating import PausedTip
from printctl.machine.control.head_choice import HeadChoice
from printctl.machine.control.idle_motors import IdleMotors
from printctl.machine.control.inserting import Inserting
from printctl.machine.control.interruption import StopRequested
from printctl.machine.control.manual_commands import ManualCommands
from printctl.machine.control.position_check import PositionCheck
from printctl.machine.control.print_requests import PrintRequests
from printctl.machine.control.requests import Request, RequestQueue, ResumeRequest
from printctl.machine.control.returning import Returning
from printctl.machine.control.syringe_change import CHANGE, SyringeChange
from printctl.machine.control.syringe_changer import SyringeChanger
from printctl.machine.control.valve_switch import ValveSwitch
from printctl.machine.control.watch import DueTask, Watch
from printctl.machine.errors import LinkError
from printctl.machine.families import link_facts
from printctl.machine.job.care import NewSyringe
from printctl.machine.job.coordinates import Modal
from printctl.machine.records.states import LinkState

PAUSE_SIGN_S: Final = 20.0
"""Interval of the sign of life in a pause."""


@dataclass(frozen=True)
class Pauses:
    """Holds a print and goes on with it.

    Attributes
    ----------
    channel : Channel
    queue : RequestQueue
    requests : PrintRequests
    commands : ManualCommands
    watch : Watch
    change : SyringeChange
    changer : SyringeChanger
    position : PositionCheck
    meddling : ForeignCommands
    heads : HeadChoice
    valve : ValveSwitch
    motors : IdleMotors
    ending : Ending
    excursion : Excursion
    returning : Returning
    inserting : Inserting
        Answers what clients say of the look that a pause came of.
    """

    channel: Channel
    queue: RequestQueue
    requests: PrintRequests
    commands: ManualCommands
    watch: Watch
    change: SyringeChange
    changer: SyringeChanger
    position: PositionCheck
    meddling: ForeignCommands
    heads: HeadChoice
    valve: ValveSwitch
    motors: IdleMotors
    ending: Ending
    excursion: Excursion
    returning: Returning
    inserting: Inserting

    # --- between two lines -----------------------------------------------------------------------

    def at_mark(self) -> None:
        """Do what is due after the lines that were taken; nothing is in flight."""
        progress, watch = self.channel.logbook.progress, self.watch
        clock, done = self.channel.wiring.clock, progress.done
        due = watch.due(clock.now(), done)
        where = ", ".join(str(mark) for mark in progress.job.marks.here(done)) or f"line {done}"
        if due is DueTask.RELOAD:
            planned = done in watch.reload_at
            self.change.plan(watch.reload_head(done) if planned else self.requests.reload_head)
            self.pause(f"paused at the {where}: {self.change.words()}", changing=True)
        elif due is DueTask.PAUSE:
            self.pause(f"paused at the {where}")
        elif due is DueTask.DEADMAN:
            self._nobody_there()
        elif due is DueTask.CHECKPOINT:
            self._checkpoint(where)
            watch.checked(clock.now(), done)

    def _checkpoint(self, where: str) -> None:
        """Compare the position; stand still for it where nobody else can tell what was made."""
        stands = link_facts(self.channel.wiring.printer).plans_by_time
        if stands:
            self.channel.command(b"M400")
        self.position.verify(self.channel.logbook.progress.modal(), mark=where, stands=stands)

    def _nobody_there(self) -> None:
        care = self.watch.care
        message = f"nobody confirmed for {care.deadman_s / 60:g} min (dead-man)"
        self.channel.logbook.alarm(message)
        if care.deadman_stops:
            self.ending.retreat(LinkState.STOPPED, message)
        self.pause(f"{message}; `printctl resume RUN` goes on")

    # --- leaving, waiting, coming back -----------------------------------------------------------

    def pause(self, message: str, changing: bool = False) -> None:
        """Leave the bath, wait for the word to go on, and come back."""
        self.watch.paused(self.channel.logbook.progress.done)
        at = self.leave("pause", changing)
        self.wait_and_come_back(at, message)

    def leave(
        self,
        mark: str,
        changing: bool = False,
        park: tuple[float, float, float] | None = None,
    ) -> Modal:
        """Let the planner run empty, compare the place, relieve the plunger, lift the needle.

        Parameters
        ----------
        mark : str
            What the print is held for, for the journal.
        changing : bool
            Whether the syringe is to be changed.
        park : (x, y, z), mm, optional
            Where the needle will be led from above the place.

        Returns
        -------
        Modal
            The job's place.
        """
        logbook, channel = self.channel.logbook, self.channel
        logbook.enter(
            LinkState.PAUSING,
            "the moves that the printer holds are made; then the plunger is relieved, the needle "
            "lifted",
        )
        channel.command(b"M400")
        self.valve.shut()  # what was taken is written; nothing more
        at = self.position.expected()
        self.position.verify(at, mark=mark, stands=True)
        logbook.record("left", place=at.place(), **({} if park is None else {"park": park}))
        self.meddling.own_modes()
        retreat, relieved = self.heads.retreat, logbook.progress.relieved_mm
        self.excursion.begin(at, relieved, self._top(at, changing))
        channel.commands(retreat.leave(at, channel.wiring.printer, relieved))
        if changing:
            self.begin_change(at)
        channel.command(b"M400")
        return at

    def begin_change(self, at: Modal) -> None:
        """Write down that the syringe is being changed, and make room for it."""
        self.excursion.lose_count()
        self.changer.begin(at)

    def _top(self, at: Modal, changing: bool) -> float | None:
        """Return the greatest height of the way out of ``at``, mm."""
        if at.z is None:
            return None
        retreat, high = self.channel.wiring.retreat, self.channel.wiring.printer.z_mm.high
        lift = max(self.heads.retreat.lift_mm, retreat.park_mm if changing else 0.0)
        return max(at.z, min(at.z + lift, high))

    def await_syringe(self, at: Modal, head: int | None = None) -> None:
        """Go on waiting for a syringe: the host died while it was changed."""
        self.excursion.begin(at, 0.0, None)
        self.excursion.lose_count()
        self.changer.found_again(at, head)
        self.wait_and_come_back(at, f"paused, found again: {self.change.words()}")

    def wait_and_come_back(self, at: Modal, message: str) -> None:
        """Wait for the word to go on; then count a new syringe, and come back to ``at``."""
        logbook = self.channel.logbook
        logbook.enter(LinkState.PAUSED, message)
        self.excursion.rest()
        resume = self._stay_paused(at)
        logbook.enter(LinkState.RESUMING, "returning to where the print was left")
        resume.answer("")
        new = resume.change if self.change.going_on else None
        if new or (self.change.going_on and self.change.idle_head is not None):
            self.changer.count(at, new or NewSyringe())
        self.come_back(at, self.heads.retreat.prime_mm, by_person=True)

    def come_back(self, at: Modal, prime_mm: float = 0.0, by_person: bool = False) -> None:
        """Take back what others have set, lower the needle to ``at``, and go on printing.

        ``by_person``: it was a person's word, so that somebody is there (dead-man's time).
        """
        logbook = self.channel.logbook
        self.position.refuse_pushed(self.excursion.plunger_e(self.heads.retreat))
        self.meddling.take_back()
        self.meddling.own_modes()
        self.position.refuse_renamed(waited=True)  # before the needle is lowered by that name
        self.heads.take()
        self.returning.come_back(at, prime_mm)
        self.change.end()
        self.position.note_plunger()
        self.inserting.book.end()
        self.inserting.refuse_rest()
        if by_person:
            self.requests.alive()
        logbook.enter(LinkState.PRINTING, "printing")
        self.valve.reopen()

    def _stay_paused(self, at: Modal) -> ResumeRequest:
        """Wait for a request to go on that can be granted, and return it; refuse the others."""
        channel, queue = self.channel, self.queue
        clock, tip = channel.wiring.clock, PausedTip(channel.wiring.limits(), channel.command)
        while True:
            until = clock.now() + PAUSE_SIGN_S
            while clock.now() < until and not queue.waiting:
                channel.pump(until)
                self.ending.end_on_fault()
            self.commands.send_all(tip.known)
            self.ending.end_on_fault()
            word = self.inserting.answer_all(at)
            if word is not None:  # of a look that became a pause without anybody's decision
                word.refused("the print is paused; `printctl resume RUN` goes on")
            request = queue.take()
            if request is Request.STOP:
                raise StopRequested
            if request is Request.RELOAD and not self.change.going_on:
                self.change.plan(self.requests.reload_head)
                self.begin_change(at)
                channel.logbook.enter(LinkState.PAUSED, self.change.words())
            if isinstance(request, ResumeRequest):
                problem = self._why_not_resume(at, request)
                if not problem:
                    return request
                channel.logbook.alarm(problem)
                channel.logbook.enter(LinkState.PAUSED, problem)
                request.answer(problem)
            self.motors.sign_of_life()

    def _why_not_resume(self, at: Modal, request: ResumeRequest) -> str:
        """Say what keeps the needle from coming down; empty for nothing."""
        if self.change.going_on and not (request.change or request.unchanged):
            return f"not resumed: {CHANGE}"
        wrong, _ = self.position.compare(Modal(x=at.x, y=at.y))
        if wrong:
            return f"not resumed: {wrong}; bring the needle back above that place first"
        if self.change.going_on and request.change:
            try:
                self.changer.replan(request.change)
            except LinkError as exc:
                return f"not resumed: {exc}"
        return ""
