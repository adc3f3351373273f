"""Smooth wall shape from a triangulated lumen surface, for remeshing and curved elements."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from design.geometry import TriangleTree, build_triangle_tree
from design.geometry.surface import Surface
from design.geometry.surface_distances import nearest_feet
from design.hemodynamics.three_d.axes import axis_places
from design.hemodynamics.three_d.lumen_mesh import MeshPort
from design.network import VesselNetwork
from kernels.arrays import FloatArray, IntArray

_ROUNDED: Final = 0.5
"""Share of the way from a facet to its corners' tangent planes. Exactly half makes any quadratic
height out of its values and slopes at the corners (after Boubekeur & Alexa 2008, who take 3/4 for
the eye's sake)."""

_RIM_STEPS: Final = 8
_APART: Final = 0.5
_NEIGHBOURS: Final = 16

_CREASE: Final = 0.85
"""Least cosine between a facet's normal and a corner's; beyond it the corner lies on an edge of the
lumen's own, which isn't rounded."""

_NEEDLE: Final = 1e-4
"""Twice a facet's area over its longest edge's square, below which its normal is rounding's."""


@dataclass(frozen=True)
class FacetWall:
    """Triangles between ports, rounded by their corners' normals; a `Shape` to remesh by.

    Attributes
    ----------
    wall : Surface
        Without the ports.
    normals : (f, 3, 3) float64
        Unit, outward, at each face's corners.
    tree : TriangleTree
        Of the faces.
    axis : cKDTree
        Places on the vessels' axes.
    radius : (k,) float64, mm
        Of the lumen there.
    ports : tuple of MeshPort
    ratio : float
        Wanted edge length over the lumen's radius.
    """

    wall: Surface
    normals: FloatArray
    tree: TriangleTree
    axis: cKDTree
    radius: FloatArray
    ports: tuple[MeshPort, ...]
    ratio: float

    def size(self, points: FloatArray) -> FloatArray:
        """Wanted edge length at each point, mm: a share of the vessel's radius whose wall it is."""
        count = min(_NEIGHBOURS, len(self.radius))
        away, near = self.axis.query(points, k=count, workers=1)
        away, near = away.reshape(len(points), -1), near.reshape(len(points), -1)
        radius = self.radius[near]
        # Of a thin vessel beside a wide one the nearest axis isn't the one.
        best = np.argmin(np.abs(away / radius - 1.0), axis=1)
        return np.asarray(self.ratio * radius[np.arange(len(points)), best])

    def onto(self, points: FloatArray, patch: IntArray) -> FloatArray:
        """Points moved onto the wall, onto their port, or onto the rim between (see `Shape`)."""
        moved = np.array(points, dtype=np.float64)
        port = np.where(patch < 0, -1 - patch, patch) - 1
        self._flatten(moved, port)
        wall, rim = patch == 0, patch < 0
        if wall.any():
            moved[wall] = self._rounded(moved[wall])
        for _ in range(_RIM_STEPS if rim.any() else 0):
            moved[rim] = self._rounded(moved[rim])
            self._flatten(moved, np.where(rim, port, -1))
        return moved

    def _flatten(self, points: FloatArray, port: IntArray) -> None:
        """Drop points into their port's plane; -1 for none."""
        for k, each in enumerate(self.ports):
            mine = port == k
            points[mine] -= np.outer((points[mine] - each.centre) @ each.outward, each.outward)

    def _rounded(self, points: FloatArray) -> FloatArray:
        """The nearest place of the facets, moved half the way to the corners' tangent planes."""
        feet = nearest_feet(self.tree, points)
        corner = self.wall.faces[feet.face]
        foot = np.einsum("nk,nkd->nd", feet.weight, self.wall.vertices[corner])
        normal = self.normals[feet.face]
        above = np.einsum("nkd,nkd->nk", foot[:, None] - self.wall.vertices[corner], normal)
        lift = np.einsum("nk,nk,nkd->nd", feet.weight, above, normal)
        return np.asarray(foot - _ROUNDED * lift)


def facet_wall(
    wall: Surface,
    network: VesselNetwork,
    ports: tuple[MeshPort, ...],
    ratio: float,
) -> FacetWall:
    """Make the shape of a wall's triangles.

    Parameters
    ----------
    wall : Surface
        Without the faces of ports, whose edges would be rounded off.
    network : VesselNetwork
        Says how wide the lumen is where.
    ports : tuple of MeshPort
    ratio : float
        Wanted edge length over the lumen's radius.
    """
    tree = build_triangle_tree(wall.vertices, wall.faces.astype(np.int32))
    axis, radius, _ = axis_places(network, _APART)
    normals = corner_normals(wall.vertices, wall.faces)
    return FacetWall(wall, normals, tree, cKDTree(axis), radius / _APART, ports, ratio)


def corner_normals(points: FloatArray, faces: NDArray[np.integer[Any]]) -> FloatArray:
    """Unit normals at the faces' corners, (f, 3, 3): of the faces around, weighted by angle.

    Angles don't depend on how a flat place is cut into triangles, as areas and counts do
    (Thürmer & Wüthrich 1998). On a crease a face keeps its own normal.
    """
    corner = points[faces]
    away = corner[:, [1, 2, 0]] - corner
    back = corner[:, [2, 0, 1]] - corner
    across = np.cross(away, back)
    angle = np.arctan2(np.linalg.norm(across, axis=2), np.einsum("fkd,fkd->fk", away, back))
    area = np.linalg.norm(across[:, 0], axis=1)
    angle[area < _NEEDLE * np.einsum("fkd,fkd->fk", away, away).max(axis=1)] = 0.0
    own = _unit(across[:, 0])
    around = np.zeros_like(points)
    for k in range(3):
        np.add.at(around, faces[:, k], angle[:, k, None] * own)
    normals = _unit(around)[faces]
    crease = np.einsum("fkd,fd->fk", normals, own) < _CREASE
    return np.where(crease[..., None], own[:, None], normals)


def _unit(vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1), 1e-300)[:, None])
