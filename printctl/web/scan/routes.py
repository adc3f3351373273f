"""REST routes for scans: upload, describe, slices, registration with a run, findings, report."""

from __future__ import annotations

from fastapi import APIRouter, Response, UploadFile
from starlette.responses import FileResponse, HTMLResponse

from printctl.web.design.answers import REFUSALS, ProgressAnswer
from printctl.web.design.embedded import Theme, embedded
from printctl.web.design.service import ARTEFACTS
from printctl.web.errors import BadRequestError
from printctl.web.scan import answers as a
from printctl.web.scan.service import ScanService
from printctl.web.scan.slices import Axis

_PIECE = 1 << 20


def router(service: ScanService) -> APIRouter:
    """Routes below ``/api/v1/scans``."""
    routes = APIRouter(prefix="/api/v1/scans", tags=["scans"], responses=REFUSALS)
    _add_scans(routes, service)
    _add_registrations(routes, service)
    return routes


def _add_scans(routes: APIRouter, service: ScanService) -> None:
    @routes.get("", summary="All scans, the newest first")
    def every() -> list[a.ScanAnswer]:
        return [a.ScanAnswer(**vars(row)) for row in service.store.rows()]

    @routes.post("", summary="Take in a scan; a zip of slices is unpacked", status_code=201)
    def take(file: UploadFile) -> a.ScanName:
        return a.ScanName(scan=service.store.take(file.filename or "", file.file))

    @routes.get("/{scan}", summary="What is known of a scan's volume")
    def volume(scan: str) -> a.VolumeAnswer:
        return a.VolumeAnswer.of(service.opened(scan))

    @routes.put("/{scan}/said", summary="Say of a scan what its file doesn't: voxel size and kin")
    def say(scan: str, given: a.ScanMetadataRequest) -> a.VolumeAnswer:
        service.store.say(scan, given.overrides())
        return a.VolumeAnswer.of(service.opened(scan))

    @routes.delete("/{scan}", summary="Throw an uploaded scan away", status_code=204)
    def delete(scan: str) -> None:
        service.store.delete(scan)

    @routes.get(
        "/{scan}/slices/{axis}/{index}",
        summary="A slice as a PNG picture",
        response_class=Response,
        responses={200: {"content": {"image/png": {}}}},
    )
    def one_slice(
        scan: str,
        axis: Axis,
        index: int,
        low: float | None = None,
        high: float | None = None,
        threshold: float | None = None,
    ) -> Response:
        if (low is None) != (high is None):
            raise BadRequestError("a window has low and high; give both, or neither")
        window = None if low is None or high is None else (low, high)
        service.opened(scan)
        data = service.slices.png(service.store.path(scan), axis, index, window, threshold)
        return Response(data, media_type="image/png", headers={"Cache-Control": "max-age=60"})


def _add_registrations(routes: APIRouter, service: ScanService) -> None:
    @routes.post("/{scan}/with/{run}/start", summary="Register a scan with a run's design")
    def start(scan: str, run: str, given: a.RegisterRequest) -> ProgressAnswer:
        return ProgressAnswer.of(service.register(scan, run, given.filled))

    @routes.post("/{scan}/with/{run}/cancel", summary="Stop a registration")
    def cancel(scan: str, run: str) -> ProgressAnswer:
        return ProgressAnswer.of(service.cancel(scan, run))

    @routes.get("/{scan}/with/{run}/progress", summary="How far a registration is")
    def progress(scan: str, run: str) -> ProgressAnswer:
        return ProgressAnswer.of(service.progress(scan, run))

    @routes.get("/{scan}/with/{run}/findings", summary="Alignment, vessels, verdict")
    def found(scan: str, run: str) -> a.FindingsAnswer:
        it = service.findings(scan, run)
        return a.FindingsAnswer(
            passed=it.passed,
            undecided=it.outcome == "undecided",
            reasons=list(it.reasons),
            alignment=[a.PairAnswer(name=name, value=value) for name, value in it.alignment],
            vessels=list(it.vessels),
        )

    @routes.get("/{scan}/with/{run}/files", summary="Files that can be fetched")
    def files(scan: str, run: str) -> list[str]:
        return service.files(scan, run)

    @routes.get("/{scan}/with/{run}/files/{file}", summary="A file", response_class=FileResponse)
    def file(scan: str, run: str, file: str) -> FileResponse:
        path = service.file(scan, run, file)
        return FileResponse(path, media_type=ARTEFACTS[file], filename=f"{run}_{file}")

    @routes.get("/{scan}/with/{run}/report", summary="The report", response_class=HTMLResponse)
    def report(scan: str, run: str, theme: Theme = "system") -> HTMLResponse:
        return embedded(service.report(scan, run), theme)
