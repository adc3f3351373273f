"""Write 3D flow in a lumen as VTK XML (`.vtu`) of quadratic tetrahedra, for ParaView."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from pathlib import Path
from typing import Final
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from design.errors import FlowError
from design.files import write_text
from design.hemodynamics.three_d.lagrange import shapes
from design.hemodynamics.three_d.meshing.lumen_mesh import EDGES, LumenMesh
from design.hemodynamics.three_d.solution import Field, WallShear
from kernels.arrays import FloatArray

_QUADRATIC_TETRAHEDRON: Final = 24
_TYPES: Final = {"f8": "Float64", "i8": "Int64", "u1": "UInt8"}


def write_flow_vtu(
    path: Path,
    field: Field,
    wall_shear: WallShear | None = None,
    more: Mapping[str, FloatArray] | None = None,
) -> None:
    """Write velocity, pressure, wall shear (0 inside) and more at the mesh's nodes.

    Cubic velocities are told at the corners and edges' middles, where they are exact.

    Parameters
    ----------
    path : Path
    field : Field
    wall_shear : WallShear, optional
    more : mapping of name to (points,) or (points, 3) float64, optional
        Such as `at_points` of an age; units in the name.

    Raises
    ------
    FlowError
        An array of another length.
    OSError
        When the file can't be written.
    """
    mesh = field.mesh
    data = {
        "velocity_mm_s": at_points(mesh, field.velocity, field.order),
        "pressure_pa": at_points(mesh, field.pressure, field.order - 1)[:, 0],
        **(more or {}),
    }
    if wall_shear is not None:
        traction = np.zeros((len(mesh.points), 3))
        traction[wall_shear.node] = wall_shear.traction
        data |= {"wall_shear_pa": traction}
    write_text(path, _document(mesh, data))


def at_points(mesh: LumenMesh, values: FloatArray, degree: int) -> FloatArray:
    """Values (t, n, c) at elements' nodes of a degree told at the mesh's own points, (p, c)."""
    own = np.concatenate([np.eye(4), np.eye(4)[EDGES].mean(axis=1)])
    by_node = shapes(degree, own)[0]
    at_elements = np.einsum("pn,tnc->tpc", by_node, values)
    at_nodes = np.zeros((len(mesh.points), values.shape[2]))
    at_nodes[mesh.tets] = at_elements
    return at_nodes


def _document(mesh: LumenMesh, data: Mapping[str, FloatArray]) -> str:
    count, cells = len(mesh.points), len(mesh.tets)
    for name, values in data.items():
        if len(values) != count:
            raise FlowError(f"{name}: {len(values)} values for {count} nodes; give one each")
    sections = {
        "PointData": data,
        "Points": {"Points": mesh.points},
        "Cells": {
            "connectivity": mesh.tets.ravel(),
            "offsets": 10 * np.arange(1, cells + 1),
            "types": np.full(cells, _QUADRATIC_TETRAHEDRON, dtype=np.uint8),
        },
    }
    body = "".join(
        f"<{tag}>\n{''.join(_array(n, np.asarray(v)) for n, v in arrays.items())}</{tag}>\n"
        for tag, arrays in sections.items()
    )
    return (
        '<?xml version="1.0"?>\n'
        '<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" '
        'header_type="UInt64">\n<UnstructuredGrid>\n'
        f'<Piece NumberOfPoints="{count}" NumberOfCells="{cells}">\n{body}'
        "</Piece>\n</UnstructuredGrid>\n</VTKFile>\n"
    )


def _array(name: str, values: NDArray[np.generic]) -> str:
    """One DataArray: its length in bytes as UInt64, then little-endian values, in base64."""
    raw = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<")).tobytes()
    text = base64.b64encode(np.uint64(len(raw)).astype("<u8").tobytes() + raw).decode()
    components = 1 if values.ndim == 1 else values.shape[1]
    return (
        f'<DataArray type="{_TYPES[values.dtype.str[1:]]}" Name={quoteattr(name)} '
        f'NumberOfComponents="{components}" format="binary">{text}</DataArray>\n'
    )
