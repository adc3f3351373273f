"""Simulated optical coherence tomography of a print in liquid.

Modelled
--------
- FRESH prints: the ink is the gel. It scatters; liquid outside and in the lumens is dark.
- Embedded prints: the ink has been melted out. Its place is dark, in gel that scatters and fills
  the whole field of view.
- Beer-Lambert attenuation straight down, so lumens throw brighter columns and deep gel fades.
- Point spread (Gaussian): lateral of the light that comes back, not of what scatters it (an A-scan
  half in gel, half in a lumen is the mean of a faded one and a dark one); axial of the scatterers,
  which is the same where light fades little within it.
- Roll-off of sensitivity with depth (Gaussian), a noise floor, speckle: the intensity of signal
  and noise together is exponentially distributed, averaged over `looks` independent looks.
- A reflection where the scattering changes along depth.
- Depth counted as optical path at one group index; tilt, rotation, shift and shrinkage of the
  part.

Not modelled
------------
Refraction (the part lies in liquid of its own index, so light goes straight), fan of the scan
field, multiple scattering, correlation of speckle between voxels, focus, motion between
B-scans, saturation streaks, autocorrelation and mirror artefacts, the dish below (it is black).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar, Final, Literal

import numba
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from gcode.deposit.lay import Deposit, Laid, deposit_of_laid
from gcode.errors import SimError
from kernels import pjit
from kernels.arrays import FloatArray
from sim.devices.recorded_ink import InkBox
from sim.devices.scanner.placing import (
    Placing,
    ScannerOutput,
    blurred,
    check_range,
    index_map,
    lookup,
    place,
    random_bits,
    voxel_counts,
)
from sim.errors import ScannerError


@dataclass(frozen=True)
class OctOptions:
    """The instrument and the sample.

    Attributes
    ----------
    voxel_mm : (dz, dy, dx), mm
        Sampling; dz is optical path.
    refractive_index : float
        Group index of gel and liquid.
    axial_sigma_mm, lateral_sigma_mm : float, mm
        Standard deviations of the point spread (geometric).
    attenuation_mm : float, 1/mm
        Of the gel.
    roll_off_mm : float, mm
        Geometric depth at which sensitivity has fallen to 1/e.
    signal_db : float, dB
        Gel at the surface over the noise floor.
    reflection : float
        Brightness of a full step from liquid to gel over that of the gel.
    looks : int
        Independent speckle patterns averaged.
    start_mm : float, mm
        Geometric depth at which the volume begins: sensitivity rolls off from where it would be 0.
    placing : Placing
        How the part lies.
    ink : "gel" or "lumen"
        What the deposited ink is by the time of the scan: the part itself, or melted out.
    """

    voxel_mm: tuple[float, float, float] = (0.020, 0.030, 0.030)
    refractive_index: float = 1.34
    axial_sigma_mm: float = 0.006
    lateral_sigma_mm: float = 0.012
    attenuation_mm: float = 0.7
    roll_off_mm: float = 6.0
    signal_db: float = 33.0
    reflection: float = 0.5
    looks: int = 3
    start_mm: float = 0.0
    placing: Placing = field(default_factory=Placing)
    ink: Literal["gel", "lumen"] = "gel"

    def __post_init__(self) -> None:
        for value in self.voxel_mm:
            check_range("voxel_mm", value, 1e-3, 1.0, "mm")
        check_range("refractive_index", self.refractive_index, 1.0, 2.0, "")
        check_range("attenuation_mm", self.attenuation_mm, 0.0, 50.0, "1/mm")
        check_range("roll_off_mm", self.roll_off_mm, 0.1, 1e3, "mm")
        check_range("signal_db", self.signal_db, 0.0, 38.0, "dB")
        check_range("looks", self.looks, 1, 64, "looks")
        check_range("start_mm", self.start_mm, 0.0, 1e3, "mm")

    @property
    def geometric_voxel_mm(self) -> tuple[float, float, float]:
        """Sampling (dz, dy, dx), dz geometric too."""
        dz, dy, dx = self.voxel_mm
        return dz / self.refractive_index, dy, dx

    @property
    def reach_mm(self) -> float:
        """Geometric depth in gel, from the field's top, at which gel is as bright as the noise."""
        faintest = np.log(10) * self.signal_db / 10
        slope, curve = 2 * self.attenuation_mm, self.roll_off_mm**-2
        # Light falls by 2 µ z + (z / z0)² nepers.
        return float((np.sqrt(slope**2 + 4 * curve * faintest) - slope) / (2 * curve))

    def shape(self, bounds_mm: FloatArray, seed: int) -> tuple[int, int, int]:
        """Voxels along z, y, x of a scan of what lies in a box (2, 3), mm."""
        _, field_mm = place(bounds_mm, self.placing, True, np.random.default_rng(seed))
        return voxel_counts(field_mm, self.geometric_voxel_mm)


NOISE_COUNTS = 8.0
"""Mean of the noise floor; the gel's surface then fits into 16 bits up to 38 dB."""


def simulate_oct(deposit: Deposit, options: OctOptions, seed: int) -> ScannerOutput:
    """Scan a deposit by simulated OCT; same seed, same bytes, on any number of threads.

    Raises
    ------
    ScannerError
        When options are out of range (at their construction).
    """
    rng = np.random.default_rng(seed)
    dz, dy, dx = voxel = options.geometric_voxel_mm
    pose, field_mm = place(deposit.bounds_mm, options.placing, True, rng)
    edge = deposit.voxel_mm
    ink, pad = blurred(deposit.volume, (options.axial_sigma_mm / edge, 0.0, 0.0))
    key = np.uint64(rng.integers(2**63))
    volume = _render(
        ink,
        index_map(pose, deposit.origin_mm - pad * edge, edge),
        np.array([dz, dy, dx]),
        voxel_counts(field_mm, voxel),
        np.array(
            [
                NOISE_COUNTS * 10 ** (options.signal_db / 10),
                options.attenuation_mm,
                options.roll_off_mm,
                options.reflection,
                NOISE_COUNTS,
                options.start_mm,
                0.0 if options.ink == "gel" else 1.0,
            ]
        ),
        options.lateral_sigma_mm,
        options.looks,
        key,
    )
    return ScannerOutput(
        volume=volume,
        voxel_mm=options.voxel_mm,
        refractive_index=options.refractive_index,
        optical_depth=True,
        modality="oct",
        depth_down=True,
        pose_truth=pose,
        shrink_truth=np.array(options.placing.shrink),
    )


@pjit
def _render(
    ink: NDArray[np.uint8],
    to_ink: FloatArray,
    voxel: FloatArray,
    shape: tuple[int, int, int],
    physics: FloatArray,
    lateral: float,
    looks: int,
    key: np.uint64,
) -> NDArray[np.uint16]:
    """One B-scan a thread: light runs down each A-scan. One kernel, for speed.

    An A-scan is the mean of four rays, one lateral standard deviation off to all sides: the
    two-point Gauss-Hermite rule in x and in y, exact for cubic brightness.
    """
    nz, ny, nx = shape
    dz, dy, dx = voxel
    gel, attenuation, roll_off, reflection, noise, start, around = physics
    out = np.empty((nz, ny, nx), dtype=np.uint16)
    ax, ay, az = to_ink[0, 0] * dx, to_ink[1, 0] * dx, to_ink[2, 0] * dx
    for y in numba.prange(ny):
        depth = np.zeros((nx, 4))
        above = np.full((nx, 4), around)
        base = np.empty((4, 3))
        for z in range(nz):
            for ray in range(4):
                aside = -lateral if ray % 2 == 0 else lateral
                along = y * dy + (-lateral if ray < 2 else lateral)
                for c in range(3):
                    base[ray, c] = (
                        to_ink[c, 0] * aside
                        + to_ink[c, 1] * along
                        + to_ink[c, 2] * z * dz
                        + to_ink[c, 3]
                    )
            sensitivity = 0.25 * gel * math.exp(-(((start + z * dz) / roll_off) ** 2))
            for x in range(nx):
                mean = noise
                for ray in range(4):
                    bx, by, bz = base[ray]
                    fill = lookup(ink, bx + x * ax, by + x * ay, bz + x * az) / 255.0
                    fill = abs(around - fill)
                    depth[x, ray] += 0.5 * fill * dz
                    step = abs(fill - above[x, ray])
                    if fill > 0.0 or step > 0.0:
                        light = math.exp(-2.0 * attenuation * depth[x, ray])
                        mean += sensitivity * light * (fill + reflection * step)
                    depth[x, ray] += 0.5 * fill * dz
                    above[x, ray] = fill
                product = 1.0
                counter = np.uint64(((z * ny + y) * nx + x) * looks)
                for look in range(looks):
                    bits = random_bits(key, counter + np.uint64(look))
                    product *= ((bits >> np.uint64(11)) + np.uint64(1)) * 2.0**-53
                value = -mean * math.log(product) / looks
                out[z, y, x] = np.uint16(min(65535.0, value + 0.5))
    return out


_FINEST_MM: Final = 0.02
_PER_VOXEL: Final = 0.625
"""The ink is laid somewhat finer than it is scanned, so that its own voxels don't show."""
_STILL: Final = Placing(0.0, 0.0, 0.0, 0.0, (1.0, 1.0, 1.0))
Micron = Annotated[float, Field(ge=1, le=1000)]
Region = tuple[FloatArray, FloatArray]


class OctField(InkBox):
    """OCT that looks straight down at a box of the printer's frame, and the ink's source.

    Attributes
    ----------
    low_mm, high_mm : (x, y, z), mm
        Corners of the box; the scan begins at its top.
    voxel_um : (x, y, z), µm
        z is optical path.
    refractive_index, attenuation_mm, signal_db, looks
        As of `sim.devices.scanner.oct.OctOptions`.
    """

    called: ClassVar[str] = "OCT file"
    error: ClassVar[type[SimError]] = ScannerError

    voxel_um: tuple[Micron, Micron, Micron] = (20, 20, 15)
    refractive_index: Annotated[float, Field(ge=1, le=2)] = 1.34
    attenuation_mm: Annotated[float, Field(ge=0, le=50)] = 0.7
    signal_db: Annotated[float, Field(ge=0, le=38)] = 33.0
    looks: Annotated[int, Field(ge=1, le=64)] = 3


def live_scan(ink: Laid, field: OctField, seed: int, region: Region | None = None) -> ScannerOutput:
    """Scan what lies in the field; a place of the printer is seen alike in every scan.

    Parameters
    ----------
    region : (low, high), each (3,), mm, optional
        Only what of the field lies in this box of the printer's frame is scanned. What lies above
        it dims nothing, so no ink should.

    Raises
    ------
    DepositError
        When the field is too large.
    ScannerError
        When the region lies outside the field.
    """
    dx, dy, dz = (value * 1e-3 for value in field.voxel_um)
    fine = max(_FINEST_MM, _PER_VOXEL * min(dx, dy, dz))
    low, high = _scanned(field, region)
    # The grid covers a voxel more all round than its box.
    box = np.array([low + fine, high - fine])
    options = OctOptions(
        voxel_mm=(dz, dy, dx),
        refractive_index=field.refractive_index,
        attenuation_mm=field.attenuation_mm,
        signal_db=field.signal_db,
        looks=field.looks,
        start_mm=float(field.high_mm[2] - high[2]),
        placing=_STILL,
    )
    return simulate_oct(deposit_of_laid(ink, fine, box), options, seed)


def _scanned(field: OctField, region: Region | None) -> Region:
    """Return the part of a field's box that is in a region, all of it without one."""
    low, high = np.array(field.low_mm), np.array(field.high_mm)
    if region is None:
        return low, high
    least, most = np.maximum(low, region[0]), np.minimum(high, region[1])
    if not (most - least > 4 * _FINEST_MM).all():
        raise ScannerError(
            f"the region {region[0].tolist()} to {region[1].tolist()} mm lies outside the OCT's "
            f"field, {low.tolist()} to {high.tolist()} mm"
        )
    return least, most


def write_live_scan(path: Path, scan: ScannerOutput) -> None:
    """Write a scan as .npz with what a scanner's file says, and ``printer_to_scan`` (4, 4)."""
    np.savez(
        path,
        volume=scan.volume,
        voxel_mm=np.array(scan.voxel_mm),
        refractive_index=scan.refractive_index,
        optical_depth=scan.optical_depth,
        scale=scan.scale,
        modality=scan.modality,
        depth_down=scan.depth_down,
        printer_to_scan=scan.pose_truth,
    )
