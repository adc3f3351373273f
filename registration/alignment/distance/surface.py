"""Prepare a solid's surface, and query nearest points and signed distances on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from design.solids.solid import Solid
from kernels.arrays import FloatArray, IntArray
from registration.alignment.distance.closest import UNKNOWN, nearest
from registration.alignment.distance.curvature import Edges, face_curvature, rim_samples
from registration.alignment.distance.pieces import hierarchy


@dataclass(frozen=True)
class Nearest:
    """Answers for n points.

    Attributes
    ----------
    distance : (n,) float64, mm
        Positive outside the solid.
    foot : (n, 3) float64, mm
        Nearest point of the surface.
    direction : (n, 3) float64
        Unit gradient of the distance.
    face : (n,) int64
        Triangle of the foot.
    """

    distance: FloatArray
    foot: FloatArray
    direction: FloatArray
    face: IntArray


@dataclass(frozen=True)
class ModelSurface:
    """Triangles, their hierarchy and pseudonormals; build with `of`.

    Attributes
    ----------
    triangles : (m, 3, 3) float64, mm
        Corners.
    normals : (m, 7, 3) float64
        Pseudonormals of face, edges ab, bc, ca, corners a, b, c.
    curvature : (m,) float64, 1/mm
        Sum of the principal curvatures, see `registration.alignment.distance.curvature`.
    rims : (r, 3) float64, mm
        Points on its sharp edges.
    boxes, nodes, order : arrays
        See `registration.alignment.distance.pieces.hierarchy`.
    """

    triangles: FloatArray
    normals: FloatArray
    curvature: FloatArray
    rims: FloatArray
    boxes: FloatArray
    nodes: IntArray
    order: IntArray

    @staticmethod
    def of(solid: Solid) -> ModelSurface:
        """Prepare the surface of `solid`; triangles without area are left out."""
        corners = solid.vertices[solid.faces]
        twice = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        kept = np.linalg.norm(twice, axis=1) > 1e-14
        triangles = np.ascontiguousarray(corners[kept])
        faces = solid.faces[kept].astype(np.int64)
        normals = _pseudonormals(faces, triangles, len(solid.vertices))
        edges = Edges.of(faces, triangles)
        curvature, rims = face_curvature(triangles, edges), rim_samples(edges)
        return ModelSurface(triangles, normals, curvature, rims, *hierarchy(triangles))

    @property
    def bounds(self) -> FloatArray:
        """Lowest and highest corner, (2, 3), mm."""
        return self.boxes[0].reshape(2, 3)

    @property
    def centroid(self) -> FloatArray:
        """Centroid of the surface by area, (3,), mm."""
        a, b, c = (self.triangles[:, k] for k in range(3))
        area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        return np.asarray(np.average((a + b + c) / 3, axis=0, weights=area))

    def blurred(self, face: IntArray, blur_mm: float) -> FloatArray:
        """How far a blur of the volume moves its half level at these triangles, (n,), mm.

        A surface of curvature κ moves by -σ²κ/2: a blurred lumen is narrower, a blurred knob
        smaller. First order in σκ (the level sets of a diffused step move by their curvature:
        Osher & Sethian 1988, 10.1016/0021-9991(88)90002-2).
        """
        return np.asarray(-0.5 * blur_mm**2 * self.curvature[face])

    def near_rims(self, points: FloatArray, reach_mm: float) -> NDArray[np.bool_]:
        """Which of (n, 3) points lie within `reach_mm` of a sharp edge."""
        if not len(self.rims):
            return np.zeros(len(points), dtype=np.bool_)
        away, _ = cKDTree(self.rims).query(points, distance_upper_bound=reach_mm)
        return np.asarray(np.isfinite(away))

    def query(self, points: FloatArray, guesses: IntArray = UNKNOWN) -> Nearest:
        """Nearest surface points and signed distances of (n, 3) points, exact.

        `guesses` (n,): triangles that were nearest to the points before they moved a little.
        """
        points = np.ascontiguousarray(points, dtype=np.float64)
        return Nearest(
            *nearest(
                points, self.triangles, self.boxes, self.nodes, self.order, self.normals, guesses
            )
        )


def _pseudonormals(faces: IntArray, triangles: FloatArray, vertices: int) -> FloatArray:
    """Face normals; edge normals summed over both faces; corner normals weighted by angle."""
    a, b, c = (triangles[:, k] for k in range(3))
    face = np.cross(b - a, c - a)
    face /= np.linalg.norm(face, axis=1, keepdims=True)
    corner = np.zeros((vertices, 3))
    for k in range(3):
        here, ahead, back = (triangles[:, (k + j) % 3] for j in (0, 1, 2))
        u, v = ahead - here, back - here
        cosine = np.einsum("ij,ij->i", u, v)
        cosine /= np.linalg.norm(u, axis=1) * np.linalg.norm(v, axis=1)
        angle = np.arccos(np.clip(cosine, -1, 1))
        np.add.at(corner, faces[:, k], angle[:, None] * face)
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
    key, which = np.unique(ends[:, 0] * vertices + ends[:, 1], return_inverse=True)
    edge = np.zeros((len(key), 3))
    np.add.at(edge, which, np.repeat(face, 3, axis=0))
    edges = edge[which].reshape(-1, 3, 3)
    out = np.concatenate([face[:, None], edges, corner[faces]], axis=1)
    return np.asarray(out / np.maximum(np.linalg.norm(out, axis=2, keepdims=True), 1e-30))
