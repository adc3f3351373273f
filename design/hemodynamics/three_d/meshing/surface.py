"""Triangulate lumen walls and ports with even triangles; check the wall; smooth its shape."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from design.errors import FlowError
from design.geometry import TriangleTree, build_triangle_tree
from design.geometry.crossings import find_crossings
from design.geometry.surface import Surface
from design.geometry.surface_distances import nearest_feet
from design.hemodynamics.three_d.meshing.lumen_mesh import WALL, MeshPort
from design.hemodynamics.three_d.meshing.wall import LumenWall, drop_into_ports, ports_of
from design.network import VesselNetwork
from design.solids.lumen import lumen_solid
from design.solids.repair.remesh import LabelledSurface, remesh
from kernels.arrays import FloatArray, IntArray


class _Tolerances(NamedTuple):
    """Tolerances of a wall's triangles, in the lumen's radii."""

    facet: float = 0.03  # of the thinnest radius: greatest distance of the first surface from round
    flat_end: float = 1e-5  # by which an end is drawn out, so that it is cut flat
    off_wall: float = (
        0.01  # greatest distance of a vertex from the wall; it is 1e-5 where all is well
    )
    port: float = 0.6  # least area of a port over its circle's; straight edges leave 0.83


_TOLERANCES: Final = _Tolerances()


def wall_surface(network: VesselNetwork, wall: LumenWall, fillet_ratio: float) -> LabelledSurface:
    """Triangulate the lumens of ``network``, with a rim around every port.

    It begins with a solid of the wall's own fillets: a sharp seam between vessels at an acute
    angle would fold on the way to its fillet. Labels are those of `LumenMesh`.

    Raises
    ------
    SolidError
        For a network whose lumens can't be united.
    """
    solid = lumen_solid(
        network,
        extend_ends_mm=_TOLERANCES.flat_end * np.array([port.radius_mm for port in wall.ports]),
        extend_nodes=np.array([port.node for port in wall.ports], dtype=np.int64),
        tolerance_mm=_TOLERANCES.facet * float(network.radius.min()),
        fillet_ratio=fillet_ratio,
    )
    points, faces = solid.vertices.astype(np.float64), solid.faces.astype(np.int64)
    label = port_labels(points, faces, wall.ports, 20.0 * _TOLERANCES.flat_end, 1.2)
    return remesh(LabelledSurface(points, faces, label), wall)


def port_labels(
    points: FloatArray, faces: IntArray, ports: tuple[MeshPort, ...], flat: float, reach: float
) -> IntArray:
    """Label the faces of each port: in its plane, outward, within ``reach`` of its radii."""
    label = np.full(len(faces), WALL)
    corner = points[faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    for k, port in enumerate(ports):
        away = points - port.centre
        on = np.abs(away @ port.outward) < flat * port.radius_mm
        near = np.linalg.norm(away, axis=1) < reach * port.radius_mm
        label[(on & near)[faces].all(axis=1) & (normal @ port.outward > 0.0)] = k + 1
    return label


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
    if off[worst] > _TOLERANCES.off_wall:
        raise FlowError(
            f"the lumen's wall can't be followed near {place_text(vertices[worst])}: the fillet "
            f"there has no room between vessels; lower the fillet ratio ({fillet_ratio:g}) to a "
            f"third, take a smaller edge ratio ({wall.ratio:g}), or move vessels apart"
        )
    refuse_crossings(
        surface,
        "vessels nearly touch there without being joined; lower the fillet ratio "
        f"({fillet_ratio:g}), take a smaller edge ratio ({wall.ratio:g}), or move them apart",
    )


def refuse_crossings(surface: LabelledSurface, remedy: str) -> None:
    """Raise `FlowError` if triangles pass through others: Netgen would end the process."""
    crossing = find_crossings(surface.vertices, surface.faces).pairs
    if len(crossing):
        place = surface.vertices[surface.faces[crossing[0, 0]]].mean(axis=0)
        raise FlowError(
            f"the lumen's wall crosses itself near {place_text(place)} "
            f"({len(crossing)} pairs of triangles): {remedy}"
        )


def place_text(place: FloatArray) -> str:
    """Return coordinates in mm as text."""
    return "(" + ", ".join(f"{x:.4g}" for x in place) + ") mm"


def _check_ports(surface: LabelledSurface, ports: tuple[MeshPort, ...]) -> None:
    corner = surface.vertices[surface.faces]
    across = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    area = np.bincount(
        surface.label, 0.5 * np.linalg.norm(across, axis=1), minlength=len(ports) + 1
    )
    for k, port in enumerate(ports):
        face_area, disc = float(area[k + 1]), np.pi * port.radius_mm**2
        if not _TOLERANCES.port * disc < face_area < disc * (1.0 + 1e-6):
            raise FlowError(
                f"the free end at node {port.node} at {place_text(port.centre)} isn't an open "
                f"disc: {face_area:.3g} of {disc:.3g} mm²; another vessel runs into it, or it is "
                "shorter than it is wide: draw it out, or move it"
            )


class _Rounding(NamedTuple):
    """Constants of a rounded surface."""

    # Of the way from a facet to its corners' tangent planes: half makes any quadratic height out of
    # its values and slopes (after Boubekeur & Alexa 2008, who take 3/4 for looks).
    share: float = 0.5
    rim_steps: int = 8  # of projecting a rim onto wall and port in turn
    spacing: float = 0.5  # radii between places on an axis
    neighbours: int = 16  # places on axes tried for a point of the wall
    crease: float = 0.85  # cosine between a facet's and a corner's normal that isn't rounded
    needle: float = 1e-4  # twice a facet's area over its longest edge's square: no normal


_ROUNDING: Final = _Rounding()


@dataclass(frozen=True)
class FacetWall:
    """Triangles between ports, rounded by their corners' normals; a `Shape` to remesh by."""

    wall: Surface  # without the ports
    normals: FloatArray  # (f, 3, 3), unit, outward, at each face's corners
    tree: TriangleTree  # of the faces
    axis: cKDTree  # places on the vessels' axes
    radius: FloatArray  # (k,), mm, of the lumen there
    ports: tuple[MeshPort, ...]
    ratio: float  # wanted edge length over the lumen's radius

    def size(self, points: FloatArray) -> FloatArray:
        """Return the wanted edge length at each point, mm: a share of its vessel's radius."""
        count = min(_ROUNDING.neighbours, len(self.radius))
        away, near = self.axis.query(points, k=count, workers=1)
        away, near = away.reshape(len(points), -1), near.reshape(len(points), -1)
        radius = self.radius[near]
        # Of a thin vessel beside a wide one the nearest axis isn't the one.
        best = np.argmin(np.abs(away / radius - 1.0), axis=1)
        return np.asarray(self.ratio * radius[np.arange(len(points)), best])

    def onto(self, points: FloatArray, patch: IntArray) -> FloatArray:
        """Move points onto the wall, onto their port, or onto the rim between (see `Shape`)."""
        moved = np.array(points, dtype=np.float64)
        port = ports_of(patch)
        drop_into_ports(moved, port, self.ports)
        wall, rim = patch == 0, patch < 0
        if wall.any():
            moved[wall] = self._rounded(moved[wall])
        for _ in range(_ROUNDING.rim_steps if rim.any() else 0):
            moved[rim] = self._rounded(moved[rim])
            drop_into_ports(moved, np.where(rim, port, -1), self.ports)
        return moved

    def _rounded(self, points: FloatArray) -> FloatArray:
        """Return the facets' nearest places, moved half way to the corners' tangent planes."""
        feet = nearest_feet(self.tree, points)
        corner = self.wall.faces[feet.face]
        foot = np.einsum("nk,nkd->nd", feet.weight, self.wall.vertices[corner])
        normal = self.normals[feet.face]
        above = np.einsum("nkd,nkd->nk", foot[:, None] - self.wall.vertices[corner], normal)
        lift = np.einsum("nk,nk,nkd->nd", feet.weight, above, normal)
        return np.asarray(foot - _ROUNDING.share * lift)


def facet_wall(
    wall: Surface, network: VesselNetwork, ports: tuple[MeshPort, ...], ratio: float
) -> FacetWall:
    """Make the shape of a wall's triangles, without those of ports.

    The network's radii are the lumen's; ``ratio`` is the wanted edge length over them.
    """
    tree = build_triangle_tree(wall.vertices, wall.faces.astype(np.int32))
    axis, radius, _ = axis_places(network, _ROUNDING.spacing)
    normals = corner_normals(wall.vertices, wall.faces)
    return FacetWall(wall, normals, tree, cKDTree(axis), radius / _ROUNDING.spacing, ports, ratio)


def corner_normals(points: FloatArray, faces: NDArray[np.integer[Any]]) -> FloatArray:
    """Compute unit normals at the faces' corners, (f, 3, 3), from the faces around, by angle.

    Angles don't depend on how a flat place is cut into triangles, as areas and counts do
    (Thürmer & Wüthrich 1998). On a crease a face keeps its own normal.
    """
    corner = points[faces]
    away = corner[:, [1, 2, 0]] - corner
    back = corner[:, [2, 0, 1]] - corner
    across = np.cross(away, back)
    angle = np.arctan2(np.linalg.norm(across, axis=2), np.einsum("fkd,fkd->fk", away, back))
    area = np.linalg.norm(across[:, 0], axis=1)
    angle[area < _ROUNDING.needle * np.einsum("fkd,fkd->fk", away, away).max(axis=1)] = 0.0
    own = _unit(across[:, 0])
    around = np.zeros_like(points)
    for k in range(3):
        np.add.at(around, faces[:, k], angle[:, k, None] * own)
    normals = _unit(around)[faces]
    crease = np.einsum("fkd,fd->fk", normals, own) < _ROUNDING.crease
    return np.where(crease[..., None], own[:, None], normals)


def _unit(vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1), 1e-300)[:, None])


def axis_places(network: VesselNetwork, ratio: float) -> tuple[FloatArray, FloatArray, IntArray]:
    """Place points along the axes, ``ratio`` radii apart; also that distance, mm, and vessel."""
    start, end, r0, r1, vessel = network.pieces()
    length = np.linalg.norm(end - start, axis=1)
    count = np.ceil(length / (ratio * np.minimum(r0, r1))).astype(np.int64)
    piece = np.repeat(np.arange(len(start)), count)
    step = np.arange(len(piece)) - np.repeat(np.cumsum(count) - count, count)
    t = ((step + 0.5) / count[piece])[:, None]
    radius = (1.0 - t[:, 0]) * r0[piece] + t[:, 0] * r1[piece]
    return (1.0 - t) * start[piece] + t * end[piece], ratio * radius, vessel[piece]
