"""Search candidate poses over all orientations, for scans of a whole part or of a piece."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from kernels.arrays import FloatArray
from registration.alignment.distance import DistanceGrid, ModelSurface
from registration.alignment.fit import Fit
from registration.alignment.multistart import descend, losses
from registration.alignment.options import AlignmentOptions
from registration.alignment.rotations import spread_rotations

THIN, MEDIUM = 160, 450
"""Points for the first look at all orientations, and for the first descent."""
SLACK_MM = 0.5
"""A view is partial along an axis where the part is longer by more than this."""
SLIDE_MM = 0.4
"""Step of places tried along what the part is longer by: within the catch of a lumen."""
WIDE, CLOSE_MM = 0.06, (0.4, 0.15)
"""Scales of the robust loss: the first as a share of the part's diagonal, then mm."""
MOST_PLACES = 400
"""Places tried of one orientation."""


@dataclass(frozen=True)
class Search:
    """What every search of a pose needs.

    Attributes
    ----------
    surface : ModelSurface
    grid : DistanceGrid
        Of the surface.
    options : AlignmentOptions
    """

    surface: ModelSurface
    grid: DistanceGrid
    options: AlignmentOptions

    def poses(self, points: FloatArray, most: int) -> list[Fit]:
        """Return at most `most` distinct poses of points (n, 3), the lowest robust loss first."""
        middle = points.mean(axis=0)
        centred = np.ascontiguousarray(points - middle)
        turned = self._oriented(centred)
        placed = np.concatenate([self._placed(centred, pose) for pose in turned])
        poses = self._descend(centred, placed, CLOSE_MM, 18)
        score = self._losses(centred, poses, CLOSE_MM[-1])
        centre = self.surface.bounds.mean(axis=0)
        ranked = poses[np.argsort(score, kind="stable")]
        kept = ranked[_distinct(ranked, centred, self.options.distinct_mm, most)]
        return [
            Fit(pose[:, :3], pose[:, 3] - pose[:, :3] @ middle, np.ones(3), centre) for pose in kept
        ]

    def _oriented(self, centred: FloatArray) -> FloatArray:
        """Distinct poses after a first descent from all orientations, (k, 3, 4), best first."""
        wide = WIDE * float(np.linalg.norm(np.ptp(self.surface.bounds, axis=0)))
        few = _some(centred, THIN)
        starts = self._starts(few)
        score = self._losses(few, starts, wide)
        chosen = starts[np.argsort(score, kind="stable")[: self.options.descents]]
        more = _some(centred, MEDIUM)
        poses = self._descend(more, chosen, (wide, CLOSE_MM[0]), 8)
        ranked = poses[np.argsort(self._losses(more, poses, CLOSE_MM[0]), kind="stable")]
        return np.asarray(ranked[_distinct(ranked, few, 2 * SLIDE_MM, self.options.orientations)])

    def _starts(self, few: FloatArray) -> FloatArray:
        """The best place of each orientation, box against box, (n, 3, 4)."""
        turns = spread_rotations(self.options.cover)
        low, high = self.surface.bounds
        turned = np.sort(few @ turns.transpose(0, 2, 1), axis=1)
        rim = max(1, len(few) // 50)
        ends = low - turned[:, rim], high - turned[:, -1 - rim]
        starts = []
        for share in product((0.0, 0.5, 1.0), repeat=3):
            pose = np.empty((len(turns), 3, 4))
            pose[:, :, :3] = turns
            pose[:, :, 3] = ends[0] + np.array(share) * (ends[1] - ends[0])
            wanted = ((np.array(share) == 0.5) | (ends[1] - ends[0] > 2 * SLACK_MM)).all(axis=1)
            starts.append(pose[wanted])
        return np.concatenate(starts)

    def _placed(self, centred: FloatArray, pose: FloatArray) -> FloatArray:
        """The pose, and where else along what isn't in view it may belong, (k, 3, 4)."""
        there = centred @ pose[:, :3].T + pose[:, 3]
        seen = np.percentile(there, (1, 99), axis=0)
        ends = (
            np.minimum(self.surface.bounds - seen, 0)[0],
            np.maximum(self.surface.bounds - seen, 0)[1],
        )
        slack = ends[1] - ends[0] > SLACK_MM
        if not slack.any():
            return pose[None]
        count = np.where(slack, np.ceil((ends[1] - ends[0]) / SLIDE_MM), 1).astype(int)
        count = np.maximum(
            1,
            np.floor(count * min(1.0, (MOST_PLACES / count.prod()) ** (1 / slack.sum()))).astype(
                int
            ),
        )
        steps = [
            np.linspace(a, b, n) if n > 1 else np.zeros(1)
            for a, b, n in zip(*ends, count, strict=True)
        ]
        shifts = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3)
        places = np.repeat(pose[None], len(shifts) + 1, axis=0)
        places[1:, :, 3] += shifts
        score = self._losses(_some(centred, MEDIUM), places, CLOSE_MM[0] / 2)
        best = np.argsort(score[1:], kind="stable")[: self.options.places] + 1
        return np.asarray(places[np.concatenate([[0], best])])

    def _descend(
        self, points: FloatArray, poses: FloatArray, scales: tuple[float, ...], steps: int
    ) -> FloatArray:
        grid = self.grid
        where = (grid.values, grid.origin_mm, grid.step_mm)
        return np.asarray(
            descend(*where, points, np.ascontiguousarray(poses), np.array(scales), steps)
        )

    def _losses(self, points: FloatArray, poses: FloatArray, scale: float) -> FloatArray:
        grid = self.grid
        where = (grid.values, grid.origin_mm, grid.step_mm)
        return np.asarray(losses(*where, points, np.ascontiguousarray(poses), scale))


def _some(points: FloatArray, most: int) -> FloatArray:
    """At most `most` of points that lie in no order, spread evenly."""
    every = max(1, len(points) // most)
    return np.ascontiguousarray(points[::every][:most])


def _distinct(poses: FloatArray, points: FloatArray, apart_mm: float, most: int) -> list[int]:
    """Numbers of the first `most` poses that move no point nearer than `apart_mm` to another's."""
    corners = np.array(list(product(*np.percentile(points, (0, 100), axis=0).T)))
    there = corners @ poses[:, :, :3].transpose(0, 2, 1) + poses[:, None, :, 3]
    kept: list[int] = []
    for k in range(len(poses)):
        away = np.linalg.norm(there[kept] - there[k], axis=2).max(axis=1)
        if (away > apart_mm).all():
            kept.append(k)
        if len(kept) == most:
            break
    return kept
