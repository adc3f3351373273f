"""Uncertainty of a vessel's section diameters and of quantities derived from them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from registration.alignment.uncertainty.budget import Budget, Term, coverage_factor
from registration.alignment.uncertainty.scan_errors import BLUR_PART, ScanErrors

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
    curved = 2 * BLUR_PART * errors.blur_mm**2 / radius
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
