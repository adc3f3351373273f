"""REST of jobs and their print: models of what is asked and answered, and routes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from html import escape
from typing import Annotated, Any, Final
from urllib.parse import quote

from fastapi import APIRouter, File, Path, Query, Request, UploadFile
from fastapi.responses import FileResponse
from pydantic import BaseModel, ConfigDict, Field

from printctl.machine.link.states import LinkState, Status
from printctl.machine.print_state.actions import Possible
from printctl.machine.print_state.alerts import Alert
from printctl.machine.printing.mend_strokes import MendStrokes
from printctl.machine.printing.progress import Progress
from printctl.web.errors import NotFoundError
from printctl.web.job import looks as look_routes
from printctl.web.job.aftercare import (
    MOST_BYTES,
    FlushLimit,
    Note,
    Photo,
    RampState,
    Step,
    Viability,
    Warming,
    checklist,
)
from printctl.web.job.camera.routes import add_routes
from printctl.web.job.jobs import JobEntry, entry_of, list_jobs
from printctl.web.job.machine import Machine
from printctl.web.job.preflight import PreflightReport
from printctl.web.job.print_commands import After, Rest, RestPlan, ResumeRequest
from printctl.web.job.prints import PrintReport
from printctl.web.job.readiness import Readiness
from printctl.web.job.record import PrintRecord
from printctl.web.job.service import JobService
from printctl.web.job.set_up import PROFILES, JobSetUp, Place
from printctl.web.live.routes import preload
from printctl.web.live.routes import router as live_router
from printctl.web.rest import API, REFUSALS, Asking, Body


@dataclass(frozen=True)
class Form:
    """The set-up filled in, and what it is chosen from.

    Attributes
    ----------
    machine : Machine or None
        The printer that is connected.
    checklist : list
        Points to tick before the start.
    choices : dict
        Profiles that can be named: of each part their value and their name.
    declared : bool
        Whether the job itself says where it starts.
    """

    set_up: JobSetUp
    machine: Machine | None
    checklist: list[dict[str, str]]
    choices: dict[str, dict[str, str]]
    declared: bool


class PreflightRequest(Body):
    """A set-up to check the job with; as it is filled in where it is left out."""

    set_up: JobSetUp | None = None


class StartRequest(PreflightRequest):
    """A start."""

    confirmed: str = Field(max_length=500, description="The machine, as `machine.words` says it.")


class ToStartRequest(Body):
    """A move of the tip to where a job starts."""

    start_mm: Place | None = Field(
        default=None, description="As the set-up is filled in if left out."
    )


class PauseRequest(Body):
    """When to pause."""

    after: After = "now"


class RecoverRequest(Body):
    """Where the rest of a print begins."""

    from_line: Annotated[int, Field(ge=1, le=2**31)] | None = Field(
        default=None, description="Line of the job's file; the last checkpoint if left out."
    )


class ReloadRequest(Body):
    """Of several heads, whose syringe."""

    head: Annotated[int, Field(ge=0, le=15)] | None = None


class TickRequest(Body):
    """A step done, or not after all."""

    done: bool = True


class NoteRequest(Body):
    """A note."""

    text: Annotated[str, Field(min_length=1, max_length=10_000)]


class PrintResponse(BaseModel):
    """A print, and how far it has come; with it the fields of `Status`."""

    model_config = ConfigDict(extra="allow")

    job: str
    simulated: bool = Field(description="Whether a simulated printer prints it.")
    state: LinkState
    folder: str
    print_id: str = Field(description="Identity of the print, as the history names it.")
    started: float = Field(description="s since 1970.")
    share: float = Field(description="Of the time where that is known, else of the lines; 0 to 1.")
    words: dict[str, str] = Field(
        description="State, time, layer, vessel, ink, tip, as people read."
    )
    alert: Alert | None = Field(description="What somebody must know: what, means, remedy.")
    time_left_s: float | None = Field(description="null for a print that is over.")
    actions: list[Possible] = Field(description="Each action, and if it is possible now.")
    progress: Progress | None = Field(
        description="By time, layer, vessel and ink; null until the job's table is made."
    )


Job = Annotated[str, Path(max_length=80, description="run~NAME or file~NAME.")]
AnyJob = Annotated[str, Query(max_length=80, description="run~NAME, file~NAME, or none.")]
FromLine = Annotated[int | None, Query(ge=1, le=2**31, description="Of the job's file.")]
_KEPT: Final = "~!*'()"
"""As JavaScript leaves them in a query (`encodeURIComponent`)."""


def routers(service: JobService) -> tuple[APIRouter, ...]:
    """Routes of jobs and prints, and of the live view; nested, each would be made twice."""
    seen = _router()
    add_routes(seen, service.watching, service.prints.heard)
    looks = _router("looks")
    look_routes.add_routes(looks, service.looks)
    own = _jobs(service), _prints(service), _broken_off(service), _after(service)
    return *own, seen, looks, live_router(service.scene, service.scenes)


def _router(*tags: str) -> APIRouter:
    return APIRouter(prefix=API, responses=REFUSALS, tags=[*tags])


def job_hints(service: JobService) -> Callable[[Request], str]:
    """What a browser fetches at once for the page Job: how the print stands, and its drawing."""

    def hints(request: Request) -> str:
        job = request.query_params.get("job", "")
        asked = f"{API}/prints/current?job={quote(job, safe=_KEPT)}"
        state = f'<link rel="preload" as="fetch" crossorigin href="{escape(asked)}">'
        report = service.prints.current() or service.prints.unfinished()
        drawn = report is not None and job in ("", report.job)
        return f"{state}\n{preload(report.job)}" if report and drawn else state

    return hints


def _jobs(service: JobService) -> APIRouter:
    routes, workspace = _router("jobs"), service.core.workspace

    @routes.get("/jobs", summary="Every job, the newest first")
    def jobs() -> list[JobEntry]:
        return list_jobs(workspace)

    @routes.get("/jobs/unusable", summary="Files and runs whose names can't be jobs")
    def unusable() -> list[str]:
        return workspace.unusable_names("jobs/*.gcode", "runs/*")

    @routes.post("/jobs", summary="Upload a G-code file; nothing in it is run")
    def upload(file: Annotated[UploadFile, File()]) -> JobEntry:
        return service.upload(file.filename or "", file.file)

    @routes.get("/jobs/{job}", summary="One job")
    def one_job(job: Job) -> JobEntry:
        return entry_of(workspace, job)

    @routes.get("/jobs/{job}/form", summary="The set-up filled in, the printer")
    def form(job: Job) -> Form:
        return Form(
            set_up=service.set_up(job),
            machine=service.printing.machine(),
            checklist=checklist()["before"],
            choices={part: service.store.choices(kind) for part, kind in PROFILES.items()},
            declared=service.declared(job) is not None,
        )

    @routes.put("/jobs/{job}/set-up", summary="Keep a set-up for the job")
    def keep_set_up(job: Job, given: JobSetUp) -> JobSetUp:
        return service.keep_set_up(job, given)

    @routes.get("/jobs/{job}/readiness", summary="All that refuses a start")
    def readiness(
        job: Job,
        who: Asking,
        wait: Annotated[bool, Query(description="Whether to check the job where needed.")] = True,
    ) -> Readiness:
        return service.readiness(who, job, wait=wait)

    @routes.post("/jobs/{job}/preflight", summary="Check before the print")
    def preflight(job: Job, given: PreflightRequest) -> PreflightReport:
        return service.preflight(job, given.set_up or service.set_up(job))

    @routes.post("/jobs/{job}/to-start", summary="Move the tip to the job's start")
    def to_start(job: Job, given: ToStartRequest, who: Asking) -> Machine:
        start_mm = given.start_mm or service.set_up(job).start_mm
        return service.to_start(who, job, start_mm)

    @routes.get("/jobs/{job}/record", summary="What is written down")
    def record(job: Job) -> PrintRecord:
        workspace.job_file(job)
        return service.record(job)

    @routes.patch("/jobs/{job}/record", summary="Write down; changes are kept")
    def write_down(job: Job, given: dict[str, Any], who: Asking) -> PrintRecord:
        return service.write_down(who, job, given)

    return routes


def _prints(service: JobService) -> APIRouter:
    routes, hands = _router("prints"), service.hands

    @routes.get("/prints", summary="Prints that were started, as they stand")
    def prints() -> list[PrintResponse]:
        reports = (service.prints.heard(job) for job in service.core.workspace.jobs())
        return [print_response(one) for one in reports if one is not None]

    @routes.get(
        "/prints/current",
        summary="A job's last print; without one what goes on, else what broke off last",
    )
    def current(job: AnyJob = "") -> PrintResponse | None:
        if job:
            report = service.prints.heard(job)
        else:
            report = service.prints.current() or service.prints.unfinished()
        return None if report is None else print_response(report)

    @routes.post("/prints/{job}/start", summary="Start; harmless when it goes on")
    def start(job: Job, given: StartRequest, who: Asking) -> PrintResponse:
        set_up = given.set_up or service.set_up(job)
        return print_response(service.start(who, job, set_up, given.confirmed))

    @routes.get("/prints/{job}", summary="State and progress")
    def status(job: Job) -> PrintResponse:
        reports = service.prints.heard(job)
        if reports is None:
            raise NotFoundError(f"no print of {job} was ever started")
        return print_response(reports)

    @routes.get("/prints/{job}/mends", summary="What an observer had written again")
    def mends(job: Job) -> list[MendStrokes]:
        return service.mends(job)

    @routes.get("/prints/{job}/viability", summary="The clock of the cells")
    def viability(job: Job) -> Viability:
        return service.viability(job)

    @routes.post("/prints/{job}/pause", summary="Hold, now or at a mark")
    def pause(job: Job, given: PauseRequest, who: Asking) -> Status:
        return hands.pause(who, job, given.after)

    @routes.post("/prints/{job}/resume", summary="Go on, with a new syringe's data")
    def resume(job: Job, given: ResumeRequest, who: Asking) -> Status:
        return hands.resume(who, job, given)

    @routes.post("/prints/{job}/reload", summary="Make room to change the syringe")
    def reload(job: Job, given: ReloadRequest, who: Asking) -> Status:
        return hands.reload(who, job, given.head)

    @routes.post("/prints/{job}/alive", summary="Somebody is there")
    def alive(job: Job, who: Asking) -> Status:
        return hands.alive(who, job)

    @routes.post("/prints/{job}/cancel", summary="Controlled stop; for everybody")
    def cancel(job: Job) -> Status:
        return hands.cancel(job)

    return routes


def _broken_off(service: JobService) -> APIRouter:
    """After the print's process, its port or the power was lost."""
    routes, hands = _router("prints"), service.hands

    @routes.post("/prints/{job}/go-on", summary="Go on after a print broke off")
    def go_on(job: Job, who: Asking) -> Status:
        return hands.go_on(who, job)

    @routes.get("/prints/{job}/recovery", summary="Plan the rest; nothing is written")
    def recovery(job: Job, from_line: FromLine = None) -> RestPlan:
        return hands.rest_plan(job, from_line)

    @routes.post("/prints/{job}/recover", summary="Write the rest as a job")
    def recover(job: Job, given: RecoverRequest, who: Asking) -> Rest:
        return hands.recover(who, job, given.from_line)

    @routes.post("/prints/{job}/give-up", summary="Don't go on; write its end down")
    def give_up(job: Job, who: Asking) -> Status:
        return hands.give_up(who, job)

    return routes


def _after(service: JobService) -> APIRouter:
    routes, after = _router("after a print"), service.after

    @routes.get("/prints/{job}/steps", summary="Steps after the print")
    def steps(job: Job) -> list[Step]:
        return after.steps(job)

    @routes.put("/prints/{job}/steps/{step}", summary="Tick a step, or take it back")
    def tick(job: Job, step: str, given: TickRequest, who: Asking) -> list[Step]:
        return after.tick(who, job, step, given.done)

    @routes.get("/prints/{job}/notes", summary="Notes")
    def notes(job: Job) -> list[Note]:
        return after.notes(job)

    @routes.post("/prints/{job}/notes", summary="Add a note")
    def note(job: Job, given: NoteRequest, who: Asking) -> list[Note]:
        return after.note(who, job, given.text)

    @routes.get("/prints/{job}/photos", summary="Photos")
    def photos(job: Job) -> list[Photo]:
        return after.photos(job)

    @routes.post("/prints/{job}/photos", summary="Add a photo; it is written anew")
    def add_photo(job: Job, file: Annotated[UploadFile, File()], who: Asking) -> list[Photo]:
        return after.add_photo(who, job, file.file.read(MOST_BYTES + 1))

    @routes.get(
        "/prints/{job}/photos/{name}",
        summary="A photo",
        response_class=FileResponse,
        responses={200: {"content": {"image/jpeg": {}}}},
    )
    def photo(job: Job, name: str) -> FileResponse:
        return FileResponse(after.photo(job, name), media_type="image/jpeg")

    @routes.get("/prints/{job}/flush", summary="How hard to flush; null if unknown")
    def flush(job: Job, wall_shear_pa: float | None = None) -> FlushLimit | None:
        return after.flush(job, wall_shear_pa)

    @routes.get("/prints/{job}/melt-out", summary="How to warm its bath")
    def melt_out_of(job: Job) -> Warming:
        return after.warming_of(job)

    @routes.post("/melt-out", summary="Warm a heater at a rate")
    def melt_out(given: Warming, who: Asking) -> RampState:
        return after.melt_out(who, given)

    @routes.get("/melt-out", summary="The warming as it stands; null for none")
    def melting() -> RampState | None:
        return after.melting()

    @routes.delete(
        "/melt-out",
        summary="Raise the target no further; a stop, which needs no controls",
    )
    def stop_melting() -> RampState | None:
        return after.stop_melting()

    return routes


def print_response(heard: PrintReport) -> PrintResponse:
    """A print, as the API tells it."""
    return PrintResponse.model_validate(heard.to_dict())
