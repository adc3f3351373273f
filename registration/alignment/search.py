"""Candidate poses: many starts, a coarse descent each, the distinct best refined."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from registration.alignment.contest import CAP_MM, residuals
from registration.alignment.fit import Fit, Freedom, refine
from registration.alignment.multistart import STAGES_MM, descend, losses
from registration.alignment.options import AlignmentOptions
from registration.distance import DistanceGrid, ModelSurface

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Search:
    """What every search of a pose needs."""

    surface: ModelSurface
    grid: DistanceGrid
    depth_down: bool
    axes: tuple[int, ...]
    options: AlignmentOptions

    def rivals(self, few: FloatArray, some: FloatArray, most: int) -> list[Fit]:
        """Distinct poses refined with scales, the least capped RMS first.

        ``few`` points search, ``some`` refine.
        """
        freedom = Freedom(self.axes, offset=True)
        coarse = _distinct(self.poses(few), self.surface, self.options, most)
        fine = [refine(self.surface, some, fit, freedom, steps=25) for fit in coarse]
        rms = [
            np.mean(np.minimum(np.abs(residuals(self.surface, some, fit)), CAP_MM) ** 2)
            for fit in fine
        ]
        ranked = [fine[k] for k in np.argsort(rms, kind="stable")]
        return _distinct(ranked, self.surface, self.options, most)

    def poses(self, points: FloatArray) -> list[Fit]:
        """Poses by multistart, best first."""
        middle = points.mean(axis=0)
        centred = np.ascontiguousarray(points - middle)
        where = (self.grid.values, self.grid.origin_mm, self.grid.step_mm)
        starts = _starts(self.surface, self.depth_down, self.options)
        thin = centred[::3].copy()
        rough = losses(*where, thin, starts.reshape(-1, 3, 4), STAGES_MM[0])
        best = rough.reshape(starts.shape[:2]).argmin(axis=1)
        chosen = np.ascontiguousarray(starts[np.arange(len(starts)), best])
        found = descend(*where, centred, chosen)
        score = losses(*where, centred, found, STAGES_MM[-1])
        centre = self.surface.bounds.mean(axis=0)
        return [
            Fit(pose[:, :3], pose[:, 3] - pose[:, :3] @ middle, np.ones(3), centre)
            for pose in found[np.argsort(score, kind="stable")]
        ]


def _starts(surface: ModelSurface, depth_down: bool, options: AlignmentOptions) -> FloatArray:
    """Poses (turns, variants, 3, 4) for points centred about their mean."""
    flip = np.diag([1.0, -1.0, -1.0]) if depth_down else np.eye(3)
    angles = np.arange(options.turns) * 2 * np.pi / options.turns
    turns = Rotation.from_rotvec(angles[:, None] * np.array([0.0, 0.0, 1.0]))
    tilts = Rotation.from_rotvec(
        np.deg2rad(options.tilt_deg)
        * np.array([[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    )
    steps = (0.0, -options.shift_mm, options.shift_mm)
    shifts = [np.array([x, y, 0.0]) for x, y in product(steps, steps)]
    out = np.empty((options.turns, len(tilts) * len(shifts), 3, 4))
    middle, turned = surface.centroid, turns.as_matrix()
    for n, (tilt, shift) in enumerate(product(tilts.as_matrix(), shifts)):
        out[:, n, :, :3] = tilt @ turned @ flip
        out[:, n, :, 3] = middle + shift
    return out


def _distinct(
    fits: list[Fit], surface: ModelSurface, options: AlignmentOptions, most: int
) -> list[Fit]:
    """The first `most` fits that differ, in their order."""
    corners = np.array(list(product(*surface.bounds.T)))
    kept: list[Fit] = []
    for fit in fits:
        there = fit.invert(corners)
        if all(
            np.linalg.norm(other.apply(there) - corners, axis=1).max() > options.distinct_mm
            for other in kept
        ):
            kept.append(fit)
        if len(kept) == most:
            break
    return kept
