"""REST of scans, and of their registration with the designs of runs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from fastapi import APIRouter, Response, UploadFile
from pydantic import Field
from starlette.responses import FileResponse, HTMLResponse

from printctl.run_folder.artefacts import HTML, NETWORK, SOLID
from printctl.web.core import Core
from printctl.web.design.routes import Theme, embedded
from printctl.web.design.runs import RECIPE, Runs, artefact, artefacts
from printctl.web.detached_runs import RunProgress
from printctl.web.errors import BadRequestError, ConflictError, NotFoundError
from printctl.web.rest import API, REFUSALS, Body
from printctl.web.scan.findings import Findings, findings
from printctl.web.scan.slices import Axis, Volume, open_scan, slice_png
from printctl.web.scan.store import REGISTERED, ScanMetadata, ScanRow, ScanStore
from registration.errors import ScanFileError


class RegisterRequest(Body):
    """How a scan is registered."""

    filled: bool = Field(default=False, description="Lumens are brighter than the gel.")


@dataclass(frozen=True)
class ScanNeeds:
    """What a scan lacks before it can be shown, and what the user has said of it so far.

    ``missing`` is what its file doesn't say, as `ScanMetadata` names it; ``problem`` is why it
    can't be read, empty where it can.
    """

    missing: tuple[str, ...]
    problem: str
    said: ScanMetadata


class ScanService:
    """Scans of a workspace, and their registration with runs."""

    def __init__(self, core: Core, runs: Runs) -> None:
        self.workspace, self.runs = core.workspace, runs
        self.store = ScanStore(core.workspace, core.settings.upload_mb)
        self.processes = runs.processes

    def volume(self, scan: str) -> Volume:
        """Read a scan, and return what is known of its volume.

        Raises
        ------
        NotFoundError
        BadRequestError
            When it can't be read, or doesn't say what it must: voxel size and kin.
        """
        needs, volume = self._read(scan)
        if volume is None:
            raise BadRequestError(needs.problem)
        return volume

    def needs(self, scan: str) -> ScanNeeds:
        """Return what has to be said of a scan, and what was."""
        return self._read(scan)[0]

    def _read(self, scan: str) -> tuple[ScanNeeds, Volume | None]:
        path, said = self.store.path(scan), self.store.said(scan)
        try:
            return ScanNeeds((), "", said), open_scan(path)[1]
        except ScanFileError as exc:
            names = ("voxel_um" if name == "voxel_mm" else name for name in exc.missing)
            problem = str(exc)
            for folder in (self.store.folder, self.workspace.root):  # are nobody else's business
                problem = problem.replace(f"{folder}/", "")
            return ScanNeeds(tuple(names), problem, said), None

    def say(self, scan: str, given: ScanMetadata) -> Volume:
        """Keep what is said of a scan, even where it can't be read yet."""
        self.store.say(scan, given)
        return self.volume(scan)

    def register(self, scan: str, run: str, given: RegisterRequest) -> RunProgress:
        """Hold a scan against a run's design, in a process of its own."""
        if scan == f"run~{run}":
            raise ConflictError(
                f"this is run {run!r}'s own scan; continue the run, which registers it"
            )
        model, folder = self.runs.folder(run), self.folder(scan, run)
        missing = [name for name in (SOLID, NETWORK) if not (model / name).is_file()]
        if missing:
            raise ConflictError(f"run {run!r} has no {missing[0]} yet; make its design first")
        self.volume(scan)
        if self.processes.going_on(scan, folder):
            raise ConflictError(f"{scan} is being registered with {run}; wait, or cancel it")
        command = ["register", str(self.store.path(scan).resolve())]
        command += ["--model", str(model.resolve()), "--out", str(folder.resolve())]
        command += ["--filled"] if given.filled else []
        self.processes.spawn(folder, command, self.workspace.root)
        return self.progress(scan, run)

    def folder(self, scan: str, run: str) -> Path:
        """Where the registration of a scan with a run lies; a run's own in the run.

        Raises
        ------
        BadRequestError
            For a name that can't be used, or a link that leads out of the workspace.
        NotFoundError
        """
        self.store.path(scan)
        folder = self.runs.folder(run)
        if scan == f"run~{run}":
            return folder
        self.workspace.inside(folder / REGISTERED)
        return self.workspace.inside(folder / REGISTERED / scan)

    def progress(self, scan: str, run: str) -> RunProgress:
        """How far a registration is."""
        return self.processes.progress(f"{scan} with {run}", self.folder(scan, run))

    def cancel(self, scan: str, run: str) -> RunProgress:
        """Stop a registration."""
        if not self.processes.cancel(scan, self.folder(scan, run)):
            raise ConflictError(f"{scan} isn't being registered with {run}")
        return self.progress(scan, run)


def router(service: ScanService) -> APIRouter:
    """Routes below ``/api/v1/scans``."""
    routes = APIRouter(prefix=f"{API}/scans", tags=["scans"], responses=REFUSALS)
    store, said = service.store, "/{scan}/said"
    routes.get("", summary="All scans, the newest first")(store.rows)
    routes.get("/unusable", summary="Files that aren't listed, for their names")(store.unusable)
    routes.get("/{scan}", summary="What is known of a scan's volume")(service.volume)
    routes.get(said, summary="What was said of a scan, and what its file doesn't say")(
        service.needs
    )
    routes.put(said, summary="Say of a scan what its file doesn't: voxel size and kin")(service.say)
    routes.delete("/{scan}", summary="Throw an uploaded scan away", status_code=204)(store.delete)

    @routes.post("", summary="Take in a scan; a zip of slices is unpacked", status_code=201)
    def take(file: UploadFile) -> ScanRow:
        return store.row(store.take(file.filename or "", file.file))

    @routes.get(
        "/{scan}/slices/{axis}/{index}",
        summary="A slice as a PNG picture",
        response_class=Response,
        responses={200: {"content": {"image/png": {}}}},
    )
    def slice_of(
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

    _add_registrations(routes, service)
    return routes


def _add_registrations(routes: APIRouter, service: ScanService) -> None:
    way = "/{scan}/with/{run}"
    routes.post(f"{way}/start", summary="Register a scan with a run's design")(service.register)
    routes.post(f"{way}/cancel", summary="Stop a registration")(service.cancel)
    routes.get(f"{way}/progress", summary="How far a registration is")(service.progress)

    @routes.get(f"{way}/findings", summary="Alignment, vessels, verdict")
    def found(scan: str, run: str) -> Findings:
        return findings(service.folder(scan, run))

    @routes.get(f"{way}/files", summary="Files that can be fetched")
    def files(scan: str, run: str) -> list[str]:
        return [name for name in artefacts(service.folder(scan, run)) if name != RECIPE]

    @routes.get(f"{way}/files/{{file}}", summary="A file", response_class=FileResponse)
    def file(scan: str, run: str, file: str) -> FileResponse:
        return artefact(run, service.folder(scan, run), file)

    @routes.get(f"{way}/report", summary="The report", response_class=HTMLResponse)
    def report(scan: str, run: str, theme: Theme = "system") -> HTMLResponse:
        path = service.workspace.inside(service.folder(scan, run) / HTML)
        if not path.is_file():
            raise NotFoundError(f"{scan} isn't registered with {run} yet")
        return embedded(path, theme)
