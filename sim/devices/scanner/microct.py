"""Simulated micro-CT of a print: melted-out lumens in gel, or a gel part in liquid.

Modelled
--------
- Embedded prints: the ink has been melted out. Its place is a lumen, darker (or, filled with
  contrast agent, brighter) than the gel, which fills the whole field of view.
- FRESH prints: the ink is the gel, and the support is melted out. Lumens and all around the part
  are liquid, as dark as lumens are; the gel is taken as stained, without which micro-CT hardly
  tells it from water.
- Partial volume and unsharpness (isotropic Gaussian), white noise (sum of four uniform numbers:
  close to normal, never beyond 3.5 standard deviations).
- Tilt, rotation, shift and shrinkage of the part.

Not modelled
------------
Projections and their reconstruction: no cone, ring, beam-hardening or motion artefacts, no
correlation of the noise. The container and the air around it lie outside the field.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

import numba
import numpy as np
from numpy.typing import NDArray

from gcode.deposit.lay import Deposit
from kernels import pjit
from kernels.arrays import FloatArray
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


@dataclass(frozen=True)
class MicroCtOptions:
    """The instrument and the sample.

    Attributes
    ----------
    voxel_mm : float, mm
        Edge of the cubic voxels.
    sigma_mm : float, mm
        Standard deviation of the point spread.
    gel_counts, lumen_counts : float
        Mean grey values.
    noise_counts : float
        Standard deviation of the noise.
    placing : Placing
        How the part lies.
    ink : "lumen" or "gel"
        What the deposited ink is by the time of the scan: melted out, or the part itself.
    """

    voxel_mm: float = 0.080
    sigma_mm: float = 0.050
    gel_counts: float = 20000.0
    lumen_counts: float = 8000.0
    noise_counts: float = 1500.0
    placing: Placing = field(
        default_factory=lambda: Placing(margin_mm=1.0, shift_mm=0.8, shrink=(0.99, 0.99, 0.99))
    )
    ink: Literal["lumen", "gel"] = "lumen"

    def __post_init__(self) -> None:
        check_range("voxel_mm", self.voxel_mm, 1e-3, 5.0, "mm")
        check_range("sigma_mm", self.sigma_mm, 0.0, 5.0, "mm")
        for name in ("gel_counts", "lumen_counts", "noise_counts"):
            check_range(name, getattr(self, name), 0.0, 65535.0, "counts")

    def shape(self, bounds_mm: FloatArray, seed: int) -> tuple[int, int, int]:
        """Voxels along z, y, x of a scan of what lies in a box (2, 3), mm."""
        _, field_mm = place(bounds_mm, self.placing, False, np.random.default_rng(seed))
        return voxel_counts(field_mm, (self.voxel_mm,) * 3)


def simulate_microct(deposit: Deposit, options: MicroCtOptions, seed: int) -> ScannerOutput:
    """Scan a deposit by simulated micro-CT.

    Same seed, same bytes, on any number of threads.

    Raises
    ------
    ScannerError
        When options are out of range (at their construction).
    """
    rng = np.random.default_rng(seed)
    pose, field_mm = place(deposit.bounds_mm, options.placing, False, rng)
    edge = deposit.voxel_mm
    sigma = options.sigma_mm / edge
    key = np.uint64(rng.integers(2**63))
    ink, pad = blurred(deposit.volume, (sigma, sigma, sigma))
    volume = _render(
        ink,
        index_map(pose, deposit.origin_mm - pad * edge, edge),
        options.voxel_mm,
        voxel_counts(field_mm, (options.voxel_mm,) * 3),
        np.array([*_counts(options), options.noise_counts]),
        key,
    )
    return ScannerOutput(
        volume=volume,
        voxel_mm=(options.voxel_mm,) * 3,
        refractive_index=1.0,
        optical_depth=False,
        modality="microct",
        depth_down=False,
        pose_truth=pose,
        shrink_truth=np.array(options.placing.shrink),
    )


def _counts(options: MicroCtOptions) -> tuple[float, float]:
    """Grey value around the ink, and that of ink."""
    gel, lumen = options.gel_counts, options.lumen_counts
    return (gel, lumen) if options.ink == "lumen" else (lumen, gel)


@pjit
def _render(
    ink: NDArray[np.uint8],
    to_ink: FloatArray,
    voxel: float,
    shape: tuple[int, int, int],
    counts: FloatArray,
    key: np.uint64,
) -> NDArray[np.uint16]:
    nz, ny, nx = shape
    around, filled, noise = counts
    # A sum of four uniform 16-bit numbers has the variance 4 (65536² - 1) / 12.
    spread = noise / math.sqrt((65536.0**2 - 1.0) / 3.0)
    out = np.empty((nz, ny, nx), dtype=np.uint16)
    for z in numba.prange(nz):
        base = np.empty(3)
        for y in range(ny):
            for c in range(3):
                base[c] = (to_ink[c, 1] * y + to_ink[c, 2] * z) * voxel + to_ink[c, 3]
            for x in range(nx):
                at = x * voxel
                fill = lookup(
                    ink,
                    base[0] + to_ink[0, 0] * at,
                    base[1] + to_ink[1, 0] * at,
                    base[2] + to_ink[2, 0] * at,
                )
                bits = random_bits(key, np.uint64((z * ny + y) * nx + x))
                total = -131070.0
                for part in range(4):
                    total += float((bits >> np.uint64(16 * part)) & np.uint64(0xFFFF))
                value = around + (filled - around) * fill / 255.0 + spread * total
                out[z, y, x] = np.uint16(min(65535.0, max(0.0, value + 0.5)))
    return out
