"""Cut a closed lumen surface flat at the network's ends; label its faces as wall or port."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from manifold3d import Manifold

from design.errors import FlowError
from design.geometry.polyline import vectors_across
from design.geometry.surface import Surface
from design.hemodynamics.three_d.lumen_mesh import WALL, MeshPort
from design.solids.manifolds import subtract, to_manifold
from design.solids.remesh import LabelledSurface
from kernels.arrays import FloatArray, IntArray

_WIDE: Final = 2.5
"""Port radii around a free end within which the lumen is cut; beyond may be another vessel."""

_DEEP: Final = 2.0
"""Port radii of lumen that are taken away beyond a free end."""

_FLAT: Final = 1e-6
"""Port radii off its plane that still count as in it."""

_SLICES: Final = 64
_LEAST_AREA: Final = 0.1


@dataclass(frozen=True)
class CutSurface:
    """A lumen that is flat at its ports.

    Attributes
    ----------
    surface : LabelledSurface
        Closed; labels are those of `LumenMesh`.
    ports : tuple of MeshPort
        With the middle and the size of what was cut.
    wall : Surface
        The wall before the cut, which has no needles along the rims, and goes on beyond them.
    """

    surface: LabelledSurface
    ports: tuple[MeshPort, ...]
    wall: Surface


class _Body(NamedTuple):
    """A connected part before the cut, its caps labelled, and what of it the ports lead into."""

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
    # What lies within a body, a speck of wall in the lumen, has a volume below 0.
    return [body for body in whole.decompose() if body.volume() > 0.0]


def _cut(body: Manifold, ports: tuple[MeshPort, ...]) -> _Body:
    points, faces = manifold_arrays(body)
    pieces = []
    for part in subtract(body, [_tool(port) for port in ports]).decompose():
        corners, triangles = manifold_arrays(part)
        label = _labels(corners, triangles, ports)
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
    """Each port is there, and each part has a way in and one out."""
    reached = {int(k) - 1 for part in parts for k in np.unique(part.label)}
    for number, port in enumerate(ports):
        if number not in reached:
            raise FlowError(
                f"the lumen's surface doesn't reach node {port.node} at "
                f"{_place(port)}; bring it into the network's frame, or draw it out to there"
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
        beyond = away @ port.outward > -_FLAT * port.radius_mm
        near = np.einsum("nd,nd->n", away, away) < ((_WIDE + _DEEP) * port.radius_mm) ** 2
        label[(beyond & near)[faces].all(axis=1)] = k + 1
    return label


def _place(port: MeshPort) -> str:
    return "(" + ", ".join(f"{x:.4g}" for x in port.centre) + ") mm"


def _tool(port: MeshPort) -> Manifold:
    """A cylinder beyond a port."""
    size = port.radius_mm
    turn = np.column_stack([*vectors_across(port.outward), port.outward, port.centre])
    return Manifold.cylinder(_DEEP * size, _WIDE * size, _WIDE * size, _SLICES).transform(turn)


def manifold_arrays(part: Manifold) -> tuple[FloatArray, IntArray]:
    """Vertices (n, 3), mm, and faces (f, 3)."""
    mesh = part.to_mesh64()
    points = np.array(mesh.vert_properties[:, :3], dtype=np.float64)
    return points, np.array(mesh.tri_verts, dtype=np.int64)


def _labels(points: FloatArray, faces: IntArray, ports: tuple[MeshPort, ...]) -> IntArray:
    label = np.full(len(faces), WALL)
    corner = points[faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    for k, port in enumerate(ports):
        away = points - port.centre
        flat = np.abs(away @ port.outward) < _FLAT * port.radius_mm
        near = np.linalg.norm(away, axis=1) < _WIDE * port.radius_mm
        label[(flat & near)[faces].all(axis=1) & (normal @ port.outward > 0.0)] = k + 1
    return label


def _measured(surface: LabelledSurface, number: int, port: MeshPort) -> MeshPort:
    """The port with the middle and the size of its faces."""
    corner = surface.vertices[surface.faces[surface.label == number + 1]]
    twice = np.linalg.norm(
        np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1
    )
    area = 0.5 * float(twice.sum())
    meant = np.pi * port.radius_mm**2
    if not _LEAST_AREA < area / meant < 1.0 / _LEAST_AREA:
        raise FlowError(
            f"the lumen's surface has {area:.3g} mm² at node {port.node} at {_place(port)}, and "
            f"the network {meant:.3g}; bring it into the network's frame"
        )
    centre = (corner.mean(axis=1) * twice[:, None]).sum(axis=0) / twice.sum()
    return replace(port, centre=centre, radius_mm=float(np.sqrt(area / np.pi)))
