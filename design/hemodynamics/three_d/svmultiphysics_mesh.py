"""Write a lumen mesh as SimVascular's mesh-complete folder: linear tetrahedra in VTK, in cm."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from design.errors import FlowError
from design.files import write_text
from design.hemodynamics.three_d.lumen_mesh import WALL, LumenMesh
from kernels.arrays import IntArray

CM_PER_MM: Final = 0.1
_TETRA: Final = 10
_TYPES: Final = {"f8": "Float64", "i4": "Int32", "u1": "UInt8"}

Arrays = Mapping[str, NDArray[Any]]


def face_name(mesh: LumenMesh, label: int) -> str:
    """``wall``, or ``inlet_0``, ``outlet_1``, ...: the port's number behind what it is."""
    if label == WALL:
        return "wall"
    return f"{'inlet' if mesh.ports[label - 1].inlet else 'outlet'}_{label - 1}"


def write_mesh_complete(folder: Path, mesh: LumenMesh) -> None:
    """Write the folder that svMultiPhysics and SimVascular read, from the mesh's corners.

    The elements are straight: nodes on edges are left out, so a lumen loses the sliver between
    its wall and its facets; mesh it finer than for the curved elements. `mesh-complete.mesh.vtu`,
    `mesh-complete.exterior.vtp`, `walls_combined.vtp` and `mesh-surfaces/` with a file a face.
    Numbers (``GlobalNodeID``, ``GlobalElementID``) begin at 1 and are 32 bits, as the solver
    reads nothing else; a face's element is the tetrahedron behind it. ``ModelFaceID`` is the
    label and 1. Faces are outward.

    Raises
    ------
    FlowError
        When straight elements turn inside out, a face belongs to no tetrahedron, or there are
        more nodes or elements than 32 bits count.
    OSError
        When a file can't be written.
    """
    tets, faces = mesh.tets[:, :4], mesh.faces[:, :3]
    _check(mesh, tets)
    points = mesh.points[: mesh.corner_count] * CM_PER_MM
    behind = _element_behind(tets, faces)
    whole = np.arange(len(faces))
    _write_volume(folder / "mesh-complete.mesh.vtu", points, tets)
    surfaces = {"mesh-complete.exterior": whole, "walls_combined": whole[mesh.label == WALL]}
    for label in range(len(mesh.ports) + 1):
        name = f"mesh-surfaces/{face_name(mesh, label)}"
        surfaces[name] = whole[mesh.label == label]
    for name, chosen in surfaces.items():
        cells = {"GlobalElementID": behind[chosen] + 1, "ModelFaceID": mesh.label[chosen] + 1}
        _write_surface(folder / f"{name}.vtp", points, faces[chosen], cells)


def _check(mesh: LumenMesh, tets: IntArray) -> None:
    if max(mesh.corner_count, len(tets)) >= 2**31:
        raise FlowError(f"{len(tets)} elements are more than 32 bits count; mesh coarser")
    p = mesh.points[tets]
    volume = np.einsum(
        "ti,ti->t", np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), p[:, 3] - p[:, 0]
    )
    worst = int(np.argmin(volume))
    if volume[worst] <= 0.0:
        raise FlowError(
            f"tetrahedron {worst} at {p[worst].mean(0).round(3).tolist()} mm is inside out "
            f"without its curved edges (volume {volume[worst] / 6:.3g} mm³); mesh finer there"
        )


def _element_behind(tets: IntArray, faces: IntArray) -> IntArray:
    """The tetrahedron that each face bounds."""
    sides = np.sort(tets[:, [[0, 1, 2], [0, 1, 3], [1, 2, 3], [0, 2, 3]]], axis=2).reshape(-1, 3)
    both = np.concatenate([sides, np.sort(faces, axis=1)])
    _, which = np.unique(both, axis=0, return_inverse=True)
    owner = np.full(int(which.max()) + 1, -1)
    owner[which[: len(sides)]] = np.repeat(np.arange(len(tets)), 4)
    elements = owner[which[len(sides) :]]
    if (elements < 0).any():
        raise FlowError(f"face {int(np.argmin(elements))} bounds no tetrahedron; mesh again")
    return elements


def _write_volume(path: Path, points: NDArray[Any], tets: IntArray) -> None:
    count = len(tets)
    cells: Arrays = {
        "connectivity": _int32(tets.ravel()),
        "offsets": _int32(4 * np.arange(1, count + 1)),
        "types": np.full(count, _TETRA, dtype=np.uint8),
    }
    data: Arrays = {"GlobalElementID": np.arange(1, count + 1), "ModelRegionID": np.ones(count)}
    sections = [
        _section("PointData", {"GlobalNodeID": _int32(np.arange(1, len(points) + 1))}),
        _section("CellData", {name: _int32(values) for name, values in data.items()}),
        _section("Points", {"Points": points}),
        _section("Cells", cells),
    ]
    counts = f'NumberOfPoints="{len(points)}" NumberOfCells="{count}"'
    _write(path, "UnstructuredGrid", counts, sections)


def _write_surface(path: Path, points: NDArray[Any], faces: IntArray, data: Arrays) -> None:
    """Only the nodes that the faces have, which GlobalNodeID leads back to the volume's."""
    nodes, corners = np.unique(faces, return_inverse=True)
    polygons = {
        "connectivity": _int32(corners.ravel()),
        "offsets": _int32(3 * np.arange(1, len(faces) + 1)),
    }
    sections = [
        _section("PointData", {"GlobalNodeID": _int32(nodes + 1)}),
        _section("CellData", {name: _int32(values) for name, values in data.items()}),
        _section("Points", {"Points": points[nodes]}),
        _section("Polys", polygons),
    ]
    counts = f'NumberOfPoints="{len(nodes)}" NumberOfPolys="{len(faces)}"'
    _write(path, "PolyData", counts, sections)


def _int32(values: NDArray[Any]) -> NDArray[np.int32]:
    return values.astype(np.int32)


def _section(tag: str, arrays: Arrays) -> str:
    inside = "".join(_array(name, values) for name, values in arrays.items())
    return f"<{tag}>\n{inside}</{tag}>\n"


def _array(name: str, values: NDArray[Any]) -> str:
    """One DataArray: its length in bytes as UInt64, then little-endian values, in base64."""
    code = values.dtype.str[1:]
    data = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<")).tobytes()
    text = base64.b64encode(np.array(len(data), dtype="<u8").tobytes() + data).decode()
    # Of scalars the number of components isn't given: some readers make columns of them then.
    many = "" if values.ndim == 1 else f'NumberOfComponents="{values.shape[1]}" '
    return (
        f'<DataArray type="{_TYPES[code]}" Name={quoteattr(name)} {many}format="binary">'
        f"{text}</DataArray>\n"
    )


def _write(path: Path, kind: str, counts: str, sections: list[str]) -> None:
    write_text(
        path,
        '<?xml version="1.0"?>\n'
        f'<VTKFile type="{kind}" version="1.0" byte_order="LittleEndian" header_type="UInt64">\n'
        f"<{kind}>\n<Piece {counts}>\n{''.join(sections)}</Piece>\n</{kind}>\n</VTKFile>\n",
    )
