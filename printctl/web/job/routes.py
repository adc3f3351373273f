"""REST routes for jobs and prints: upload, preflight, start, control, record, recovery, notes."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated, Any, Final

from fastapi import APIRouter, Depends, File, Path, Query, Request, UploadFile
from fastapi.responses import FileResponse

from printctl.machine.link.states import Status
from printctl.web.api.answers import API
from printctl.web.controls import Principal
from printctl.web.errors import NotFoundError
from printctl.web.job import models as m
from printctl.web.job.camera.routes import add_routes
from printctl.web.job.following import PrintReport
from printctl.web.job.looks import routes as look_routes
from printctl.web.job.machine import Machine
from printctl.web.job.photos import MOST_BYTES
from printctl.web.job.record import PrintRecord
from printctl.web.job.service import JobService
from printctl.web.job.steps_after import checklist
from printctl.web.live.routes import router as live_router

Job = Annotated[str, Path(max_length=80, description="run~NAME or file~NAME.")]
FromLine = Annotated[int | None, Query(ge=1, le=2**31, description="Of the job's file.")]
REFUSED: Final[dict[int | str, dict[str, Any]]] = {
    404: {"description": "There is no such job or print."},
    409: {"description": "Not as things stand; the message says why."},
    413: {"description": "More than is taken here."},
    422: {"description": "What was sent can't be taken."},
    423: {"description": "Another browser holds the controls."},
}


def requesting_user(request: Request) -> Principal:
    """Return the requesting user, as set by the access guard."""
    principal: Principal | None = getattr(request.state, "principal", None)
    return principal or Principal("local", "this machine")


Who = Annotated[Principal, Depends(requesting_user)]


def routers(service: JobService) -> tuple[APIRouter, ...]:
    """Routes of jobs and prints, and of the live view; nested, each would be made twice."""
    routes = APIRouter(prefix=API, responses=REFUSED)
    _jobs(routes, service)
    _prints(routes, service)
    _broken_off(routes, service)
    _after(routes, service)
    add_routes(routes, service.watching, service.heard)
    look_routes.add_routes(routes, service.looks, requesting_user)
    return routes, live_router(service.scene, service.scenes)


def _jobs(routes: APIRouter, service: JobService) -> None:
    @routes.get("/jobs", tags=["jobs"], summary="Every job, the newest first")
    def list_jobs() -> list[m.JobResponse]:
        return [m.JobResponse.model_validate(one.to_dict()) for one in service.jobs()]

    @routes.post("/jobs", tags=["jobs"], summary="Upload a G-code file; nothing in it is run")
    def upload(file: Annotated[UploadFile, File()]) -> m.JobResponse:
        entry = service.upload(file.filename or "", file.file)
        return m.JobResponse.model_validate(entry.to_dict())

    @routes.get("/jobs/{job}", tags=["jobs"], summary="One job")
    def one_job(job: Job) -> m.JobResponse:
        return m.JobResponse.model_validate(service.job(job).to_dict())

    @routes.get("/jobs/{job}/form", tags=["jobs"], summary="The set-up filled in, the printer")
    def form(job: Job) -> m.FormResponse:
        return m.FormResponse(
            set_up=service.set_up(job),
            machine=machine_response(service.machine()),
            checklist=checklist()["before"],
        )

    @routes.post("/jobs/{job}/preflight", tags=["jobs"], summary="Check before the print")
    def preflight(job: Job, given: m.PreflightRequest) -> m.PreflightResponse:
        set_up = given.set_up or service.set_up(job)
        return m.PreflightResponse.model_validate(service.preflight(job, set_up))

    @routes.post("/jobs/{job}/to-start", tags=["jobs"], summary="Move the tip to the job's start")
    def to_start(job: Job, given: m.ToStartRequest, who: Who) -> m.TipResponse:
        start_mm = given.start_mm or service.set_up(job).start_mm
        return m.TipResponse(tip_mm=service.to_start(who, job, start_mm).tip_mm)

    @routes.get("/jobs/{job}/record", tags=["jobs"], summary="What is written down")
    def record(job: Job) -> PrintRecord:
        service.job(job)
        return service.record(job)

    @routes.patch("/jobs/{job}/record", tags=["jobs"], summary="Write down; changes are kept")
    def write_down(job: Job, given: dict[str, Any], who: Who) -> PrintRecord:
        return service.write_down(who, job, given)


def _prints(routes: APIRouter, service: JobService) -> None:
    tags: Final = ["prints"]

    @routes.get("/prints", tags=[*tags], summary="Prints that were started, as they stand")
    def prints() -> list[m.PrintResponse]:
        reports = (service.heard(one.id) for one in service.jobs())
        return [print_response(one) for one in reports if one is not None]

    @routes.post("/prints/{job}/start", tags=[*tags], summary="Start; harmless when it goes on")
    def start(job: Job, given: m.StartRequest, who: Who) -> m.PrintResponse:
        set_up = given.set_up or service.set_up(job)
        return print_response(service.start(who, job, set_up, given.confirmed))

    @routes.get("/prints/{job}", tags=[*tags], summary="State and progress")
    def status(job: Job) -> m.PrintResponse:
        reports = service.heard(job)
        if reports is None:
            raise NotFoundError(f"no print of {job} was ever started")
        return print_response(reports)

    @routes.get("/prints/{job}/viability", tags=[*tags], summary="The clock of the cells")
    def viability(job: Job) -> m.ViabilityResponse:
        return m.ViabilityResponse.model_validate(service.viability(job).to_dict())

    @routes.post("/prints/{job}/pause", tags=[*tags], summary="Hold, now or at a mark")
    def pause(job: Job, given: m.PauseRequest, who: Who) -> m.StatusResponse:
        return status_response(service.hands.pause(who, job, given.after))

    @routes.post("/prints/{job}/resume", tags=[*tags], summary="Go on, with a new syringe's data")
    def resume(job: Job, given: m.ResumeRequest, who: Who) -> m.StatusResponse:
        return status_response(service.hands.resume(who, job, **given.model_dump()))

    @routes.post("/prints/{job}/reload", tags=[*tags], summary="Make room to change the syringe")
    def reload(job: Job, given: m.ReloadRequest, who: Who) -> m.StatusResponse:
        return status_response(service.hands.reload(who, job, given.head))

    @routes.post("/prints/{job}/alive", tags=[*tags], summary="Somebody is there")
    def alive(job: Job, who: Who) -> m.StatusResponse:
        return status_response(service.hands.alive(who, job))

    @routes.post("/prints/{job}/cancel", tags=[*tags], summary="Controlled stop; for everybody")
    def cancel(job: Job) -> m.StatusResponse:
        return status_response(service.hands.cancel(job))


def _broken_off(routes: APIRouter, service: JobService) -> None:
    """After the print's process, its port or the power was lost."""
    tags: Final = ["prints"]

    @routes.post("/prints/{job}/go-on", tags=[*tags], summary="Go on after a print broke off")
    def go_on(job: Job, who: Who) -> m.StatusResponse:
        return status_response(service.hands.go_on(who, job))

    @routes.get("/prints/{job}/recovery", tags=[*tags], summary="Plan the rest; nothing is written")
    def recovery(job: Job, from_line: FromLine = None) -> m.RecoveryResponse:
        plan = service.hands.recovery(job, from_line)
        return m.RecoveryResponse(
            lines_left_out=plan.begin, steps=list(plan.steps), start_mm=plan.start
        )

    @routes.post("/prints/{job}/recover", tags=[*tags], summary="Write the rest as a job")
    def recover(job: Job, given: m.RecoverRequest, who: Who) -> m.RestResponse:
        return m.RestResponse.model_validate(service.hands.recover(who, job, given.from_line))

    @routes.post("/prints/{job}/give-up", tags=[*tags], summary="Don't go on; write its end down")
    def give_up(job: Job, who: Who) -> m.StatusResponse:
        return status_response(service.hands.give_up(who, job))


def _after(routes: APIRouter, service: JobService) -> None:
    after, tags = service.after, ["after a print"]

    @routes.get("/prints/{job}/steps", tags=[*tags], summary="Steps after the print")
    def steps(job: Job) -> list[m.StepResponse]:
        return [m.StepResponse.model_validate(one) for one in after.steps(job)]

    @routes.put("/prints/{job}/steps/{step}", tags=[*tags], summary="Tick a step, or take it back")
    def tick(job: Job, step: str, given: m.TickRequest, who: Who) -> list[m.StepResponse]:
        return [
            m.StepResponse.model_validate(one) for one in after.tick(who, job, step, given.done)
        ]

    @routes.get("/prints/{job}/notes", tags=[*tags], summary="Notes")
    def notes(job: Job) -> list[m.NoteResponse]:
        return [m.NoteResponse.model_validate(one) for one in after.notes(job)]

    @routes.post("/prints/{job}/notes", tags=[*tags], summary="Add a note")
    def note(job: Job, given: m.NoteRequest, who: Who) -> list[m.NoteResponse]:
        return [m.NoteResponse.model_validate(one) for one in after.note(who, job, given.text)]

    @routes.get("/prints/{job}/photos", tags=[*tags], summary="Photos")
    def photos(job: Job) -> list[m.PhotoResponse]:
        return [m.PhotoResponse.model_validate(one) for one in after.photos(job)]

    @routes.post("/prints/{job}/photos", tags=[*tags], summary="Add a photo; it is written anew")
    def add_photo(job: Job, file: Annotated[UploadFile, File()], who: Who) -> list[m.PhotoResponse]:
        photo = after.add_photo(who, job, file.file.read(MOST_BYTES + 1))
        return [m.PhotoResponse.model_validate(one) for one in photo]

    @routes.get(
        "/prints/{job}/photos/{name}",
        tags=[*tags],
        summary="A photo",
        response_class=FileResponse,
        responses={200: {"content": {"image/jpeg": {}}}},
    )
    def photo(job: Job, name: str) -> FileResponse:
        return FileResponse(after.photo(job, name), media_type="image/jpeg")

    @routes.get("/prints/{job}/flush", tags=[*tags], summary="How hard to flush; null if unknown")
    def flush(job: Job, wall_shear_pa: float | None = None) -> m.FlushResponse | None:
        photo = after.flush(job, wall_shear_pa)
        return None if photo is None else m.FlushResponse.model_validate(photo.to_dict())

    @routes.post("/melt-out", tags=[*tags], summary="Warm a heater at a rate")
    def melt_out(given: m.RampRequest, who: Who) -> m.RampResponse:
        return m.RampResponse.model_validate(after.melt_out(who, **given.model_dump()))

    @routes.get("/melt-out", tags=[*tags], summary="The warming as it stands; null for none")
    def melting() -> m.RampResponse | None:
        photo = after.melting()
        return None if photo is None else m.RampResponse.model_validate(photo)

    @routes.delete("/melt-out", tags=[*tags], summary="Raise the target no further")
    def stop_melting() -> m.RampResponse | None:
        photo = after.stop_melting()
        return None if photo is None else m.RampResponse.model_validate(photo)


def machine_response(machine: Machine | None) -> m.MachineResponse | None:
    """The printer, as the API tells it."""
    if machine is None:
        return None
    return m.MachineResponse.model_validate(asdict(machine) | {"words": machine.words})


def print_response(heard: PrintReport) -> m.PrintResponse:
    """A print, as the API tells it."""
    return m.PrintResponse.model_validate(heard.to_dict())


def status_response(status: Status) -> m.StatusResponse:
    """A status, as the API tells it."""
    return m.StatusResponse.model_validate(status.to_dict())
