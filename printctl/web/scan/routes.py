"""REST of scans: models of the answers, and routes."""

from __future__ import annotations

from typing import Literal

from fastapi import APIRouter, Response, UploadFile
from pydantic import BaseModel, Field
from starlette.responses import FileResponse, HTMLResponse

from printctl.web.design.routes import REFUSALS, ProgressAnswer, Theme, embedded
from printctl.web.design.service import ARTEFACTS
from printctl.web.errors import BadRequestError
from printctl.web.scan.findings import VesselFinding
from printctl.web.scan.service import ScanService
from printctl.web.scan.slices import Axis, OpenScan
from registration.files.readers import ScanOverrides

# REST types of the Scan page: scan list, volume, metadata overrides, registration, findings.

Micrometres = float


class ScanAnswer(BaseModel):
    """A scan of the workspace."""

    scan: str = Field(description="file~NAME, or run~NAME for a run's own.")
    megabytes: float
    modified: float = Field(description="Seconds since 1970.")


class ScanName(BaseModel):
    """A scan."""

    scan: str


class VolumeAnswer(BaseModel):
    """What is known of a scan's volume."""

    shape: list[int] = Field(description="Voxels along x, y, z.")
    voxel_um: list[float] = Field(description="Along x, y, z; geometric.")
    size_mm: list[float] = Field(description="Along x, y, z.")
    modality: str
    low: float = Field(description="Of the intensity: the window to begin with.")
    high: float
    threshold: float = Field(description="Between the two classes of voxels (Otsu).")

    @classmethod
    def of(cls, opened: OpenScan) -> VolumeAnswer:
        """Of a scan that was read."""
        dz, dy, dx = opened.scan.geometric_voxel_mm
        return cls(
            shape=list(opened.scan.volume.shape[::-1]),
            voxel_um=[dx * 1e3, dy * 1e3, dz * 1e3],
            size_mm=list(opened.size_mm),
            modality=str(opened.scan.modality),
            low=opened.low,
            high=opened.high,
            threshold=opened.threshold,
        )


class ScanMetadataRequest(BaseModel):
    """What the user says of a scan where its file doesn't."""

    voxel_um: tuple[Micrometres, Micrometres, Micrometres] | None = Field(
        default=None, description="Along x, y, z."
    )
    refractive_index: float | None = Field(default=None, ge=1, le=2)
    optical_depth: bool | None = None
    scale: Literal["linear", "db"] | None = None
    modality: Literal["oct", "microct", "confocal"] | None = None
    depth_down: bool | None = None
    axes: str | None = Field(default=None, pattern="^[xyz]{3}$")
    mirrored: bool | None = None
    db_range: tuple[float, float] | None = Field(
        default=None, description="dB of the lowest and the highest count."
    )
    count_range: tuple[float, float] | None = Field(
        default=None, description="Counts that mean db_range."
    )
    counts_per_db: float | None = Field(default=None, gt=0)
    db_at_zero: float | None = None

    def overrides(self) -> ScanOverrides:
        """In the readers' words."""
        size = self.voxel_um
        given = self.model_dump(exclude={"voxel_um"})
        voxel = None if size is None else (size[2] * 1e-3, size[1] * 1e-3, size[0] * 1e-3)
        return ScanOverrides(voxel_mm=voxel, **given)


class RegisterRequest(BaseModel):
    """How a scan is registered."""

    filled: bool = Field(default=False, description="Lumens are brighter than the gel.")


class PairAnswer(BaseModel):
    """Something and how much."""

    name: str
    value: str


class FindingsAnswer(BaseModel):
    """What a registration found."""

    passed: bool | None
    undecided: bool
    reasons: list[str]
    alignment: list[PairAnswer]
    vessels: list[VesselFinding]


_PIECE = 1 << 20


def router(service: ScanService) -> APIRouter:
    """Routes below ``/api/v1/scans``."""
    routes = APIRouter(prefix="/api/v1/scans", tags=["scans"], responses=REFUSALS)
    _add_scans(routes, service)
    _add_registrations(routes, service)
    return routes


def _add_scans(routes: APIRouter, service: ScanService) -> None:
    @routes.get("", summary="All scans, the newest first")
    def every() -> list[ScanAnswer]:
        return [ScanAnswer(**vars(row)) for row in service.store.rows()]

    @routes.post("", summary="Take in a scan; a zip of slices is unpacked", status_code=201)
    def take(file: UploadFile) -> ScanName:
        return ScanName(scan=service.store.take(file.filename or "", file.file))

    @routes.get("/{scan}", summary="What is known of a scan's volume")
    def volume(scan: str) -> VolumeAnswer:
        return VolumeAnswer.of(service.opened(scan))

    @routes.put("/{scan}/said", summary="Say of a scan what its file doesn't: voxel size and kin")
    def say(scan: str, given: ScanMetadataRequest) -> VolumeAnswer:
        service.store.say(scan, given.overrides())
        return VolumeAnswer.of(service.opened(scan))

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
    def start(scan: str, run: str, given: RegisterRequest) -> ProgressAnswer:
        return ProgressAnswer.of(service.register(scan, run, given.filled))

    @routes.post("/{scan}/with/{run}/cancel", summary="Stop a registration")
    def cancel(scan: str, run: str) -> ProgressAnswer:
        return ProgressAnswer.of(service.cancel(scan, run))

    @routes.get("/{scan}/with/{run}/progress", summary="How far a registration is")
    def progress(scan: str, run: str) -> ProgressAnswer:
        return ProgressAnswer.of(service.progress(scan, run))

    @routes.get("/{scan}/with/{run}/findings", summary="Alignment, vessels, verdict")
    def found(scan: str, run: str) -> FindingsAnswer:
        it = service.findings(scan, run)
        return FindingsAnswer(
            passed=it.passed,
            undecided=it.outcome == "undecided",
            reasons=list(it.reasons),
            alignment=[PairAnswer(name=name, value=value) for name, value in it.alignment],
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
