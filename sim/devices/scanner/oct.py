"""Simulated optical coherence tomography of a print in liquid.

Modelled
--------
- Ink scatters; liquid outside and in the lumens is dark.
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

import numba
import numpy as np
from numpy.typing import NDArray

from kernels import pjit
from kernels.arrays import FloatArray
from sim.devices.scanner.output import ScannerOutput, check_range
from sim.devices.scanner.placing import Placing, place, voxel_counts
from sim.devices.scanner.sampling import blurred, index_map, lookup, random_bits
from sim.gcode.deposit.lay import Deposit


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

    def shape(self, bounds_mm: FloatArray, seed: int) -> tuple[int, int, int]:
        """Voxels along z, y, x of a scan of what lies in a box (2, 3), mm."""
        placed = place(bounds_mm, self.placing, True, np.random.default_rng(seed))
        return voxel_counts(placed.field_mm, self.geometric_voxel_mm)


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
    placed = place(deposit.bounds_mm, options.placing, True, rng)
    edge = deposit.voxel_mm
    ink, pad = blurred(deposit.volume, (options.axial_sigma_mm / edge, 0.0, 0.0))
    key = np.uint64(rng.integers(2**63))
    volume = _render(
        ink,
        index_map(placed.pose, deposit.origin_mm - pad * edge, edge),
        np.array([dz, dy, dx]),
        voxel_counts(placed.field_mm, voxel),
        np.array(
            [
                NOISE_COUNTS * 10 ** (options.signal_db / 10),
                options.attenuation_mm,
                options.roll_off_mm,
                options.reflection,
                NOISE_COUNTS,
                options.start_mm,
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
        scale="linear",
        modality="oct",
        depth_down=True,
        pose_truth=placed.pose,
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
    gel, attenuation, roll_off, reflection, noise, start = physics
    out = np.empty((nz, ny, nx), dtype=np.uint16)
    ax, ay, az = to_ink[0, 0] * dx, to_ink[1, 0] * dx, to_ink[2, 0] * dx
    for y in numba.prange(ny):
        depth = np.zeros((nx, 4))
        above = np.zeros((nx, 4))
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
