"""REST of jobs and their print: models of what is asked and answered, and routes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from html import escape
from typing import Annotated, Any, Final
from urllib.parse import quote

from fastapi import APIRouter, File, Query, Request, Response, UploadFile
from fastapi.responses import FileResponse
from pydantic import BaseModel, ConfigDict, Field

from printctl.machine.prints.alerts import Alert
from printctl.machine.prints.progress import Progress
from printctl.machine.prints.state import Possible
from printctl.machine.records.states import LinkState
from printctl.web.job.aftercare import Aftercare, checklist
from printctl.web.job.camera.service import CameraService
from printctl.web.job.jobs import JobEntry, JobId, all_jobs, entry_of
from printctl.web.job.looks import LookService
from printctl.web.job.machine import Machine
from printctl.web.job.preflight import PreflightReport
from printctl.web.job.prints import PrintReport
from printctl.web.job.readiness import Readiness
from printctl.web.job.service import JobService
from printctl.web.job.set_up import PROFILES, JobSetUp, Place
from printctl.web.live.routes import preload
from printctl.web.live.routes import router as live_router
from printctl.web.rest import API, REFUSALS, Asking, Body


@dataclass(frozen=True)
class Form:
    """The set-up filled in, the points to tick, and profiles to choose: their value and name.

    ``declared`` is whether the job itself says where it starts.
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


AnyJob = Annotated[str, Query(max_length=80, description="run~NAME, file~NAME, or none.")]
_JPEG: Final[dict[int | str, dict[str, Any]]] = {200: {"content": {"image/jpeg": {}}}}
_KEPT: Final = "~!*'()"
"""As JavaScript leaves them in a query (`encodeURIComponent`)."""


def routers(service: JobService) -> tuple[APIRouter, ...]:
    """Routes of jobs and prints, and of the live view; nested, each would be made twice."""
    own = _jobs(service), _prints(service), _after(service.after), _looks(service.looks)
    return *own, _camera(service.watching), live_router(service.scene, service.scenes)


def _router(tag: str) -> APIRouter:
    return APIRouter(prefix=API, responses=REFUSALS, tags=[tag])


def job_hints(service: JobService) -> Callable[[Request], str]:
    """What a browser fetches at once for the Job page: how the print stands, and its drawing."""

    def hints(request: Request) -> str:
        job = request.query_params.get("job", "")
        asked = f"{API}/prints/current?job={quote(job, safe=_KEPT)}"
        state = f'<link rel="preload" as="fetch" crossorigin href="{escape(asked)}">'
        report = service.prints.current()
        drawn = report is not None and job in ("", report.job)
        return f"{state}\n{preload(report.job)}" if report and drawn else state

    return hints


def _jobs(service: JobService) -> APIRouter:
    routes, workspace = _router("jobs"), service.core.workspace

    @routes.get("/jobs", summary="Every job, the newest first")
    def list_jobs() -> list[JobEntry]:
        return all_jobs(workspace)

    @routes.get("/jobs/unusable", summary="Files and runs whose names can't be jobs")
    def unusable() -> list[str]:
        return workspace.unusable_names("jobs/*.gcode", "runs/*")

    @routes.post("/jobs", summary="Upload a G-code file; nothing in it is run")
    def upload(file: Annotated[UploadFile, File()]) -> JobEntry:
        return service.upload(file.filename or "", file.file)

    @routes.get("/jobs/{job}", summary="One job")
    def one_job(job: JobId) -> JobEntry:
        return entry_of(workspace, job)

    @routes.get("/jobs/{job}/form", summary="The set-up filled in, the printer")
    def form(job: JobId) -> Form:
        return Form(
            set_up=service.set_up(job),
            machine=service.printing.machine(),
            checklist=checklist()["before"],
            choices={part: service.choices(part) for part in PROFILES},
            declared=service.declared(job) is not None,
        )

    routes.put("/jobs/{job}/set-up", summary="Keep a set-up for the job")(service.keep_set_up)

    @routes.get("/jobs/{job}/readiness", summary="All that refuses a start")
    def readiness(
        job: JobId,
        who: Asking,
        wait: Annotated[bool, Query(description="Whether to check the job where needed.")] = True,
    ) -> Readiness:
        return service.readiness(who, job, wait=wait)

    @routes.post("/jobs/{job}/preflight", summary="Check before the print")
    def preflight(job: JobId, given: PreflightRequest) -> PreflightReport:
        return service.preflight(job, given.set_up or service.set_up(job))

    @routes.post("/jobs/{job}/to-start", summary="Move the tip to the job's start")
    def to_start(job: JobId, given: ToStartRequest, who: Asking) -> Machine:
        start_mm = given.start_mm or service.set_up(job).start_mm
        return service.to_start(who, job, start_mm)

    confirm = "Confirm that a file without a record was made for what is mounted"
    routes.post("/jobs/{job}/for-mounted", summary=confirm)(service.confirm_set_up)
    routes.get("/jobs/{job}/record", summary="What is written down")(service.record)
    routes.patch("/jobs/{job}/record", summary="Write down; changes are kept")(service.write_down)
    return routes


def _prints(service: JobService) -> APIRouter:
    routes = _router("prints")

    @routes.get("/prints", summary="Prints that were started, as they stand")
    def prints() -> list[PrintResponse]:
        reports = (service.prints.heard(job) for job in service.core.workspace.jobs())
        return [print_response(one) for one in reports if one is not None]

    @routes.get(
        "/prints/current",
        summary="A job's last print; without one what goes on, else what broke off last",
    )
    def current(job: AnyJob = "") -> PrintResponse | None:
        report = service.prints.heard(job) if job else service.prints.current()
        return None if report is None else print_response(report)

    @routes.post("/prints/{job}/start", summary="Start; harmless when it goes on")
    def start(job: JobId, given: StartRequest, who: Asking) -> PrintResponse:
        set_up = given.set_up or service.set_up(job)
        return print_response(service.start(who, job, set_up, given.confirmed))

    @routes.get("/prints/{job}", summary="State and progress")
    def status(job: JobId) -> PrintResponse:
        return print_response(service.prints.last(job))

    get, post, hands = routes.get, routes.post, service.hands
    get("/prints/{job}/mends", summary="What an observer had written again")(service.mends)
    get("/prints/{job}/viability", summary="The clock of the cells")(service.viability)
    post("/prints/{job}/pause", summary="Hold, now or at a mark")(hands.pause)
    post("/prints/{job}/resume", summary="Go on, with a new syringe's data")(hands.resume)
    post("/prints/{job}/reload", summary="Make room to change the syringe")(hands.reload)
    post("/prints/{job}/alive", summary="Somebody is there")(hands.alive)
    post("/prints/{job}/cancel", summary="Cancel the print in an orderly way; needs no controls")(
        hands.cancel
    )
    post("/prints/{job}/go-on", summary="Go on after a print broke off")(hands.go_on)
    get("/prints/{job}/recovery", summary="Plan the rest; nothing is written")(hands.recovery)
    post("/prints/{job}/recover", summary="Write the rest as a job")(hands.recover)
    post("/prints/{job}/give-up", summary="Don't go on; write its end down")(hands.give_up)
    return routes


def _after(after: Aftercare) -> APIRouter:
    routes = _router("after a print")
    get, post = routes.get, routes.post
    get("/prints/{job}/steps", summary="Steps after the print")(after.steps)
    routes.put("/prints/{job}/steps/{step}", summary="Tick a step, or take it back")(after.tick)
    get("/prints/{job}/notes", summary="Notes")(after.notes)
    post("/prints/{job}/notes", summary="Add a note")(after.note)
    get("/prints/{job}/photos", summary="Photos")(after.photos)
    post("/prints/{job}/photos", summary="Add a photo; it is written anew")(after.add_photo)
    get("/prints/{job}/flush", summary="How hard to flush; null if unknown")(after.flush)
    get("/prints/{job}/melt-out", summary="How to warm its bath")(after.melt_out_of)
    post("/melt-out", summary="Warm a heater at a rate")(after.melt_out)
    get("/melt-out", summary="The warming as it stands; null for none")(after.melting)
    stop = "Raise the target no further; a stop, which needs no controls"
    routes.delete("/melt-out", summary=stop)(after.stop_melting)
    photo = "/prints/{job}/photos/{name}"
    get(photo, summary="A photo", response_class=FileResponse, responses=_JPEG)(after.photo)
    return routes


def _looks(looks: LookService) -> APIRouter:
    routes, place = _router("looks"), "/prints/{job}/looks"
    routes.get(place, summary="Looks at the last print")(looks.looks)
    routes.get(
        f"{place}/{{number}}/picture",
        summary="A look's picture, with what was expected and found",
        response_class=Response,
        responses=_JPEG,
    )(looks.picture)
    ask = "Answer a look that asks; 409 where the print doesn't wait for it"
    routes.post(f"{place}/{{number}}/answer", summary=ask)(looks.answer)
    return routes


def _camera(watching: CameraService) -> APIRouter:
    routes = _router("camera")
    routes.get("/camera", summary="The camera as it stands")(watching.seen)
    routes.get(
        "/camera/still",
        summary="The picture of now, about once a second; 409 while the camera is lost",
        response_class=Response,
        responses={**_JPEG, 304: {"description": "None newer."}},
    )(watching.still)
    lapse = "/prints/{job}/timelapse"
    routes.get(lapse, summary="The last print's time-lapse")(watching.timelapse)
    routes.get(
        f"{lapse}/film",
        summary="Its film, an animated WebP; there once the print has ended",
        response_class=FileResponse,
        responses={200: {"content": {"image/webp": {}}}},
    )(watching.film)
    return routes


def print_response(heard: PrintReport) -> PrintResponse:
    """A print, as the API tells it."""
    return PrintResponse.model_validate(heard.to_dict())
