"""REST types of the Scan page: scan list, volume, metadata overrides, registration, findings."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, Field

from printctl.web.scan.findings import VesselFinding
from printctl.web.scan.slices import OpenScan
from registration.files.readers import ScanOverrides

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
