"""REST of scans, and of their registration with designs."""

from __future__ import annotations

from fastapi import APIRouter, Response, UploadFile
from pydantic import Field
from starlette.responses import FileResponse, HTMLResponse

from printctl.run_folder.artefacts import HTML
from printctl.web.design.routes import Theme, embedded
from printctl.web.design.runs import ARTEFACTS, RunProgress
from printctl.web.errors import BadRequestError, NotFoundError
from printctl.web.rest import API, REFUSALS, Body
from printctl.web.scan.findings import Findings, findings
from printctl.web.scan.service import ScanNeeds, ScanService
from printctl.web.scan.slices import Axis, Volume, slice_png
from printctl.web.scan.store import ScanMetadata, ScanRow


class RegisterRequest(Body):
    """How a scan is registered."""

    filled: bool = Field(default=False, description="Lumens are brighter than the gel.")


def router(service: ScanService) -> APIRouter:
    """Routes below ``/api/v1/scans``."""
    routes = APIRouter(prefix=f"{API}/scans", tags=["scans"], responses=REFUSALS)
    _add_scans(routes, service)
    _add_registrations(routes, service)
    return routes


def _add_scans(routes: APIRouter, service: ScanService) -> None:
    store = service.store

    @routes.get("", summary="All scans, the newest first")
    def every() -> list[ScanRow]:
        return store.rows()

    @routes.get("/unusable", summary="Files that aren't listed, for their names")
    def unusable() -> list[str]:
        return service.core.workspace.unusable_names("scans/*")

    @routes.post("", summary="Take in a scan; a zip of slices is unpacked", status_code=201)
    def take(file: UploadFile) -> ScanRow:
        scan = store.take(file.filename or "", file.file)
        return store.row(scan, store.path(scan))

    @routes.get("/{scan}", summary="What is known of a scan's volume")
    def volume(scan: str) -> Volume:
        return service.volume(scan)

    @routes.get("/{scan}/said", summary="What was said of a scan, and what its file doesn't say")
    def needs(scan: str) -> ScanNeeds:
        return service.needs(scan)

    @routes.put("/{scan}/said", summary="Say of a scan what its file doesn't: voxel size and kin")
    def say(scan: str, given: ScanMetadata) -> Volume:
        store.say(scan, given)  # kept even where it can't be read yet
        return service.volume(scan)

    @routes.delete("/{scan}", summary="Throw an uploaded scan away", status_code=204)
    def delete(scan: str) -> None:
        store.delete(scan)

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
        service.volume(scan)
        data = slice_png(store.path(scan), axis, index, window, threshold)
        return Response(data, media_type="image/png", headers={"Cache-Control": "max-age=60"})


def _add_registrations(routes: APIRouter, service: ScanService) -> None:
    @routes.post("/{scan}/with/{run}/start", summary="Register a scan with a run's design")
    def start(scan: str, run: str, given: RegisterRequest) -> RunProgress:
        return service.register(scan, run, given.filled)

    @routes.post("/{scan}/with/{run}/cancel", summary="Stop a registration")
    def cancel(scan: str, run: str) -> RunProgress:
        return service.cancel(scan, run)

    @routes.get("/{scan}/with/{run}/progress", summary="How far a registration is")
    def progress(scan: str, run: str) -> RunProgress:
        return service.progress(scan, run)

    @routes.get("/{scan}/with/{run}/findings", summary="Alignment, vessels, verdict")
    def found(scan: str, run: str) -> Findings:
        return findings(service.folder(scan, run))

    @routes.get("/{scan}/with/{run}/files", summary="Files that can be fetched")
    def files(scan: str, run: str) -> list[str]:
        folder = service.folder(scan, run)
        return [name for name in ARTEFACTS if name != "recipe.yaml" and (folder / name).is_file()]

    @routes.get("/{scan}/with/{run}/files/{file}", summary="A file", response_class=FileResponse)
    def file(scan: str, run: str, file: str) -> FileResponse:
        if file not in files(scan, run):
            raise NotFoundError(f"the registration has no file {file[:80]!r} that can be fetched")
        path = service.folder(scan, run) / file
        return FileResponse(path, media_type=ARTEFACTS[file], filename=f"{run}_{file}")

    @routes.get("/{scan}/with/{run}/report", summary="The report", response_class=HTMLResponse)
    def report(scan: str, run: str, theme: Theme = "system") -> HTMLResponse:
        path = service.folder(scan, run) / HTML
        if not path.is_file():
            raise NotFoundError(f"{scan} isn't registered with {run} yet")
        return embedded(path, theme)
