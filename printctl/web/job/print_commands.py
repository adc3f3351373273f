"""Commands to a running or interrupted print: pause, resume, new syringe, cancel, recover."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Annotated, Final, Literal

from fastapi import Query
from pydantic import Field

from firmware_profiles import Syringe
from printctl.machine.job.marks import MarkKind
from printctl.machine.prints.give_up import give_up
from printctl.machine.prints.recovery_file import planned, write_rest
from printctl.machine.process.clients.client import PrintClient, attach
from printctl.machine.records.states import LinkState, Status, state_words
from printctl.observe.continue_print import (
    awaits_observer,
    continue_print,
    new_syringe_of,
    restart,
)
from printctl.observe.observer_launch import ensure_observer
from printctl.web.core import Core
from printctl.web.errors import ConflictError
from printctl.web.job.jobs import JobId
from printctl.web.job.machine import StationPrinting
from printctl.web.profile_store import ProfileStore
from printctl.web.rest import Asking, Body
from printctl.web.workspace import checked_name

FromLine = Annotated[int | None, Query(ge=1, le=2**31, description="Of the job's file.")]
_HELD: Final = (LinkState.PAUSED, LinkState.PAUSING)
_GOING: Final = (LinkState.CONNECTING, LinkState.CHECKING, LinkState.PRINTING)


class PauseRequest(Body):
    """When to pause."""

    after: Literal["now", "layer", "vessel"] = "now"


class ResumeRequest(Body):
    """What was put in at a change of syringe."""

    plunger_mm: Annotated[float, Field(ge=0, le=1000)] | None = Field(
        default=None, description="Travel that the new syringe's plunger has used up; 0 when full."
    )
    syringe: Annotated[str, Field(max_length=300)] | None = Field(
        default=None, description="Its profile, where it is another."
    )
    unchanged: bool = Field(default=False, description="The syringe wasn't changed after all.")


class ReloadRequest(Body):
    """Of several heads, whose syringe."""

    head: Annotated[int, Field(ge=0, le=15)] | None = None


class RecoverRequest(Body):
    """Where the rest of a print begins."""

    from_line: Annotated[int, Field(ge=1, le=2**31)] | None = Field(
        default=None, description="Line of the job's file; the last checkpoint if left out."
    )


@dataclass(frozen=True)
class RestPlan:
    """How to go on after the position was lost; ``steps`` are what a person does first, in order.

    ``lines_left_out`` are commands of the job that aren't printed again.
    """

    lines_left_out: int
    steps: tuple[str, ...]
    start_mm: tuple[float, float, float] | None


@dataclass(frozen=True)
class Rest:
    """The rest of a print, as a job of its own; ``steps`` are what a person does first."""

    job: str
    steps: tuple[str, ...]


class PrintCommands:
    """Pause, resume, change of syringe, confirm alive, cancel; go on, recover, give up."""

    def __init__(self, core: Core, printing: StationPrinting) -> None:
        self._core, self._printing = core, printing

    def pause(self, who: Asking, job: JobId, given: PauseRequest) -> Status:
        """Hold the print now, or once this layer or vessel has ended."""
        self._core.controls.require(who)
        with self._print(job) as client:
            if client.status.state not in _HELD:
                client.pause(None if given.after == "now" else MarkKind(given.after))
            return client.status

    def resume(self, who: Asking, job: JobId, given: ResumeRequest) -> Status:
        """Go on; after a change of syringe with what was put in.

        BadRequestError for a profile outside the workspace, ConflictError when it isn't paused or
        what was told contradicts itself, Refused when the print stays paused, ObserverError when
        its looks need an observer and none can be started: nothing has moved then.
        """
        self._core.controls.require(who)
        syringe, plunger_mm, unchanged = given.syringe or None, given.plunger_mm, given.unchanged
        changed = plunger_mm is not None or syringe is not None
        if unchanged and changed:
            raise ConflictError("the syringe is either unchanged or a new one; say one of both")
        if syringe is not None:
            machine, store = self._printing.machine(), ProfileStore(self._core.workspace.root)
            used = machine.profiles if machine else ()
            syringe = store.resolve(Syringe, syringe, used)
        folder = self._core.workspace.print_folder(job)
        with attach(folder) as client:
            status = client.status
            if status.state is LinkState.RESUMING:
                return status
            if status.state in _GOING and not status.waits_for:
                raise ConflictError(
                    f"the print of {job} isn't paused ({state_words(status.state)})"
                )
            if not status.ended:
                started = ensure_observer(folder)
                change = new_syringe_of(client, syringe, plunger_mm) if changed else None
                if not awaits_observer(folder, client.status, started):
                    client.resume(change, unchanged)
                return client.status
        return continue_print(folder, syringe=syringe, plunger_mm=plunger_mm, unchanged=unchanged)

    def go_on(self, who: Asking, job: JobId) -> Status:
        """Go on with a print that was broken off: the printer is asked for its last line first.

        A print that was broken off while it was paused is paused again. Asking twice does no harm.
        """
        self._core.controls.require(who)
        folder = self._core.workspace.print_folder(job)
        with attach(folder) as client:
            if not client.status.ended:
                return client.status
        with restart(folder) as client:
            return client.status

    def recovery(self, job: JobId, from_line: FromLine = None) -> RestPlan:
        """Plan the rest of a print that can't be gone on with; nothing is written or sent."""
        plan = planned(self._core.workspace.print_folder(job), from_line)
        return RestPlan(plan.begin, tuple(plan.steps), plan.start)

    def recover(self, who: Asking, job: JobId, given: RecoverRequest) -> Rest:
        """Write the rest of a print as a job of the workspace; give its name and what to do first.

        Nothing is sent to the printer.
        """
        self._core.controls.require(who)
        workspace = self._core.workspace
        name = f"{job.partition('~')[2].removesuffix('.gcode')}.rest.gcode"
        file, folder = workspace.root / "jobs" / checked_name(name), workspace.print_folder(job)
        written = write_rest(folder, planned(folder, given.from_line), file)
        return Rest(f"file~{name}", tuple(written["steps"]))

    def give_up(self, who: Asking, job: JobId) -> Status:
        """Write down that a print which was broken off isn't gone on with."""
        self._core.controls.require(who)
        folder = self._core.workspace.print_folder(job)
        with attach(folder) as client:
            if client.status.state is LinkState.GIVEN_UP:
                return client.status
        return give_up(folder, who.by)

    def reload(self, who: Asking, job: JobId, given: ReloadRequest) -> Status:
        """Make room to change the syringe: at the next reload point, or here when it is paused."""
        self._core.controls.require(who)
        with self._print(job) as client:
            if not client.status.waits_for.startswith("syringe"):
                client.reload(given.head)
            return client.status

    def alive(self, who: Asking, job: JobId) -> Status:
        """Confirm that somebody is there."""
        self._core.controls.require(who)
        with self._print(job) as client:
            client.alive()
            return client.status

    def cancel(self, job: JobId) -> Status:
        """End the print by a controlled stop; needs no controls."""
        with self._print(job) as client:
            if client.status.state is not LinkState.STOPPING:
                client.stop()
            return client.status

    @contextmanager
    def _print(self, job: str) -> Iterator[PrintClient]:
        with attach(self._core.workspace.print_folder(job)) as client:
            status = client.status
            if status.ended:
                raise ConflictError(
                    f"the print of {job} is over ({state_words(status.state)}: {status.message})"
                )
            yield client
