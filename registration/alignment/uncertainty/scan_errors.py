"""Estimate the standard uncertainties common to a whole scan: walls, depth, lateral scale."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kernels.arrays import FloatArray
from registration.alignment.uncertainty.budget import at_either_end, coverage_factor, rectangular
from registration.scan import Scan
from registration.segmentation import Segmentation
from registration.wall_reference import WallCalibration

INDEX_HALF_WIDTH = 0.02
"""Of the group index without a depth standard: hydrogels and media lie within ± 2 % of water."""
LATERAL_HALF_WIDTH = 0.0005
"""Of the lateral voxel size as a file states it (its last digit); a scanner's own error, which no
scan shows, comes with `--oct-calibration`."""
WALL_DOF = 12.0
"""Of `LEVEL_PART`, known to about a fifth (GUM G.4.2)."""
LEVEL_PART = 0.010
"""Standard uncertainty of the surface's level, of the step from liquid to gel without haze. With it
97 % of sections' intervals hold on 144 scans of three generators (2026-11-28)."""
OUTER_PART = 0.11
"""The same of outer faces: an A-scan filled in part has light of its own only beside it (`walls`),
and a beam that widens away from its focus takes part of its light past the face (calibrated on a
third generator with such a beam; the spectral one's upright faces show 0.043)."""
LEAST_STEP = 0.5
"""Of gel's brightness: where liquid is nearer to it, walls' errors aren't known (no interval):
lumens come out up to a tenth too wide there (shared generator, contrast 2)."""
MOST_UNEVEN = 0.1
"""Standard deviation of the gel's own level, of the step, beyond which walls' errors aren't known:
dark layers then come near half of the gel's usual level and may pass for liquid."""
BLUR_PART = 0.1
"""Relative standard uncertainty of the blur."""
ROOT_TWO_PI = 2.5066
"""A step under a Gaussian blur σ rises by its height over √(2π) σ at its middle."""


@dataclass(frozen=True)
class ScanErrors:
    """Standard uncertainties common to a whole scan.

    Attributes
    ----------
    level_mm : float, mm
        Of the place of a wall by the level taken for halfway, the same all round.
    outer_mm : float, mm
        The same of outer faces.
    facing_mm : float, mm
        Of the place of walls that face the light or away from it, beyond that.
    wall_dof : float
        Degrees of freedom of `level_mm`.
    depth, lateral : float
        Relative, of lengths along and across the light.
    blur_mm : float, mm
        Blur under which walls were found.
    beam : (3,) float64
        Unit vector of the light's way, in the scan's frame.
    faint_mm : float, mm
        Of the place of all walls alike, by reflections no brighter than gel.
    line_mm : float, mm
        Of the place of walls in sections, where their profile has told it (`gauging.wall_profile`).
    reference : WallCalibration or None
        What the walls were moved by (`Scan.walls`).
    """

    level_mm: float
    outer_mm: float
    facing_mm: float
    wall_dof: float
    depth: float
    lateral: float
    blur_mm: float
    beam: FloatArray
    faint_mm: float = 0.0
    line_mm: float = 0.0
    reference: WallCalibration | None = None

    @property
    def level_note(self) -> str:
        """What `level_mm` rests on."""
        return "halfway to the gel" if self.reference is None else "offset of the reference"

    def surface_expanded(self, contrast: float) -> float:
        """Half width of the 95 % interval of an RMS over the surface, mm; NaN if not known.

        An RMS changes by no more than the RMS of the errors (triangle inequality): what outer
        walls share, and each place's own, the field's noise (1 / contrast of the step) over the
        step's rise 1 / (√(2π) σ).
        """
        own = ROOT_TWO_PI * self.blur_mm / contrast
        shared = np.hypot(self.outer_mm, self.facing_mm)
        return float(coverage_factor(np.inf) * np.hypot(shared, np.hypot(self.faint_mm, own)))

    @staticmethod
    def of_blur(blur_mm: float) -> ScanErrors:
        """Errors of walls found under a blur between two known levels, all else exact."""
        rise = ROOT_TWO_PI * blur_mm
        beam = np.array([0.0, 0.0, 1.0])
        return ScanErrors(
            LEVEL_PART * rise, LEVEL_PART * rise, 0.0, WALL_DOF, 0.0, 0.0, blur_mm, beam
        )


def _depth(scan: Scan) -> float:
    """Relative standard uncertainty of lengths along the light."""
    if scan.depth_standard and scan.depth_error is not None:
        return scan.depth_error
    known = scan.depth_standard or scan.modality != "oct"
    return rectangular(LATERAL_HALF_WIDTH if known else INDEX_HALF_WIDTH)


def scan_errors(scan: Scan, segmentation: Segmentation) -> ScanErrors:
    """Return what is known of a scan's shared errors.

    The level: a part of the step shifts a wall by √(2π) σ times that part; with liquid nearly as
    bright as gel, the same error of a level is a larger part of the step. Gel that is itself uneven
    adds half of its spread; more than `MOST_UNEVEN`, and nothing is known. Reflections: anywhere
    from none to one just not seen (`GelField.faint_mm` and `facing_mm` are the middle of that); the
    walls of one print either have them or not, so that the ends are likelier than the middle. And
    more where the step is small. A reference replaces the level, but not what uneven gel adds.
    """
    walls = scan.walls
    field, strength = segmentation.field, segmentation.strength
    step = 1.0 - (strength.dark if strength else 0.0)
    known = step >= LEAST_STEP and field.uneven <= MOST_UNEVEN
    rise = ROOT_TWO_PI * field.blur_mm / step if known else float("nan")
    # Halfway to a level that is off by a part of the step is off by half of that.
    level, outer = (
        float(np.hypot(part, field.uneven / 2)) * rise
        for part in (LEVEL_PART, LEVEL_PART if strength is None else OUTER_PART)
    )
    # A reflection as bright as gel is 1 / step of the step from bright liquid: anything from 0 to
    # 2 / step times the correction.
    reach = 2 / float(np.clip(step, LEAST_STEP, 1.0)) - 1
    faint, facing = (reach * at_either_end(one) for one in (field.faint_mm, field.facing_mm))
    if walls is not None:
        own = 1e-3 * walls.interval_um / coverage_factor(np.inf)
        layers = ROOT_TWO_PI * field.blur_mm * field.uneven / 2
        level = float(np.hypot(own, layers)) if field.uneven <= MOST_UNEVEN else float("nan")
    return ScanErrors(
        level_mm=level,
        outer_mm=outer,
        faint_mm=faint,
        facing_mm=facing,
        wall_dof=WALL_DOF if walls is None else np.inf,
        reference=walls,
        depth=_depth(scan),
        lateral=rectangular(LATERAL_HALF_WIDTH)
        if scan.lateral_error is None
        else scan.lateral_error,
        blur_mm=field.blur_mm,
        beam=np.array([0.0, 0.0, 1.0]),
    )
