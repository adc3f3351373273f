"""Uncertainty of scan measurements by the GUM: terms, budgets, 95 % intervals.

Goes in: standard uncertainties of scan and fit. Comes out: budgets and intervals.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from kernels.arrays import FloatArray
from registration.scan import Scan
from registration.segmentation import Segmentation
from registration.wall_reference import WallCalibration

LEVEL = 0.95
"""Coverage probability of expanded uncertainties."""


@dataclass(frozen=True)
class Term:
    """One contribution to an uncertainty.

    Attributes
    ----------
    name : str
        What it comes from.
    kind : "A" or "B"
        Evaluated by statistics of this scan, or by other means (GUM 4.2, 4.3).
    standard : float
        Standard uncertainty, in the unit of the quantity, sensitivity included.
    dof : float
        Degrees of freedom of `standard`; inf where it is taken as exact.
    note : str
        What it rests on.
    """

    name: str
    kind: Literal["A", "B"]
    standard: float
    dof: float
    note: str


@dataclass(frozen=True)
class Budget:
    """The terms of one quantity, uncorrelated with each other.

    Attributes
    ----------
    terms : tuple of Term
    """

    terms: tuple[Term, ...]

    @property
    def standard(self) -> float:
        """Combined standard uncertainty (GUM 5.1.2)."""
        return math.hypot(*(term.standard for term in self.terms))

    @property
    def dof(self) -> float:
        """Effective degrees of freedom by Welch and Satterthwaite (GUM G.4.1)."""
        spread = sum(t.standard**4 / t.dof for t in self.terms if t.standard > 0)
        return self.standard**4 / spread if spread > 0 else math.inf

    @property
    def expanded(self) -> float:
        """Half width of the 95 % interval; NaN where a term isn't known."""
        return coverage_factor(self.dof) * self.standard

    def share(self, term: Term) -> float:
        """Share of the combined variance that a term makes."""
        return term.standard**2 / self.standard**2 if self.standard > 0 else 0.0


def coverage_factor(dof: float) -> float:
    """Student's t for 95 % both ways; NaN for NaN."""
    return float(stdtrit(max(dof, 1.0), (1 + LEVEL) / 2))


def rectangular(half_width: float) -> float:
    """Standard uncertainty of what lies anywhere within ± `half_width` (GUM 4.3.7)."""
    return half_width / math.sqrt(3)


def at_either_end(half_width: float) -> float:
    """Standard deviation where a quantity is at either end of ± `half_width` more than between.

    The arc sine distribution (GUM Supplement 1, 6.4.6).
    """
    return half_width / math.sqrt(2)


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
    blur_part : float
        Relative standard uncertainty of the blur, where it isn't part of `line_mm`.
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
    blur_part: float = BLUR_PART
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


OWN_DOF = 40.0
"""Of a section's own noise: independent places on 48 rays, less the harmonics."""
PLACE_DOF = 5.0
"""Of the place of walls: groups of sections less one, walls of three directions."""


@dataclass(frozen=True)
class SectionErrors:
    """Standard errors of a vessel's n diameters: their own, and what they share.

    Attributes
    ----------
    diameter : (n,) float64, mm
        Measured; 0 or NaN where closed or unknown.
    own : (n,) float64, mm
        Independent of every other vessel, correlated along `correlation_mm`.
    shared : (n, 7) float64, mm
        Change of each diameter by one standard deviation of level, reflections, the walls'
        place, blur, depth, lateral scale and thin gel.
    spacing_mm, correlation_mm : float, mm
    wall_dof : float
    level_note : str
        What the level of the walls rests on.
    """

    diameter: FloatArray
    own: FloatArray
    shared: FloatArray
    spacing_mm: float
    correlation_mm: float
    wall_dof: float
    level_note: str

    @property
    def expanded(self) -> FloatArray:
        """Half width of each diameter's 95 % interval, (n,), mm; NaN where it has none."""
        return np.array([self._budget(k).expanded for k in range(len(self.own))])

    def _budget(self, section: int) -> Budget:
        weights = np.zeros(len(self.own))
        weights[section] = 1.0
        return self.budget(weights, float(self.own[section]))

    @property
    def open(self) -> NDArray[np.bool_]:
        """Sections with a diameter and an error, (n,)."""
        return np.asarray(np.isfinite(self.own) & (self.diameter > 0))

    @property
    def known_shared(self) -> FloatArray:
        """`shared`, 0 where a section has no diameter."""
        return np.where(self.open[:, None], self.shared, 0.0)

    def mean_budget(self) -> Budget:
        """Budget of the mean diameter over the open sections, mm."""
        weights = self.open / max(int(self.open.sum()), 1)
        return self.budget(weights, self.averaged(weights))

    def resistance_weights(self) -> FloatArray:
        """Relative change of the resistance per mm of each open diameter: 4 (1/d⁵) / Σ 1/d⁴."""
        diameter = np.where(self.open, self.diameter, np.inf)
        return np.asarray(4 * diameter**-5.0 / (diameter**-4.0).sum())

    def resistance_interval(self, ratio: float) -> tuple[float, float]:
        """95 % interval of a resistance ratio; R goes as the sum of 1/d⁴."""
        if not self.open.any() or not np.isfinite(ratio):
            return float("nan"), float("nan")
        weights = self.resistance_weights()
        half = self.budget(weights, self.averaged(weights)).expanded
        return float(ratio * np.exp(-half)), float(ratio * np.exp(half))

    def offset_expanded(self) -> float:
        """Half width of the mean offset's interval, mm: the centroid errs like a wall's mean."""
        if not self.open.any():
            return float("nan")
        weights = self.open / int(self.open.sum())
        # A centroid's coordinate has the variance of the diameter's noise over 2 (harmonic 1).
        return float(coverage_factor(OWN_DOF) * self.averaged(weights) / np.sqrt(2))

    def averaged(self, weights: FloatArray) -> float:
        """Standard error that the sections' own errors leave in a weighted sum."""
        if not self.open.any():
            return float("nan")
        pulled = np.where(self.open, weights * np.nan_to_num(self.own), 0.0)
        place = self.spacing_mm * np.arange(len(pulled))
        apart = np.abs(place[:, None] - place) / max(self.correlation_mm, 1e-9)
        return float(np.sqrt(np.maximum(pulled @ np.exp(-(apart**2)) @ pulled, 0.0)))

    def budget(self, weights: FloatArray, own: float) -> Budget:
        """Budget of a weighted sum of the diameters whose own errors leave `own`."""
        level, facing, line, blur, depth, lateral, thin = np.abs(weights @ self.known_shared)
        return Budget(
            (
                Term("speckle and roughness", "A", own, OWN_DOF, "scatter of the rays"),
                Term("level of the wall", "B", float(level), self.wall_dof, self.level_note),
                Term("reflections", "B", float(facing), np.inf, "too weak to be told from gel"),
                Term("place of the walls", "B", float(line), PLACE_DOF, "profile across walls"),
                Term("blur and curvature", "B", float(blur), np.inf, "10 % of the blur"),
                Term("refractive index", "B", float(depth), np.inf, "depth"),
                Term("voxel size", "B", float(lateral), np.inf, "lateral scale"),
                Term("thin gel beside", "B", float(thin), np.inf, "short vessels in tight rows"),
            )
        )


def section_errors(
    errors: ScanErrors,
    diameter: FloatArray,
    noise: FloatArray,
    across: FloatArray,
    spacing_mm: float,
    thin_mm: float = 0.0,
) -> SectionErrors:
    """Return the errors of a vessel's sections.

    Parameters
    ----------
    errors : ScanErrors
    diameter, noise : (n,) float64, mm
        Measured, and its standard error by the rays.
    across : (n, 2, 3) float64
        Orthonormal directions in each section's plane, scan's frame.
    spacing_mm : float, mm
        Between the sections.
    thin_mm : float, mm
        Standard uncertainty of all of them by thin gel beside (`gauging.own_levels`).
    """
    # A stretch s of depth scales the area by |w|^(s), w the beam's part in the plane.
    in_depth = ((across @ errors.beam) ** 2).sum(axis=1)
    radius = np.maximum(diameter / 2, errors.blur_mm)
    curved = 2 * errors.blur_part * errors.blur_mm**2 / radius
    shared = np.column_stack(
        [
            np.full(len(diameter), 2 * errors.level_mm),
            # One print's walls either shine or don't: both are off the same way.
            2 * errors.faint_mm + in_depth * errors.facing_mm,
            np.full(len(diameter), 2 * errors.line_mm),
            curved,
            0.5 * diameter * in_depth * errors.depth,
            0.5 * diameter * (2 - in_depth) * errors.lateral,
            np.full(len(diameter), thin_mm),
        ]
    )
    correlation = 2 * np.sqrt(np.pi) * errors.blur_mm
    return SectionErrors(
        diameter, noise, shared, spacing_mm, float(correlation), errors.wall_dof, errors.level_note
    )


DRAWS = 4000
PERCENTILES = (2.5, 97.5)


def pressure_interval(
    ratio: float,
    resistance: FloatArray,
    flow: FloatArray,
    vessels: Sequence[SectionErrors],
) -> tuple[float, float]:
    """Return the 95 % interval of a pressure ratio (JCGM 101:2008), NaN where it can't be known.

    Errors that sections share (walls, blur, index, voxel size) are drawn once for all vessels, own
    errors once a vessel. The drop is the power lost over the flow, Σ R q² / q₀, and changes with R
    at the flows as they are, because a shift of the flows changes it in second order only
    (Thomson's principle). What wasn't measured of a network errs like the mean of what was.

    Parameters
    ----------
    ratio : float
        Pressure drop as printed over as designed.
    resistance, flow : (v,) float64
        As printed, in any unit; closed vessels have no flow.
    vessels : sequence of SectionErrors
        One a vessel.
    """
    power = np.where(flow != 0, np.nan_to_num(resistance, posinf=0.0) * flow**2, 0.0)
    shifts = [_shift(vessel) for vessel in vessels]
    known = np.array([shift is not None for shift in shifts])
    if not np.isfinite(ratio) or not known.any() or not power.sum() > 0:
        return float("nan"), float("nan")
    usual = np.mean([shift for shift in shifts if shift is not None], axis=0)
    table = np.array([usual if shift is None else shift for shift in shifts])
    dof = next(v.wall_dof for v, shift in zip(vessels, shifts, strict=True) if shift is not None)
    rng = np.random.default_rng(0)
    shared = rng.standard_normal((DRAWS, table.shape[1] - 1))
    shared[:, 0] = rng.standard_t(min(max(dof, 3.0), 1e6), DRAWS)
    own = rng.standard_t(OWN_DOF, (DRAWS, len(table)))
    change = np.exp(-(shared @ table[:, 1:].T) - own * table[:, 0])
    low, high = np.percentile(change @ (power / power.sum()), PERCENTILES)
    return float(ratio * low), float(ratio * high)


def _shift(vessel: SectionErrors) -> FloatArray | None:
    """Relative change of a vessel's resistance by its own and each shared standard deviation."""
    if not vessel.open.any():
        return None
    weights = vessel.resistance_weights()
    return np.concatenate([[vessel.averaged(weights)], weights @ vessel.known_shared])


_REFERENCE = "scan a reference of known diameters (printctl calibrate oct --reference)"
REMEDIES = {
    "speckle": "average more looks: repeat the scan and average, or scan slower",
    "speckle and roughness": "average more looks: repeat the scan and average, or scan slower",
    "shape": "the print deviates over millimetres: no better scan makes it less",
    "level of the wall": _REFERENCE,
    "level of the walls": _REFERENCE,
    "reflections": "scan a reference of known diameters, or tilt the part by a few degrees",
    "place of the walls": _REFERENCE,
    "blur and curvature": "smaller voxels",
    "refractive index": "scan a depth standard (printctl calibrate oct --step, --oct-calibration)",
    "thin gel beside": "smaller voxels, or more gel between lumens",
    "voxel size": "calibrate the scanner's field (printctl calibrate oct --grid)",
}
"""What makes each term smaller."""


def terms(budget: Budget, scale: float) -> list[dict[str, object]]:
    """Return a budget's terms, standard uncertainties times `scale`, the largest first."""
    return [
        {
            "term": term.name,
            "type": term.kind,
            "standard": _short(scale * term.standard),
            "dof": _short(term.dof),
            "share": _short(budget.share(term)),
            "note": term.note,
        }
        for term in sorted(budget.terms, key=lambda term: -term.standard)
    ]


def quantity(name: str, unit: str, budget: Budget, scale: float) -> dict[str, object]:
    """Return a quantity's budget with what would reduce it most."""
    return {
        "quantity": name,
        "unit": unit,
        "standard": _short(scale * budget.standard),
        "dof": _short(budget.dof),
        "interval_95": _short(scale * budget.expanded),
        "terms": terms(budget, scale),
        "reduce": REMEDIES[max(budget.terms, key=lambda term: term.standard).name],
    }


def _short(value: float) -> float:
    return float(f"{value:.4g}")
