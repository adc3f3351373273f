"""Convert a layer's section to contour arrays with inward normals; sample points on them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from manifold3d import CrossSection
from numpy.typing import NDArray

from kernels.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class Contours:
    """Closed rings, the region always on their left.

    Attributes
    ----------
    points : (n, 2) float64, mm
        The last point of a ring isn't repeated.
    offset : (rings + 1,) int64
        Ring k is ``points[offset[k] : offset[k + 1]]``.
    """

    points: FloatArray
    offset: IntArray

    @property
    def ring(self) -> IntArray:
        """Ring of each point, (n,)."""
        return np.repeat(np.arange(len(self.offset) - 1), np.diff(self.offset))

    @property
    def next(self) -> IntArray:
        """The point after each one on its ring, (n,)."""
        after = np.arange(1, len(self.points) + 1)
        after[self.offset[1:] - 1] = self.offset[:-1]
        return after

    @property
    def hole(self) -> NDArray[np.bool_]:
        """Whether each ring goes round a hole, (rings,)."""
        a, b = self.points, self.points[self.next]
        twice = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        return np.asarray(np.add.reduceat(np.append(twice, 0.0), self.offset[:-1]) < 0)

    def __len__(self) -> int:
        return len(self.offset) - 1


@dataclass(frozen=True)
class Samples:
    """Points along contours, none further from the next than was asked for.

    Attributes
    ----------
    contours : Contours
        The samples themselves as rings.
    normal : (n, 2) float64
        Unit vectors into the region; at a corner halfway between its two edges'.
    miter : (n,) float64
        How much further the corner of a parallel ring lies than the ring; at most 4.
    convex : (n,) bool
        Corners that the region ends in.
    """

    contours: Contours
    normal: FloatArray
    miter: FloatArray
    convex: NDArray[np.bool_]


def contours_of(section: CrossSection) -> Contours:
    """The contours of a section, those of fewer than three points left out."""
    rings = [ring for ring in section.to_polygons() if len(ring) > 2]
    if not rings:
        return Contours(np.zeros((0, 2)), np.zeros(1, dtype=np.int64))
    offset = np.cumsum([0, *map(len, rings)], dtype=np.int64)
    return Contours(np.concatenate(rings).astype(np.float64), offset)


def sample(contours: Contours, spacing_mm: float) -> Samples:
    """Put points along every edge that is longer than ``spacing_mm``."""
    way = contours.points[contours.next] - contours.points
    length = np.maximum(np.hypot(way[:, 0], way[:, 1]), 1e-12)
    along = way / length[:, None]
    count = np.maximum(np.ceil(length / spacing_mm), 1).astype(np.int64)
    first = np.cumsum(count) - count
    edge = np.repeat(np.arange(len(count)), count)
    step = np.arange(len(edge)) - first[edge]
    points = contours.points[edge] + (step / count[edge])[:, None] * way[edge]
    before = np.empty_like(along)
    before[contours.next] = along
    both = np.where((step == 0)[:, None], along[edge] + before[edge], along[edge])
    size = np.hypot(both[:, 0], both[:, 1])
    turned = size > 1e-9
    both = np.where(turned[:, None], both / np.where(turned, size, 1.0)[:, None], along[edge])
    cosine = np.abs((both * along[edge]).sum(axis=1))
    offset = np.append(first, len(edge))[contours.offset]
    normal = np.column_stack([-both[:, 1], both[:, 0]])
    back = before[edge]
    turn = back[:, 0] * along[edge, 1] - back[:, 1] * along[edge, 0]
    convex = (step == 0) & (turn > 0)
    return Samples(Contours(points, offset), normal, 1 / np.maximum(cosine, 0.25), convex)
