"""A closed lumen cut flat where the network ends, and told apart into wall and ports."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from manifold3d import Manifold

from design.errors import FlowError
from design.hemodynamics.three_d.lumen_mesh import WALL, MeshPort
from design.network import FloatArray, IntArray
from design.solids.manifolds import subtract, to_manifold
from design.solids.remesh import LabelledSurface

_WIDE: Final = 2.5
"""Port radii around a free end within which the lumen is cut; beyond may be another vessel."""

_DEEP: Final = 2.0
"""Port radii of lumen that are taken away beyond a free end."""

_FLAT: Final = 1e-6
"""Port radii off its plane that still count as in it."""

_SLICES: Final = 64
_LEAST_AREA: Final = 0.1


def cut_ends(
    vertices: FloatArray, faces: IntArray, ports: tuple[MeshPort, ...]
) -> tuple[LabelledSurface, tuple[MeshPort, ...]]:
    """Cut a closed surface at ``ports``; labels are those of `LumenMesh`.

    The ports come back with the middle and the size of what was cut. Pieces that no port leads
    into (specks of a scan, what lay beyond the ends) are left out.

    Raises
    ------
    FlowError
        When the surface doesn't reach a port, or is interrupted between ports.
    SolidError
        When it isn't closed.
    """
    whole = to_manifold(vertices, faces, "the lumen's surface")
    parts = [_arrays(part) for part in subtract(whole, [_tool(p) for p in ports]).decompose()]
    labels = [_labels(points, tris, ports) for points, tris in parts]
    kept = [k for k, label in enumerate(labels) if label.any()]
    found = np.concatenate([[WALL], *(np.unique(labels[k]) for k in kept)])
    for number, port in enumerate(ports):
        if number + 1 not in found:
            raise FlowError(
                f"the lumen's surface doesn't reach node {port.node} at "
                f"{_place(port)}; bring it into the network's frame, or draw it out to there"
            )
    for k in kept:
        _check_through(labels[k], ports)
    start = np.cumsum([0, *(len(parts[k][0]) for k in kept)])
    surface = LabelledSurface(
        np.concatenate([parts[k][0] for k in kept]),
        np.concatenate([parts[k][1] + n for k, n in zip(kept, start, strict=False)]),
        np.concatenate([labels[k] for k in kept]),
    )
    return surface, tuple(_measured(surface, n, port) for n, port in enumerate(ports))


def without_caps(points: FloatArray, faces: IntArray, ports: tuple[MeshPort, ...]) -> IntArray:
    """The faces of a closed surface but those that lie in a port's plane, or beyond it."""
    kept = np.ones(len(faces), dtype=np.bool_)
    for port in ports:
        away = points - port.centre
        beyond = away @ port.outward > -_FLAT * port.radius_mm
        near = np.einsum("nd,nd->n", away, away) < ((_WIDE + _DEEP) * port.radius_mm) ** 2
        kept &= ~(beyond & near)[faces].all(axis=1)
    return faces[kept]


def _place(port: MeshPort) -> str:
    return "(" + ", ".join(f"{x:.4g}" for x in port.centre) + ") mm"


def _tool(port: MeshPort) -> Manifold:
    """A cylinder beyond a port."""
    size = port.radius_mm
    least = np.eye(3)[int(np.argmin(np.abs(port.outward)))]
    first = np.cross(port.outward, least)
    first /= np.linalg.norm(first)
    turn = np.column_stack([first, np.cross(port.outward, first), port.outward, port.centre])
    return Manifold.cylinder(_DEEP * size, _WIDE * size, _WIDE * size, _SLICES).transform(turn)


def _arrays(part: Manifold) -> tuple[FloatArray, IntArray]:
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


def _check_through(label: IntArray, ports: tuple[MeshPort, ...]) -> None:
    here = [ports[k - 1] for k in np.unique(label[label != WALL])]
    if not any(port.inlet for port in here) or all(port.inlet for port in here):
        nodes = ", ".join(str(port.node) for port in here)
        raise FlowError(
            f"the lumen's surface is interrupted: its part at node {nodes} has no "
            f"{'outlet' if here[0].inlet else 'inlet'}; take closed vessels out of the network"
        )


def _measured(surface: LabelledSurface, number: int, port: MeshPort) -> MeshPort:
    """The port with the middle and the size of its faces."""
    corner = surface.points[surface.faces[surface.label == number + 1]]
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
