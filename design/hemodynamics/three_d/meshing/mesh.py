"""Mesh lumens of a network, or given as a surface, with curved tetrahedra and flat ports."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np
from manifold3d import Manifold

from design.errors import FlowError
from design.geometry.polyline import vectors_across
from design.geometry.surface import Surface
from design.hemodynamics.three_d.meshing.curve import curve_edges
from design.hemodynamics.three_d.meshing.lumen_mesh import WALL, LumenMesh, MeshPort
from design.hemodynamics.three_d.meshing.surface import (
    axis_places,
    check_surface,
    facet_wall,
    place_text,
    port_labels,
    refuse_crossings,
    wall_surface,
)
from design.hemodynamics.three_d.meshing.wall import free_ends, lumen_wall
from design.network import VesselNetwork
from design.solids.denoise import denoised
from design.solids.manifolds import subtract, to_manifold
from design.solids.repair.remesh import LabelledSurface, remesh
from kernels.arrays import FloatArray, IntArray


class _Sizes(NamedTuple):
    """Sizes of a lumen's elements."""

    # Longest edge on an axis over that on the wall. On the planar network elements that fold when
    # curved fall from 2,560 of 13,365 to 9 of 8,989.
    on_axis: float = 0.6
    # Edge ratio from which on the inside isn't coarser. Without it straightening takes 1 to 4 % of
    # a fork's volume and adds 3 to 13 % to its resistance (edge ratios 0.8 to 1); so 0.1 and 0.6 %.
    coarsest: float = 0.7
    growth: float = 0.3  # of edges away from the wall: Netgen's grading, 0 to 1
    inside: float = 2.0  # longest edge inside over the longest on the surface


_SIZES: Final = _Sizes()


@dataclass(frozen=True)
class MeshOptions:
    """Options of meshing a network's lumens.

    Attributes
    ----------
    edge_ratio : float
        Length of an edge on the wall over the lumen's radius.
    fillet_ratio : float
        Radius of the fillet at a junction over that of its thinnest vessel.
    """

    edge_ratio: float = 0.7
    fillet_ratio: float = 0.5

    def __post_init__(self) -> None:
        _check_ranges(self, edge_ratio=(0.1, 1.0), fillet_ratio=(0.05, 2.0))


def _check_ranges(options: object, **limits: tuple[float, float]) -> None:
    for name, (low, high) in limits.items():
        value = getattr(options, name)
        if not low <= value <= high:
            raise FlowError(f"{name} {value:g} of a 3D mesh: give {low:g} to {high:g}")


def lumen_mesh(network: VesselNetwork, options: MeshOptions | None = None) -> LumenMesh:
    """Mesh a network's lumens, a port at each of its free ends.

    Parameters
    ----------
    network : VesselNetwork
    options : MeshOptions, optional

    Raises
    ------
    FlowError
        When nothing can flow through (no free ends), for vessels of no length or radius, for a
        free end that another vessel runs into, for a fillet without room, and when Netgen finds
        no mesh or isn't installed.
    SolidError
        When the lumens can't be united.
    """
    options = options or MeshOptions()
    if not np.any(network.degree() == 1):
        raise FlowError("the network has no free ends, so nothing flows in or out; give it some")
    wall = lumen_wall(network, options.fillet_ratio, options.edge_ratio)
    surface = wall_surface(network, wall, options.fillet_ratio)
    check_surface(surface, wall, options.fillet_ratio)
    spacing = _SIZES.on_axis * min(options.edge_ratio, _SIZES.coarsest)
    inside, size, _ = axis_places(network, spacing)
    points, tets = fill(surface, inside, size)
    return curve_edges(surface, points, tets, wall, wall.ports)


@dataclass(frozen=True)
class SurfaceOptions:
    """Options of meshing a lumen given as a surface.

    Attributes
    ----------
    edge_ratio : float
        Length of an edge on the wall over the lumen's radius in the network.
    smooth_passes : int
        Of `denoised`; 0 for a surface that is meant as it is.
    """

    edge_ratio: float = 0.5
    smooth_passes: int = 0

    def __post_init__(self) -> None:
        _check_ranges(self, edge_ratio=(0.1, 1.2), smooth_passes=(0, 1000))


def surface_mesh(
    vertices: FloatArray,
    faces: IntArray,
    network: VesselNetwork,
    options: SurfaceOptions | None = None,
) -> LumenMesh:
    """Mesh the lumen inside a closed surface, a port at each of the network's free ends.

    Parameters
    ----------
    vertices : (n, 3) float64, mm
        In the network's frame.
    faces : (f, 3) integer
        Outward by the right hand. The surface is cut square to the vessels at the free ends, and
        so has to reach them; it may go on beyond.
    network : VesselNetwork
        Its free ends, and about its radii.
    options : SurfaceOptions, optional

    Raises
    ------
    FlowError
        When the network has no free ends, the surface doesn't reach one or is interrupted, and
        when Netgen finds no mesh or isn't installed.
    SolidError
        When the surface isn't closed.
    """
    options = options or SurfaceOptions()
    ends = free_ends(network)
    if not ends:
        raise FlowError("the network has no free ends, so nothing flows in or out; give it some")
    points = denoised(np.asarray(vertices, dtype=np.float64), faces, options.smooth_passes)
    cut = cut_ends(points, np.asarray(faces, dtype=np.int64), ends)
    wall = facet_wall(cut.wall, network, cut.ports, options.edge_ratio)
    surface = remesh(cut.surface, wall)
    refuse_crossings(surface, "take noise off (more smooth_passes), or give a smaller edge_ratio")
    inside, size, _ = axis_places(network, _SIZES.on_axis * options.edge_ratio)
    filled, tets = fill(surface, inside, size)
    return curve_edges(surface, filled, tets, wall, cut.ports)


def fill(
    surface: LabelledSurface, inside: FloatArray, size: FloatArray
) -> tuple[FloatArray, IntArray]:
    """Fill a surface: points (n, 3), its own first, and positively oriented tetrahedra (t, 4).

    At places ``inside`` (k, 3) edges aren't longer than ``size`` (k,), mm. On the vessels' axes
    these give every wall triangle an inner corner of its own: a tetrahedron with all corners on
    the wall is flat, and folds when its edges are bent.

    Raises
    ------
    FlowError
        When Netgen finds no mesh, or isn't installed.
    """
    meshing = _netgen()
    mesh = _bounded(meshing, surface)
    mesh.CalcLocalH(_SIZES.growth, 1)
    for (x, y, z), h in zip(inside.tolist(), size.tolist(), strict=True):
        mesh.RestrictLocalH(meshing.Pnt(x, y, z), h)
    edges = surface.vertices[surface.faces] - surface.vertices[surface.faces[:, [1, 2, 0]]]
    longest = _SIZES.inside * float(np.linalg.norm(edges, axis=2).max())
    try:
        mesh.GenerateVolumeMesh(maxh=longest, grading=_SIZES.growth)
    except Exception as exc:  # Netgen raises its own kind, with no more than a line.
        raise FlowError(f"Netgen found no tetrahedra between the walls: {exc}") from exc
    points = np.array(mesh.Coordinates())  # A view of memory that goes with the mesh.
    tets = np.asarray(mesh.Elements3D().NumPy()["nodes"][:, :4], dtype=np.int64) - 1
    if len(tets) == 0:
        raise FlowError("Netgen found no tetrahedra between the walls; try another mesh size")
    if not np.array_equal(points[: len(surface.vertices)], surface.vertices):
        raise FlowError("Netgen moved the wall; try another mesh size")
    return points, _oriented(points, tets)


def _netgen() -> Any:
    try:
        from netgen import meshing
    except ImportError as exc:
        raise FlowError(
            "3D flow needs the mesh generator Netgen, which isn't installed; "
            "pip install 'printctl[flow3d]', or stay with 0D and 1D"
        ) from exc
    meshing.SetMessageImportance(0)
    return meshing


def _bounded(meshing: Any, surface: LabelledSurface) -> Any:
    """Make a Netgen mesh of the surface alone."""
    mesh = meshing.Mesh(dim=3)
    mesh.AddPoints(np.ascontiguousarray(surface.vertices))
    for label in range(int(surface.label.max()) + 1):
        descriptor = meshing.FaceDescriptor(surfnr=label + 1, domin=1, domout=0, bc=label + 1)
        number = mesh.Add(descriptor)
        mine = surface.faces[surface.label == label]
        if len(mine):
            mesh.AddElements(dim=2, index=number, data=mine.astype(np.int32), base=0)
    return mesh


def _oriented(points: FloatArray, tets: IntArray) -> IntArray:
    edge = points[tets[:, 1:]] - points[tets[:, :1]]
    turned = np.einsum("ij,ij->i", np.cross(edge[:, 0], edge[:, 1]), edge[:, 2]) < 0.0
    tets = tets.copy()
    tets[turned] = tets[turned][:, [0, 2, 1, 3]]
    return tets


class _Cut(NamedTuple):
    """Cylinder that cuts a free end flat; lengths in the port's radii."""

    reach: float = 2.5  # its radius; beyond may be another vessel
    depth: float = 2.0  # its length
    flat: float = 1e-6  # distance from the port's plane that counts as in it
    sides: int = 64
    area: float = 0.1  # least area of the cut over the network's; its inverse is the greatest


_CUT: Final = _Cut()


@dataclass(frozen=True)
class CutSurface:
    """A lumen that is flat at its ports."""

    surface: LabelledSurface  # closed; labels are those of `LumenMesh`
    ports: tuple[MeshPort, ...]  # with the middle and the size of the cut faces
    wall: Surface  # before the cut: without needles along the rims, and beyond them


class _Body(NamedTuple):
    """A connected part before the cut, its caps labelled, and the pieces of it with ports."""

    before: LabelledSurface
    pieces: list[LabelledSurface]


def cut_ends(vertices: FloatArray, faces: IntArray, ports: tuple[MeshPort, ...]) -> CutSurface:
    """Cut a closed surface flat at ``ports``.

    Pieces that no port leads into (specks of a scan, what lay beyond the ends) are left out.

    Raises
    ------
    FlowError
        When the surface doesn't reach a port, or is interrupted between ports.
    SolidError
        When it isn't closed.
    """
    bodies = [_cut(body, ports) for body in _bodies(vertices, faces)]
    kept = [piece for body in bodies for piece in body.pieces]
    _check_reached(kept, ports)
    surface = _joined(kept)
    wall = _joined([body.before for body in bodies if body.pieces])
    return CutSurface(
        surface,
        tuple(_measured(surface, n, port) for n, port in enumerate(ports)),
        Surface(wall.vertices, wall.faces[wall.label == WALL]),
    )


def _bodies(vertices: FloatArray, faces: IntArray) -> list[Manifold]:
    whole = to_manifold(vertices, faces, "the lumen's surface")
    # A speck of wall in the lumen has a volume below 0.
    return [body for body in whole.decompose() if body.volume() > 0.0]


def _cut(body: Manifold, ports: tuple[MeshPort, ...]) -> _Body:
    points, faces = manifold_arrays(body)
    pieces = []
    for part in subtract(body, [_tool(port) for port in ports]).decompose():
        corners, triangles = manifold_arrays(part)
        label = port_labels(corners, triangles, ports, _CUT.flat, _CUT.reach)
        if label.any():
            pieces.append(LabelledSurface(corners, triangles, label))
    return _Body(LabelledSurface(points, faces, _beyond(points, faces, ports)), pieces)


def _joined(parts: list[LabelledSurface]) -> LabelledSurface:
    start = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    return LabelledSurface(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.faces + n for part, n in zip(parts, start, strict=True)]),
        np.concatenate([part.label for part in parts]),
    )


def _check_reached(parts: list[LabelledSurface], ports: tuple[MeshPort, ...]) -> None:
    """Raise `FlowError` if a port is missing, or a part has no inlet or no outlet."""
    reached = {int(k) - 1 for part in parts for k in np.unique(part.label)}
    for number, port in enumerate(ports):
        if number not in reached:
            raise FlowError(
                f"the lumen's surface doesn't reach node {port.node} at {place_text(port.centre)}; "
                "bring it into the network's frame, or draw it out to there"
            )
    for part in parts:
        here = [ports[k - 1] for k in np.unique(part.label[part.label != WALL])]
        if len({port.inlet for port in here}) < 2:
            nodes = ", ".join(str(port.node) for port in here)
            raise FlowError(
                f"the lumen's surface is interrupted: its part at node {nodes} has no "
                f"{'outlet' if here[0].inlet else 'inlet'}; take closed vessels out of the network"
            )


def _beyond(points: FloatArray, faces: IntArray, ports: tuple[MeshPort, ...]) -> IntArray:
    """Label the faces of an uncut surface that lie in a port's plane, or beyond it."""
    label = np.full(len(faces), WALL)
    for k, port in enumerate(ports):
        away = points - port.centre
        beyond = away @ port.outward > -_CUT.flat * port.radius_mm
        near = np.einsum("nd,nd->n", away, away) < ((_CUT.reach + _CUT.depth) * port.radius_mm) ** 2
        label[(beyond & near)[faces].all(axis=1)] = k + 1
    return label


def _tool(port: MeshPort) -> Manifold:
    """Make a cylinder beyond a port."""
    size = port.radius_mm
    turn = np.column_stack([*vectors_across(port.outward), port.outward, port.centre])
    return Manifold.cylinder(
        _CUT.depth * size, _CUT.reach * size, _CUT.reach * size, _CUT.sides
    ).transform(turn)


def manifold_arrays(part: Manifold) -> tuple[FloatArray, IntArray]:
    """Return vertices (n, 3), mm, and faces (f, 3)."""
    mesh = part.to_mesh64()
    points = np.array(mesh.vert_properties[:, :3], dtype=np.float64)
    return points, np.array(mesh.tri_verts, dtype=np.int64)


def _measured(surface: LabelledSurface, number: int, port: MeshPort) -> MeshPort:
    """Return the port with the middle and the size of its faces."""
    corner = surface.vertices[surface.faces[surface.label == number + 1]]
    twice = np.linalg.norm(
        np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1
    )
    area = 0.5 * float(twice.sum())
    meant = np.pi * port.radius_mm**2
    if not _CUT.area < area / meant < 1.0 / _CUT.area:
        raise FlowError(
            f"the lumen's surface has {area:.3g} mm² at node {port.node} at "
            f"{place_text(port.centre)}, and the network {meant:.3g}; bring it into the network's "
            "frame"
        )
    centre = (corner.mean(axis=1) * twice[:, None]).sum(axis=0) / twice.sum()
    return replace(port, centre=centre, radius_mm=float(np.sqrt(area / np.pi)))
