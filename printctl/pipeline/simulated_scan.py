"""Simulate the scan of a print: lay its ink in voxels, check the scan's size, scan it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np

from firmware_profiles import Printer
from gcode.deposit.ink_faults import NO_FAULTS, InkFaults
from gcode.deposit.lay import (
    EXACT_MM,
    Deposit,
    Style,
    deposit_of_heads,
    unite_deposits,
    valves_as_plungers,
)
from gcode.motion.executed import ExecutedMotion
from kernels.arrays import FloatArray
from printctl.errors import UsageError
from printctl.recipe.sections.measuring import SimulatedScan
from registration import Scan
from sim.devices.scanner.microct import MicroCtOptions, simulate_microct
from sim.devices.scanner.oct import OctOptions, simulate_oct
from sim.devices.scanner.placing import Placing, ScannerOutput

MAX_SCAN_MB: Final = 1000.0
"""A larger scan is made on request alone: registering one takes six times its size in memory."""
PROPOSED_SCAN_MB: Final = 200.0
VOXELS_ACROSS: Final = 8.0
LEAST_DEEPER: Final = 0.02
"""Share of the vessels beyond light's reach that is worth a note."""
_BYTES_PER_VOXEL: Final = 2
_FINEST_DEPOSIT_MM: Final = 0.02
_CT_BLUR_VOXELS: Final = 0.625
"""Standard deviation of a micro-CT's point spread: spot and detector are chosen to go with the
voxel, so that it resolves (FWHM) about one and a half."""
_DEPOSIT_PER_SCAN_VOXEL: Final = 0.625
"""The deposit is laid somewhat finer than it is scanned, so that its own voxels don't show."""


@dataclass(frozen=True)
class PrintedInk:
    """What the motors of a simulated printer did, and what was in its heads.

    Attributes
    ----------
    motion : ExecutedMotion
    printer : Printer
    area_mm2 : sequence of float, mm²
        Of each head: ink that leaves it for a plunger travel of 1 mm, µL/mm.
    flows_ul_s : sequence of float, µL/s
        Of each pneumatic head while its valve is open; none for plungers.
    gcode : bytes
        As it was sent; of pneumatic heads it says when their valves stood open.
    faults : InkFaults
    style : "layered" or "embedded" or None
        As the recipe or the job's map says it; None guesses it from the motion.
    layer_mm : float or None, mm
        Height of the lines of a print with a single layer.
    """

    motion: ExecutedMotion
    printer: Printer
    area_mm2: Sequence[float]
    flows_ul_s: Sequence[float] = ()
    gcode: bytes = b""
    faults: InkFaults = NO_FAULTS
    style: Style | None = None
    layer_mm: float | None = None

    @cached_property
    def of_tips(self) -> tuple[ExecutedMotion, ...]:
        """What each head did, in its own tip's places; air as a plunger of 1 mm² bore."""
        if self.flows_ul_s:
            return valves_as_plungers(self.motion, self.gcode, self.printer, self.flows_ul_s)
        heads = enumerate(self.printer.heads or ())
        motions = (self.motion.of_head(k, head.offset_mm.mm) for k, head in heads)
        return tuple(motions) or (self.motion,)

    @property
    def written_mm(self) -> FloatArray:
        """Lowest and highest place (2, 3), mm, at which a tip wrote; of all where none did."""
        chosen = self._written or self.of_tips
        both = np.concatenate([place for one in chosen for place in (one.start, one.end)])
        return np.array([both.min(axis=0), both.max(axis=0)])

    @property
    def is_layered(self) -> bool:
        """Whether layers were written; where nothing says it, whether all writing is level."""
        if self.style is not None:
            return self.style == "layered"
        return all(bool((one.start[:, 2] == one.end[:, 2]).all()) for one in self._written)

    @property
    def _written(self) -> list[ExecutedMotion]:
        """Blocks of each head that move and push; none of one that never does."""
        return [one.where(writes) for one in self.of_tips if (writes := _writing(one)).any()]

    def deposit(self, voxel_mm: float, more: float = 1.0) -> Deposit:
        """Lay the ink of all heads in voxels; `more` times what was dosed."""
        return unite_deposits(self.of_heads(voxel_mm, more))

    def of_heads(self, voxel_mm: float, more: float = 1.0) -> tuple[Deposit, ...]:
        """Lay the ink of each head that wrote, on one grid."""
        wrote = [k for k, motion in enumerate(self.of_tips) if _writing(motion).any()]
        machines = [self.printer.of_head(k) for k in wrote]
        air = bool(self.flows_ul_s)
        return deposit_of_heads(
            [self.of_tips[k] for k in wrote],
            [more * (1.0 if air else self.area_mm2[k]) for k in wrote],
            voxel_mm,
            smoothing_mm=EXACT_MM if air else 1.0,
            plunger_step_mm=[EXACT_MM if air else 1 / one.steps_per_mm.e for one in machines],
            faults=[self.faults.of_head(k) for k in wrote],
            style=self.style,
            layer_mm=self.layer_mm,
        )


def _writing(motion: ExecutedMotion) -> np.ndarray:
    """Whether each block moves and pushes, (n,)."""
    moved = (motion.end != motion.start).any(axis=1)
    return np.asarray(moved & (motion.plunger_end > motion.plunger_start))


def usual_voxel_um(
    part: SimulatedScan, thinnest_mm: float | None, box_mm: FloatArray, seed: int
) -> tuple[float, float, float]:
    """Return the voxels of a scan that names none: `VOXELS_ACROSS` of them across a vessel.

    No coarser than scanners usually take, and no finer than makes a scan of `MAX_SCAN_MB`.

    Parameters
    ----------
    part : SimulatedScan
    thinnest_mm : float or None, mm
        Diameter of the thinnest vessel, where it is known.
    box_mm : (2, 3) float64, mm
        What is scanned.
    seed : int
        Of the pose.
    """
    usual = np.array((25.0, 25.0, 15.0) if part.simulated == "oct" else (80.0, 80.0, 80.0))
    across = math.inf if thinnest_mm is None else 1e3 * thinnest_mm / VOXELS_ACROSS
    voxels = usual * min(1.0, across / usual[0])
    while _size_mb(part, voxels, box_mm, seed) > MAX_SCAN_MB:
        voxels = voxels * 1.05
    dx, dy, dz = np.round(voxels, 1).tolist()
    return dx, dy, dz


def _size_mb(part: SimulatedScan, voxels: FloatArray, box_mm: FloatArray, seed: int) -> float:
    sized = part.model_copy(update={"voxel_um": tuple(voxels.tolist())})
    return math.prod(_options(sized).shape(box_mm, seed)) * _BYTES_PER_VOXEL / 1e6


def voxels_um(part: SimulatedScan) -> tuple[float, float, float]:
    """Return a part's voxels, which are known by the time of the scan."""
    if part.voxel_um is None:
        raise ValueError("a simulated scan's voxels come before its size")
    return part.voxel_um


def deposit_voxel_mm(part: SimulatedScan) -> float:
    """Edge of the voxels in which ink is laid that is to be scanned, mm."""
    return max(_FINEST_DEPOSIT_MM, _DEPOSIT_PER_SCAN_VOXEL * 1e-3 * min(voxels_um(part)))


def scan_deposit(ink: Deposit, part: SimulatedScan, seed: int, *, gel: bool) -> ScannerOutput:
    """Scan a deposit; `gel`: the ink is the gel, else it has been melted out of it."""
    options = _options(part, gel)
    if isinstance(options, OctOptions):
        return simulate_oct(ink, options, seed)
    return simulate_microct(ink, options, seed)


def _options(part: SimulatedScan, gel: bool = True) -> OctOptions | MicroCtOptions:
    dx, dy, dz = (value * 1e-3 for value in voxels_um(part))
    left = 1 - part.shrink_percent / 100
    if part.simulated == "oct":
        return OctOptions(
            voxel_mm=(dz, dy, dx),
            placing=Placing(shrink=(left, left, left)),
            ink="gel" if gel else "lumen",
        )
    placing = Placing(tilt_deg=5.0, rotation_deg=180.0, margin_mm=1.0, shrink=(left, left, left))
    return MicroCtOptions(
        voxel_mm=dx,
        sigma_mm=_CT_BLUR_VOXELS * dx,
        placing=placing,
        ink="gel" if gel else "lumen",
    )


def reach_notes(
    part: SimulatedScan, points_mm: FloatArray, box_mm: FloatArray, *, gel: bool
) -> list[str]:
    """Say how much of the vessels lies deeper than the simulated light reaches.

    Parameters
    ----------
    part : SimulatedScan
    points_mm : (n, 3) float64, mm
        On the vessels' axes.
    box_mm : (2, 3) float64, mm
        What is scanned; light comes from above.
    gel : bool
        The ink is the gel, and liquid lies above it; else gel fills the field.
    """
    options = _options(part, gel)
    if not isinstance(options, OctOptions):
        return []
    reach = options.reach_mm - (0.0 if gel else options.placing.margin_mm)
    deeper = float((box_mm[1, 2] - points_mm[:, 2] > reach).mean())
    if deeper < LEAST_DEEPER:
        return []
    return [
        f"OCT reaches {reach:.1f} mm into this {'part' if gel else 'bath'}; {100 * deeper:.0f} % "
        "of the vessels lie deeper and will be neither open nor closed. Micro-CT shows all of "
        "them (scan: {simulated: microct})"
    ]


def scan_size_words(part: SimulatedScan, box_mm: FloatArray, seed: int, large: str) -> str:
    """Say how large the scan of what lies in a box (2, 3), mm, will be.

    Raises
    ------
    UsageError
        Above `MAX_SCAN_MB`, unless the part says that it may be; `large` names what says so.
    """
    shape = _options(part).shape(box_mm, seed)
    size = math.prod(shape) * _BYTES_PER_VOXEL / 1e6
    across = " × ".join(str(count) for count in reversed(shape))
    voxel = ", ".join(f"{value:g}" for value in voxels_um(part))
    words = f"the scan will be {_mb(size)} ({across} voxels of {voxel} µm)"
    if size <= PROPOSED_SCAN_MB:
        return words
    coarser = (size / PROPOSED_SCAN_MB) ** (1 / 3)
    other = ", ".join(f"{math.ceil(coarser * value):g}" for value in voxels_um(part))
    proposed = f"voxels of {other} µm make one of at most {PROPOSED_SCAN_MB:g} MB"
    if size > MAX_SCAN_MB and not part.large:
        raise UsageError(f"{words}, above {_mb(MAX_SCAN_MB)}: {proposed}; or say {large}")
    return f"{words}; {proposed}"


def _mb(size: float) -> str:
    return f"{size:.0f} MB" if size < 1000 else f"{size / 1000:.1f} GB"


def to_scan(scanned: ScannerOutput, came_from: Path) -> Scan:
    """What a scanner's file holds: everything but the truth."""
    return Scan(
        volume=scanned.volume,
        voxel_mm=scanned.voxel_mm,
        refractive_index=scanned.refractive_index,
        optical_depth=scanned.optical_depth,
        scale=scanned.scale,
        modality=scanned.modality,
        depth_down=scanned.depth_down,
        came_from=came_from,
    )
