"""REST of past prints: lists, records, bundles, repeats."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import date
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, File, Path, Query, UploadFile
from fastapi.responses import FileResponse, PlainTextResponse, StreamingResponse
from starlette.background import BackgroundTask

from printctl.errors import UsageError
from printctl.history.index import PrintHistory
from printctl.history.query import MOST, PAGE, HistoryQuery, SortBy
from printctl.history.repeat import Difference, make_job, plan_repeat
from printctl.history.table import csv_lines, day_begins, day_ends
from printctl.machine.records.lab_key import lab_key
from printctl.pipeline.past.evidence import PHOTOS, evidence
from printctl.web.errors import BadRequestError, NotFoundError
from printctl.web.history.service import (
    PICTURES,
    HistoryService,
    PastPrintDetails,
    PrintsPage,
    Verification,
    verified,
)
from printctl.web.rest import API, REFUSALS

PrintId = Annotated[str, Path(pattern="^[0-9]{1,20}-[0-9a-f]{8}$", description="id of the print")]
Photo = Annotated[str, Path(pattern="^[A-Za-z0-9][A-Za-z0-9._-]{0,127}$")]
Line = Annotated[str, Query(max_length=200)]
_KEY_BYTES = 10_000
_MEDIA = {"html": "text/html", "json": "application/json", "pdf": "application/pdf"}
_ALONE = {
    # The report's scripts may run, but as a page of nobody: without our cookies and our API.
    "Content-Security-Policy": (
        "sandbox allow-scripts allow-downloads; default-src 'none'; img-src data: blob:; "
        "script-src 'unsafe-inline' 'unsafe-eval' data: blob:; style-src 'unsafe-inline'; "
        "font-src data:; connect-src data: blob:; worker-src blob:"
    )
}


def history_query(
    words: Line = "",
    state: Annotated[list[Line] | None, Query(max_length=10)] = None,
    profile: Line = "",
    who: Line = "",
    since: date | None = None,
    until: date | None = None,
    sort: SortBy = SortBy.STARTED,
    descending: bool = True,
    limit: Annotated[int, Query(ge=1, le=MOST)] = PAGE,
    offset: Annotated[int, Query(ge=0, le=10**9)] = 0,
) -> HistoryQuery:
    """Read what is asked for; days are the server's."""
    try:
        begins, ends = day_begins(str(since or ""), "day"), day_ends(str(until or ""), "day")
    except UsageError as exc:
        raise BadRequestError(str(exc)) from exc
    states = tuple(state or ())
    return HistoryQuery(words, states, profile, who, begins, ends, sort, descending, limit, offset)


@dataclass(frozen=True)
class Repetition:
    """What it would mean to print the same again, as in `RepeatPlan`."""

    sha256: str
    differences: tuple[Difference, ...]
    unknown: tuple[str, ...]
    set_up: dict[str, Any]


Asked = Annotated[HistoryQuery, Depends(history_query)]
Here = Annotated[bool, Query(description="only prints of this workspace")]


def router(service: HistoryService) -> APIRouter:
    """Make the history's part of the API."""
    made = APIRouter(prefix=f"{API}/history", tags=["history"], responses=REFUSALS)
    _lists(made, service)
    _records(made)
    _one(made, service)
    return made


def _lists(made: APIRouter, service: HistoryService) -> None:
    def narrowed(query: HistoryQuery, here: bool) -> HistoryQuery:
        return replace(query, within=service.folders) if here else query

    @made.get("", summary="Past prints, a page of them")
    def prints(query: Asked, here: Here = False) -> PrintsPage:
        return service.listed(narrowed(query, here))

    @made.get("/choices", summary="Profiles, operators and ends that there are")
    def choices(here: Here = False) -> dict[Literal["profiles", "people", "states"], list[str]]:
        history, within = PrintHistory(), service.folders if here else ()
        return {
            "profiles": history.known("profile", within),
            "people": history.known("who", within),
            "states": history.known("state", within),
        }

    @made.get(
        "/csv",
        summary="Past prints as CSV, all pages, safe to open in a spreadsheet",
        response_class=StreamingResponse,
        responses={200: {"content": {"text/csv": {}}}},
    )
    def table(query: Asked, here: Here = False) -> StreamingResponse:
        head = {"Content-Disposition": 'attachment; filename="prints.csv"'}
        every = replace(narrowed(query, here), limit=None, offset=0)
        lines = csv_lines(service.find(every).entries)
        return StreamingResponse(lines, headers=head, media_type="text/csv")


def _records(made: APIRouter) -> None:
    @made.get(
        "/key",
        summary="The lab's public key (PEM)",
        response_class=PlainTextResponse,
        responses={200: {"content": {"application/x-pem-file": {}}}},
    )
    def key() -> PlainTextResponse:
        head = {"Content-Disposition": 'attachment; filename="lab_key.pem"'}
        pem = lab_key().public.pem()
        return PlainTextResponse(pem, headers=head, media_type="application/x-pem-file")

    @made.post("/verify", summary="Tell whether a bundle is as it was filed, and who signed it")
    def verify(
        bundle: Annotated[UploadFile, File(description="the zip; it isn't unpacked or kept")],
        key: Annotated[
            UploadFile | None, File(description="public key (PEM) to trust; else this lab's own")
        ] = None,
    ) -> Verification:
        pem = key.file.read(_KEY_BYTES + 1) if key is not None else b""
        if len(pem) > _KEY_BYTES:
            raise BadRequestError(f"the key has more than {_KEY_BYTES} bytes; it is no key")
        return verified(bundle.file, pem)


def _one(made: APIRouter, service: HistoryService) -> None:
    @made.get("/{print_id}", summary="One print with all that there is of it")
    def one(print_id: PrintId) -> PastPrintDetails:
        return service.one(print_id)

    @made.get(
        "/{print_id}/bundle",
        summary="A print's signed bundle (zip)",
        response_class=FileResponse,
        responses={200: {"content": {"application/zip": {}}}},
    )
    def bundle(print_id: PrintId) -> FileResponse:
        path = service.bundle(print_id)
        return FileResponse(
            path,
            filename=f"print_{print_id}.zip",
            media_type="application/zip",
            background=BackgroundTask(path.unlink, missing_ok=True),
        )

    @made.get(
        "/{print_id}/report",
        summary="A print's report",
        response_class=FileResponse,
        responses={200: {"content": {media: {} for media in _MEDIA.values()}}},
    )
    def report(print_id: PrintId, kind: Literal["html", "json", "pdf"] = "html") -> FileResponse:
        path = evidence(service.entry(print_id)).report.get(f"report.{kind}")
        if path is None:
            raise NotFoundError(f"print {print_id} has no report as {kind.upper()}")
        return FileResponse(path, media_type=_MEDIA[kind], headers=_ALONE)

    @made.get(
        "/{print_id}/photos/{name}",
        summary="A photo that the operator took",
        response_class=FileResponse,
        responses={200: {"content": {"image/jpeg": {}, "image/png": {}}}},
    )
    def photo(print_id: PrintId, name: Photo) -> FileResponse:
        path = evidence(service.entry(print_id)).noted.get(f"{PHOTOS}/{name}")
        media = PICTURES.get(path.suffix.lower()) if path is not None else None
        if path is None or media is None:
            raise NotFoundError(f"print {print_id} has no such photo")
        return FileResponse(path, media_type=media)

    @made.get("/{print_id}/repeat", summary="What differs today from when it was printed")
    def plan(print_id: PrintId) -> Repetition:
        planned = plan_repeat(service.entry(print_id))
        sha256, unknown = planned.entry.sha256, planned.unknown
        return Repetition(sha256, planned.differences, unknown, planned.set_up)

    @made.post("/{print_id}/repeat", summary="Make a job of the same bytes; nothing is started")
    def repeat(print_id: PrintId) -> dict[Literal["job"], str]:
        planned = plan_repeat(service.entry(print_id))
        return {"job": f"file~{make_job(planned, service.workspace.root / 'jobs').name}"}
