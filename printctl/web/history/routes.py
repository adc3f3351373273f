"""REST of past prints: lists, records, bundles, repeats."""

from __future__ import annotations

from collections.abc import Callable
from datetime import date
from typing import Annotated, Literal

from fastapi import APIRouter, Depends, File, Path, Query, UploadFile
from fastapi.responses import FileResponse, PlainTextResponse, StreamingResponse
from starlette.background import BackgroundTask

from printctl.errors import UsageError
from printctl.history.signing import BundleError
from printctl.history.table import day_begins, day_ends
from printctl.machine.link.history_query import MOST, PAGE, HistoryQuery, SortBy
from printctl.web.errors import BadRequestError, ConflictError
from printctl.web.history.service import (
    Choices,
    HistoryService,
    NewJob,
    PastPrintDetails,
    PrintsPage,
    Repetition,
    Verification,
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
    return HistoryQuery(
        words=words,
        states=tuple(state or ()),
        profile=profile,
        who=who,
        since=_begins(since),
        until=_ends(until),
        sort=sort,
        descending=descending,
        limit=limit,
        offset=offset,
    )


Asked = Annotated[HistoryQuery, Depends(history_query)]
Here = Annotated[bool, Query(description="only prints of this workspace")]


def router(service: HistoryService) -> APIRouter:
    """Make the history's part of the API."""
    made = APIRouter(prefix=f"{API}/history", tags=["history"], responses=REFUSALS)
    _lists(made, service)
    _records(made, service)
    _one(made, service)
    return made


def _lists(made: APIRouter, service: HistoryService) -> None:
    @made.get("", summary="Past prints, a page of them")
    def prints(query: Asked, here: Here = False) -> PrintsPage:
        return service.listed(service.here(query) if here else query)

    @made.get("/choices", summary="Profiles, operators and ends that there are")
    def choices(here: Here = False) -> Choices:
        return service.choices(here)

    @made.get(
        "/csv",
        summary="Past prints as CSV, all pages, safe to open in a spreadsheet",
        response_class=StreamingResponse,
        responses={200: {"content": {"text/csv": {}}}},
    )
    def table(query: Asked, here: Here = False) -> StreamingResponse:
        head = {"Content-Disposition": 'attachment; filename="prints.csv"'}
        lines = service.csv(service.here(query) if here else query)
        return StreamingResponse(lines, headers=head, media_type="text/csv")


def _records(made: APIRouter, service: HistoryService) -> None:
    @made.get(
        "/key",
        summary="The lab's public key (PEM)",
        response_class=PlainTextResponse,
        responses={200: {"content": {"application/x-pem-file": {}}}},
    )
    def key() -> PlainTextResponse:
        head = {"Content-Disposition": 'attachment; filename="lab_key.pem"'}
        pem = service.public_key().pem()
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
        return service.verify(bundle.file, pem)


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
        try:
            path = service.bundle(print_id)
        except BundleError as exc:
            raise ConflictError(str(exc)) from exc
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
        path = service.report(print_id, kind)
        return FileResponse(path, media_type=_MEDIA[kind], headers=_ALONE)

    @made.get(
        "/{print_id}/photos/{name}",
        summary="A photo that the operator took",
        response_class=FileResponse,
        responses={200: {"content": {"image/jpeg": {}, "image/png": {}}}},
    )
    def photo(print_id: PrintId, name: Photo) -> FileResponse:
        path, media = service.photo(print_id, name)
        return FileResponse(path, media_type=media)

    @made.get("/{print_id}/repeat", summary="What differs today from when it was printed")
    def plan(print_id: PrintId) -> Repetition:
        return service.repetition(print_id)

    @made.post("/{print_id}/repeat", summary="Make a job of the same bytes; nothing is started")
    def repeat(print_id: PrintId) -> NewJob:
        return service.repeat(print_id)


def _begins(day: date | None) -> float:
    return _in_range(day_begins, day)


def _ends(day: date | None) -> float:
    return _in_range(day_ends, day)


def _in_range(read: Callable[[str, str], float], day: date | None) -> float:
    try:
        return read(str(day), "day") if day else 0.0
    except UsageError as exc:
        raise BadRequestError(str(exc)) from exc
