"""Find, refine and compare candidate poses of a scan, mirrored ones too."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import product

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from registration.alignment.distance import ModelSurface
from registration.alignment.doubts import OFF_MM
from registration.alignment.fit import Fit, FitFreedom, refine
from registration.alignment.rivals import MIRROR, AlternativePose, describe, design_symmetries
from registration.alignment.search import Search

CAP_MM = 0.5
"""Deviations count up to this much when poses are compared."""
TELLING_POINTS = 12
"""Fewer points than this don't tell two poses apart."""


def compare_poses(mine: FloatArray, other: FloatArray) -> float:
    """Ratio of RMS distance of the `other` pose to `mine`, over points where they differ.

    Residuals (n,) of the same points under both poses, mm. Only points count whose residuals
    differ by more than five times the spread of the better pose: two poses of a nearly symmetric
    part agree all over but for a mark or two, which an RMS over everything would drown. With
    fewer than a dozen such points the poses can't be told apart: 1.
    """
    telling = _telling(mine, other)
    if telling.sum() < TELLING_POINTS:
        return 1.0
    squares = [float(np.mean(r[telling] ** 2)) for r in _capped(mine, other)]
    return float(np.sqrt(squares[1] / max(squares[0], 1e-12)))


def deviation_where_different(mine: FloatArray, other: FloatArray) -> float:
    """Median deviation, mm, of `mine` at the points by which the two poses are told apart.

    Parameters
    ----------
    mine, other : (n,) float64, mm
        Residuals as of `compare_poses`.
    """
    telling = _telling(mine, other)
    return float(np.median(np.abs(mine[telling]))) if telling.any() else 0.0


def _capped(mine: FloatArray, other: FloatArray) -> tuple[FloatArray, FloatArray]:
    return np.minimum(np.abs(mine), CAP_MM), np.minimum(np.abs(other), CAP_MM)


def _telling(mine: FloatArray, other: FloatArray) -> NDArray[np.bool_]:
    spread = 1.4826 * min(float(np.median(np.abs(r))) for r in (mine, other))
    first, second = _capped(mine, other)
    return np.asarray(np.abs(first - second) > 5 * max(spread, 2e-3))


def residuals(surface: ModelSurface, points: FloatArray, fit: Fit) -> FloatArray:
    """Signed distance of the mapped points less the fit's offset, mm."""
    return np.asarray(surface.query(fit.apply(points)).distance - fit.offset_mm)


CANDIDATES, MIRRORED, OWN = 5, 2, 5
"""Poses refined: of the scan, of its mirror image, and by the design's own symmetries."""
REFINED_POINTS, COMPARED_POINTS = 2000, 12_000
CLEAR_LEAD = 4.0
"""A pose that fits so many times as badly on few points isn't compared on all."""
STRAIGHT = np.ones(3)


@dataclass(frozen=True)
class Choice:
    """The best pose and what else was tried.

    Attributes
    ----------
    best : Fit
    rivals : tuple of AlternativePose
        The closest first.
    mirror_lead : float
        How many times as badly the pose fits as the best of the mirror image that lies on the
        design where the two differ (within `OFF_MM`), see `compare_poses`; 0 where none does.
    """

    best: Fit
    rivals: tuple[AlternativePose, ...]
    mirror_lead: float


@dataclass(frozen=True, eq=False)
class _Pose:
    """A fit to the scan, or (`axes` reversed) to its mirror image."""

    fit: Fit
    axes: FloatArray

    @property
    def mirrored(self) -> bool:
        return bool(self.axes.prod() < 0)


@dataclass(frozen=True)
class PosePoints:
    """Scanned points by which poses are found, refined and compared.

    Attributes
    ----------
    search : Search
    points : (n, 3) float64, mm
    freedom : function of a Fit
        What a fit that lies so may change.
    """

    search: Search
    points: FloatArray
    freedom: Callable[[Fit], FitFreedom]
    _known: dict[tuple[_Pose, int], FloatArray] = field(default_factory=dict)

    def choose(self) -> Choice:
        """Return the pose that stands against all others."""
        few = thin_points(self.points, self.search.options.coarse_points)
        poses = self._refined(self.search.poses(few, CANDIDATES), STRAIGHT)
        best = self._winner(poses)
        own = self._refined(design_symmetries(self.search, few, best.fit, OWN), STRAIGHT)
        poses = self._distinct([best, *poses, *own])
        best = self._winner(poses)
        mirrored = self._refined(self.search.poses(few * MIRROR, MIRRORED), MIRROR)
        for _ in poses:  # on all points another may fit better than on few
            choice, better = self._compared(best, [p for p in [*poses, *mirrored] if p is not best])
            if better is None:
                break
            best = better
        return choice

    def _refined(self, fits: list[Fit], axes: FloatArray) -> list[_Pose]:
        some = thin_points(self.points, REFINED_POINTS) * axes
        surface = self.search.surface
        return [
            _Pose(refine(surface, some, fit, self.freedom(fit), steps=15, settled_mm=1e-3), axes)
            for fit in fits
        ]

    def _under(self, pose: _Pose, count: int) -> FloatArray:
        """Residuals of about `count` points under a pose, found once."""
        if (pose, count) not in self._known:
            some = thin_points(self.points, count) * pose.axes
            self._known[pose, count] = residuals(self.search.surface, some, pose.fit)
        return self._known[pose, count]

    def _winner(self, poses: list[_Pose]) -> _Pose:
        """Return the pose whose least lead over the others is the greatest.

        Each pair is compared where it differs, so that of three each may lead over the next.
        """
        under = [self._under(pose, COMPARED_POINTS) for pose in poses]
        leads = [
            min(
                (compare_poses(mine, under[k]) for k in range(len(poses)) if k != j), default=np.inf
            )
            for j, mine in enumerate(under)
        ]
        return poses[int(np.argmax(leads))]

    def _compared(self, best: _Pose, others: list[_Pose]) -> tuple[Choice, _Pose | None]:
        """Compare on few points with all, and on all with those that come close.

        Returns the pose that fits better than the best, too, where there is one.
        """
        most = self.search.options.contest_points
        mine, wide = self._under(best, COMPARED_POINTS), self._under(best, most)
        seen = best.fit.apply(thin_points(self.points, COMPARED_POINTS))
        rivals, mirror_lead, better = [], 0.0, None
        for other in others:
            lead = compare_poses(mine, self._under(other, COMPARED_POINTS))
            if lead < CLEAR_LEAD:
                under = self._under(other, most)
                lead = compare_poses(wide, under)
                # A mirror image that doesn't lie on the design itself proves nothing.
                if other.mirrored and deviation_where_different(under, wide) < OFF_MM:
                    mirror_lead = max(mirror_lead, compare_poses(under, wide))
            if lead < 1.0 and not other.mirrored:
                better = other
            surface = self.search.surface
            rivals.append(describe(surface, seen, best.fit, other.fit, lead, other.mirrored))
        rivals.sort(key=lambda r: r.lead)
        return Choice(best.fit, tuple(rivals), mirror_lead), better

    def _distinct(self, poses: list[_Pose]) -> list[_Pose]:
        """The poses that differ from those before them."""
        corners = np.array(list(product(*self.search.surface.bounds.T)))
        kept: list[_Pose] = []
        for pose in poses:
            there = pose.fit.invert(corners)
            away = [np.linalg.norm(k.fit.apply(there) - corners, axis=1).max() for k in kept]
            if all(a > self.search.options.distinct_mm for a in away):
                kept.append(pose)
        return kept


def thin_points(points: FloatArray, most: int) -> FloatArray:
    """At most `most` of the points, spread evenly, the same every time."""
    if len(points) <= most:
        return points
    chosen = np.random.default_rng(0).choice(len(points), most, replace=False)
    return np.asarray(points[np.sort(chosen)])
