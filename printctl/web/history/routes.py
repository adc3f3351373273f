"""REST of past prints: models of the answers, and routes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from datetime import date
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, File, Path, Query, UploadFile
from fastapi.responses import FileResponse, PlainTextResponse, StreamingResponse
from pydantic import BaseModel, Field
from starlette.background import BackgroundTask

from printctl.errors import UsageError
from printctl.history.repeat import RepeatPlan
from printctl.history.signing import BundleError
from printctl.history.table import day_begins, day_ends, outcome
from printctl.history.verify import BundleCheck
from printctl.machine.link.history_entry import PrintEntry
from printctl.machine.link.history_query import MOST, PAGE, HistoryQuery, SortBy
from printctl.web.api import API, REFUSALS
from printctl.web.errors import BadRequestError, ConflictError
from printctl.web.history.service import HistoryService, PastPrintDetails

# Request and response types of the print history's REST routes.


class AlarmResponse(BaseModel):
    """One alarm of a print."""

    at: float = Field(description="s since 1970; 0 where the journal doesn't say")
    text: str


class PastPrint(BaseModel):
    """One print as its journal tells it."""

    id: str
    file: str = Field(description="name of the G-code file")
    sha256: str = Field(description="of the G-code file")
    profile: str = Field(description="printer profile")
    port: str
    operator: str = Field(description="as the print's record names them; may be empty")
    who: str = Field(description="user of the computer")
    host: str
    started: float = Field(description="s since 1970")
    ended: float = Field(description="s since 1970; 0 for not yet")
    state: str = Field(
        description="done, stopped, failed, killed, position_unknown, interrupted or running"
    )
    message: str
    error: str
    done: int = Field(description="command lines that the printer took")
    total: int = Field(description="command lines in the job")
    begun: int = Field(description="how often it was begun or gone on with")
    alarms: list[AlarmResponse]

    @classmethod
    def of(cls, entry: PrintEntry) -> PastPrint:
        """Without where its files lie."""
        values = asdict(entry)
        return cls(**{name: values[name] for name in cls.model_fields})


class PrintsPage(BaseModel):
    """Some of the prints that were asked for."""

    prints: list[PastPrint]
    total: int = Field(description="on all pages")
    offset: int


class EventResponse(BaseModel):
    """Something that happened in a print."""

    at: float = Field(description="s since 1970; 0 where the journal doesn't say")
    after_s: float = Field(description="since the print began")
    kind: str
    text: str


class StateInterval(BaseModel):
    """A time in one state, s since the print began."""

    state: str
    start_s: float
    end_s: float


class WholePrint(BaseModel):
    """One print with all that there is of it."""

    print: PastPrint
    verdict: Literal["pass", "fail", "undecided", ""] = Field(description="of the scan, if any")
    reasons: list[str]
    gcode_there: bool = Field(description="whether the bytes that were printed are still there")
    report: list[str] = Field(description="files of the report")
    photos: list[str]
    note: dict[str, Any] = Field(description="what the operator noted")
    missing: list[str] = Field(description="what isn't there any more, or is of another print")
    events: list[EventResponse]
    more_events: int
    states: list[StateInterval]

    @classmethod
    def of(cls, shown: PastPrintDetails) -> WholePrint:
        """What the service gave."""
        evidence, line = shown.found, shown.line
        reasons = (evidence.verdict or {}).get("reasons", ())
        return cls(
            print=PastPrint.of(shown.entry),
            verdict=outcome(evidence.verdict),
            reasons=[str(text) for text in reasons],
            gcode_there=evidence.gcode is not None,
            report=sorted(evidence.report),
            photos=[n.partition("/")[2] for n in evidence.noted if n.startswith("photos/")],
            note=evidence.note(),
            missing=list(evidence.missing),
            events=[EventResponse(**asdict(one)) for one in line.events] if line else [],
            more_events=line.more if line else 0,
            states=[StateInterval(**asdict(one)) for one in line.stretches] if line else [],
        )


class VerificationResponse(BaseModel):
    """What was found of a bundle."""

    whole: bool
    signature: str = Field(description="trusted, unknown key, wrong, unsigned or unchecked")
    fingerprint: str = Field(description="SHA-256 of the key that signed")
    changed: list[str]
    lines: list[str] = Field(description="the same for people")
    print_id: str
    file: str

    @classmethod
    def of(cls, check: BundleCheck) -> VerificationResponse:
        """What the service gave."""
        past = check.manifest.print if check.manifest and check.whole else None
        return cls(
            whole=check.whole,
            signature=check.signature.value,
            fingerprint=check.fingerprint,
            changed=list(check.changed),
            lines=check.lines(),
            print_id=past.id if past else "",
            file=past.file if past else "",
        )


class DifferenceResponse(BaseModel):
    """Something that isn't as it was when it was printed."""

    what: str
    then: str
    now: str


class RepeatResponse(BaseModel):
    """A print that can be, or was, made ready again."""

    sha256: str
    differences: list[DifferenceResponse]
    unknown: list[str] = Field(description="what nobody can tell whether it differs")
    set_up: dict[str, Any]

    @classmethod
    def of(cls, plan: RepeatPlan) -> RepeatResponse:
        """What the service gave."""
        return cls(
            sha256=plan.entry.sha256,
            differences=[DifferenceResponse(**asdict(one)) for one in plan.differences],
            unknown=list(plan.unknown),
            set_up=plan.set_up,
        )


class JobMade(BaseModel):
    """A job that is ready for the Job page."""

    job: str


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


def router(service: HistoryService) -> APIRouter:
    """Make the history's part of the API."""
    made = APIRouter(prefix=f"{API}/history", tags=["history"], responses=REFUSALS)
    _lists(made, service)
    _records(made, service)
    _one(made, service)
    return made


def _lists(made: APIRouter, service: HistoryService) -> None:
    @made.get("", summary="Past prints, a page of them")
    def prints(query: Annotated[HistoryQuery, Depends(history_query)]) -> PrintsPage:
        prints = service.find(query)
        past = [PastPrint.of(entry) for entry in prints.entries]
        return PrintsPage(prints=past, total=prints.total, offset=query.offset)

    @made.get(
        "/csv",
        summary="Past prints as CSV, all pages, safe to open in a spreadsheet",
        response_class=StreamingResponse,
        responses={200: {"content": {"text/csv": {}}}},
    )
    def table(query: Annotated[HistoryQuery, Depends(history_query)]) -> StreamingResponse:
        head = {"Content-Disposition": 'attachment; filename="prints.csv"'}
        return StreamingResponse(service.csv(query), headers=head, media_type="text/csv")


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
    ) -> VerificationResponse:
        pem = key.file.read(_KEY_BYTES + 1) if key is not None else b""
        if len(pem) > _KEY_BYTES:
            raise BadRequestError(f"the key has more than {_KEY_BYTES} bytes; it is no key")
        return VerificationResponse.of(service.verify(bundle.file, pem))


def _one(made: APIRouter, service: HistoryService) -> None:
    @made.get("/{print_id}", summary="One print with all that there is of it")
    def one(print_id: PrintId) -> WholePrint:
        return WholePrint.of(service.one(print_id))

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
    def plan(print_id: PrintId) -> RepeatResponse:
        return RepeatResponse.of(service.plan_repeat(print_id))

    @made.post("/{print_id}/repeat", summary="Make a job of the same bytes; nothing is started")
    def repeat(print_id: PrintId) -> JobMade:
        return JobMade(job=service.repeat(print_id))


def _begins(day: date | None) -> float:
    return _in_range(day_begins, day)


def _ends(day: date | None) -> float:
    return _in_range(day_ends, day)


def _in_range(read: Callable[[str, str], float], day: date | None) -> float:
    try:
        return read(str(day), "day") if day else 0.0
    except UsageError as exc:
        raise BadRequestError(str(exc)) from exc
