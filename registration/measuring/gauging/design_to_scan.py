"""Signed distances from points of the design to the scanned surface, to notice missing walls.

Scan to design never notices what isn't there at all: a missing vessel has no scanned wall. Design
to scan does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from design.geometry import boxes_of, build_hierarchy
from kernels.arrays import FloatArray, IntArray
from registration.alignment import Fit
from registration.alignment.distance import UNKNOWN, ModelSurface, nearest
from registration.segmentation import Segmentation

SAMPLES = 40_000
"""Points spread over the design's surface."""

CLUSTER = 8
"""Triangles that the hierarchy treats as one."""


def surface_points(surface: ModelSurface, count: int = SAMPLES) -> FloatArray:
    """About `count` points spread evenly over a surface by area, (n, 3), mm; always the same.

    Every triangle gets its share of a running total of area, and within it a low-discrepancy
    sequence (Roberts' R2) folded into the triangle.
    """
    a, b, c = (surface.triangles[:, k] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    upto = np.round(np.cumsum(area) / area.sum() * count).astype(np.int64)
    which = np.repeat(np.arange(len(area)), np.diff(upto, prepend=0))
    number = np.arange(len(which))[:, None] + 0.5
    u, v = (number * (0.7548776662466927, 0.5698402909980532) % 1.0).T
    fold = u + v > 1
    u, v = np.where(fold, 1 - u, u)[:, None], np.where(fold, 1 - v, v)[:, None]
    return np.asarray(a[which] + u * (b - a)[which] + v * (c - a)[which])


@dataclass(frozen=True)
class ScannedSurface:
    """The scanned surface made ready to be measured to; build with `of`.

    Attributes
    ----------
    segmentation : Segmentation
        Whose surface it is.
    faces : (8 k, 3) int32
        Its triangles, neighbours together in eights; the last is repeated to fill up.
    """

    segmentation: Segmentation
    faces: NDArray[np.int32]

    @staticmethod
    def of(segmentation: Segmentation) -> ScannedSurface:
        """Put the surface's triangles in order."""
        field, faces = segmentation.field, segmentation.surface.faces
        corner = segmentation.surface.vertices[faces[:, 0]]
        faces = faces[np.argsort(_along_curve(corner, field.voxel_mm), kind="stable")]
        fill = np.repeat(faces[-1:], -len(faces) % CLUSTER, axis=0)
        return ScannedSurface(segmentation, np.concatenate([faces, fill]))

    def deviations_back(self, points: FloatArray, fit: Fit) -> FloatArray:
        """Signed deviation at points of the design, (m,), mm, where their counterpart was seen.

        Parameters
        ----------
        points : (n, 3) float64, mm
            On the design's surface, part frame.
        fit : Fit
            Scan to part.

        Returns
        -------
        (m,) float64, mm
            Exact, positive where the point lies outside the scanned gel. Left out are points
            beyond the field of view, and those whose nearest scanned surface wasn't seen.
        """
        value = self.segmentation.field.above_level(fit.invert(points))
        kept = np.isfinite(value)
        if not kept.any():
            return np.empty(0)
        places = np.ascontiguousarray(points[kept])
        # Each point is searched for from the one before: neighbours follow each other.
        order = np.argsort(_along_curve(places, self.segmentation.field.voxel_mm), kind="stable")
        places, value = places[order], value[kept][order]
        triangles = np.ascontiguousarray(fit.apply(self.segmentation.surface.vertices)[self.faces])
        # The field itself tells on which side of its surface a point lies: normals aren't needed.
        no_normals = np.zeros((len(triangles), 7, 3))
        unsigned, foot, _, face = nearest(
            places, triangles, *_hierarchy(triangles), no_normals, UNKNOWN
        )
        outside = np.where(
            np.abs(unsigned) < 2 * abs(self.segmentation.field.wall_mm),
            self._before(places - foot, face, fit),
            value < 0,
        )
        distance = np.where(outside, 1.0, -1.0) * np.abs(unsigned)
        corners = self.segmentation.seen[self.faces[face]]
        known = np.empty(len(order), dtype=np.bool_)
        known[order] = corners.all(axis=1)
        there = np.empty(len(order))
        there[order] = distance
        return there[known]

    def _before(self, away: FloatArray, face: IntArray, fit: Fit) -> NDArray[np.bool_]:
        """Whether steps from faces lead out of the gel: where the wall isn't the field's level."""
        outward = self.segmentation.outward[self.faces[face]].mean(axis=1) @ fit.rotation.T
        return np.asarray((away * outward).sum(axis=1) >= 0)


def _hierarchy(triangles: FloatArray) -> tuple[FloatArray, IntArray, IntArray]:
    """Boxes, nodes and order of `build_hierarchy`, over eights of triangles.

    A scanned surface has a million triangles and is asked for few points, so that building costs
    more than asking. Eights of neighbours are built over as one thing each, of which the hierarchy
    needs the box only.
    """
    corners = triangles.reshape(-1, 3 * CLUSTER, 3)
    boxes, nodes, order = build_hierarchy(boxes_of(corners))
    leaf = nodes[:, 0] < 0
    nodes[leaf, 0] = -1 - CLUSTER * (-1 - nodes[leaf, 0])
    nodes[leaf, 1] *= CLUSTER
    return boxes, nodes, (CLUSTER * order[:, None] + np.arange(CLUSTER)).ravel()


def _along_curve(places: FloatArray, cell_mm: FloatArray) -> NDArray[np.int64]:
    """Rank of each place along Morton's curve through cells: near on it is near in space."""
    index = ((places - places.min(axis=0)) / (4 * cell_mm)).astype(np.int64)
    code = np.zeros(len(places), dtype=np.int64)
    for bit in range(int(index.max(initial=0)).bit_length()):
        for axis in range(3):
            code |= ((index[:, axis] >> bit) & 1) << (3 * bit + axis)
    return code
