"""Triangulate lumen walls and ports with even triangles; check the wall; smooth its shape."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from design.errors import FlowError
from design.geometry import TriangleTree, build_triangle_tree
from design.geometry.crossings import find_crossings
from design.geometry.surface import Surface
from design.geometry.surface_distances import nearest_feet
from design.hemodynamics.three_d.meshing.lumen_mesh import WALL, MeshPort
from design.hemodynamics.three_d.meshing.wall import LumenWall
from design.network import VesselNetwork
from design.solids.lumen import lumen_solid
from design.solids.remesh import LabelledSurface, remesh
from kernels.arrays import FloatArray, IntArray

_ROUGH: Final = 0.03
"""Of the thinnest radius: how far the surface to begin with is from round."""
_FLAT: Final = 1e-5
"""Radii that an end is drawn out by, so that it is cut flat."""


def wall_surface(network: VesselNetwork, wall: LumenWall, fillet_ratio: float) -> LabelledSurface:
    """Triangulate the lumens of ``network``, with a rim around every port.

    It begins with a solid of the wall's own fillets: the sharp seam of vessels that part at an
    acute angle lies radii away from its fillet, and would fold on the way there.
    Labels are those of `LumenMesh`.

    Raises
    ------
    SolidError
        For a network whose lumens can't be united.
    """
    thinnest = float(network.radius.min())
    nodes = np.array([port.node for port in wall.ports], dtype=np.int64)
    solid = lumen_solid(
        network,
        extend_ends_mm=_FLAT * np.array([port.radius_mm for port in wall.ports]),
        extend_nodes=nodes,
        tolerance_mm=_ROUGH * thinnest,
        fillet_ratio=fillet_ratio,
    )
    points, faces = solid.vertices.astype(np.float64), solid.faces.astype(np.int64)
    rough = LabelledSurface(points, faces, _labels(points, faces, wall.ports))
    return remesh(rough, wall)


def _labels(points: FloatArray, faces: IntArray, ports: tuple[MeshPort, ...]) -> IntArray:
    label = np.full(len(faces), WALL)
    for k, port in enumerate(ports):
        away = points - port.centre
        height = np.abs(away @ port.outward)
        near = np.linalg.norm(away, axis=1) < 1.2 * port.radius_mm
        on = near & (height < 20.0 * _FLAT * port.radius_mm)
        label[on[faces].all(axis=1)] = k + 1
    return label


# Check a lumen's triangulated wall against the intended network before meshing its inside.

_OFF: Final = 0.01
"""Of the lumen's radius: how far a vertex may be off the wall. Where all is well it is 1e-5."""
_LEAST_PORT: Final = 0.6
"""Of a circle's area: a port of straight edges has 0.83 of it, or more (edge ratio 1)."""


def check_surface(surface: LabelledSurface, wall: LumenWall, fillet_ratio: float) -> None:
    """Refuse a surface that isn't the wall's, that crosses itself, or whose ports aren't open.

    Raises
    ------
    FlowError
    """
    _check_ports(surface, wall.ports)
    vertices = surface.vertices[np.unique(surface.faces[surface.label == WALL])]
    off = np.abs(wall.distance(vertices)) / (wall.size(vertices) / wall.ratio)
    worst = int(np.argmax(off))
    if off[worst] > _OFF:
        raise FlowError(
            f"the lumen's wall can't be followed {_near(vertices[worst])}: the fillet there has no "
            f"room between vessels; lower the fillet ratio ({fillet_ratio:g}) to a third, take a "
            f"smaller edge ratio ({wall.ratio:g}), or move vessels apart"
        )
    crossing = find_crossings(surface.vertices, surface.faces).pairs
    if len(crossing):
        place = surface.vertices[surface.faces[crossing[0, 0]]].mean(axis=0)
        raise FlowError(
            f"the lumen's wall crosses itself {_near(place)} ({len(crossing)} pairs of triangles): "
            f"vessels nearly touch there without being joined; lower the fillet ratio "
            f"({fillet_ratio:g}), take a smaller edge ratio ({wall.ratio:g}), or move them apart"
        )


def _near(place: FloatArray) -> str:
    x, y, z = place
    return f"near {x:.3f}, {y:.3f}, {z:.3f} mm"


def _check_ports(surface: LabelledSurface, ports: tuple[MeshPort, ...]) -> None:
    """Refuse ports that aren't the discs they are meant to be."""
    corner = surface.vertices[surface.faces]
    across = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    area = np.bincount(
        surface.label, 0.5 * np.linalg.norm(across, axis=1), minlength=len(ports) + 1
    )
    for k, port in enumerate(ports):
        face_area, disc = float(area[k + 1]), np.pi * port.radius_mm**2
        if not _LEAST_PORT * disc < face_area < disc * (1.0 + 1e-6):
            x, y, z = port.centre
            raise FlowError(
                f"the free end at node {port.node} ({x:.3f}, {y:.3f}, {z:.3f} mm) isn't an open "
                f"disc: {face_area:.3g} of {disc:.3g} mm²; another vessel runs into it, or it is "
                "shorter than it is wide: draw it out, or move it"
            )


# Smooth wall shape from a triangulated lumen surface, for remeshing and curved elements.

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
    wall: Surface, network: VesselNetwork, ports: tuple[MeshPort, ...], ratio: float
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


def axis_places(network: VesselNetwork, ratio: float) -> tuple[FloatArray, FloatArray, IntArray]:
    """Places along the axes, ``ratio`` radii apart; that distance at each, mm; its vessel."""
    start, end, r0, r1, vessel = network.pieces()
    length = np.linalg.norm(end - start, axis=1)
    count = np.ceil(length / (ratio * np.minimum(r0, r1))).astype(np.int64)
    piece = np.repeat(np.arange(len(start)), count)
    step = np.arange(len(piece)) - np.repeat(np.cumsum(count) - count, count)
    t = ((step + 0.5) / count[piece])[:, None]
    radius = (1.0 - t[:, 0]) * r0[piece] + t[:, 0] * r1[piece]
    return (1.0 - t) * start[piece] + t * end[piece], ratio * radius, vessel[piece]
