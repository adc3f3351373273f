"""Write a solid as STL, OBJ, PLY or VTP."""

from __future__ import annotations

import base64
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.errors import SolidError
from design.files import write_bytes, write_text
from design.geometry.surface import TRIANGLE
from design.solids.solid import Solid
from kernels import jit

_HEADER = b"printctl; mm"
"""STL has no field for a unit; the header is the one place for it."""


def write_stl(path: Path, solid: Solid) -> None:
    """Write ``solid`` as binary STL in mm.

    Raises
    ------
    OSError
        When the file can't be written.
    """
    triangles = np.zeros(len(solid.faces), dtype=TRIANGLE)
    numbers = _numbers(np.ascontiguousarray(solid.vertices), np.ascontiguousarray(solid.faces))
    triangles["normal"] = numbers[:, 0]
    triangles["corners"] = numbers[:, 1:]
    count = np.array(len(triangles), dtype="<u4").tobytes()
    write_bytes(path, b"".join((_HEADER.ljust(80), count, triangles.tobytes())))


@jit
def _numbers(vertices: Any, faces: Any) -> Any:
    """Unit normal and corners of each face, (m, 4, 3); a face without area has no normal."""
    out = np.zeros((len(faces), 4, 3), np.float32)
    for f in range(len(faces)):
        a, b, c = vertices[faces[f, 0]], vertices[faces[f, 1]], vertices[faces[f, 2]]
        ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        length = sqrt(x * x + y * y + z * z)
        if length > 0.0:
            out[f, 0, 0], out[f, 0, 1], out[f, 0, 2] = x / length, y / length, z / length
        for axis in range(3):
            out[f, 1, axis], out[f, 2, axis], out[f, 3, axis] = a[axis], b[axis], c[axis]
    return out


def write_obj(path: Path, solid: Solid) -> None:
    """Write ``solid`` as OBJ in mm (the format has no unit; a comment holds it).

    Raises
    ------
    OSError
        When the file can't be written.
    """
    # Readers that hold doubles need all digits, or faces cross; OBJ counts vertices from 1.
    vertices = "v %.17g %.17g %.17g\n" * len(solid.vertices)
    faces = "f %d %d %d\n" * len(solid.faces)
    text = vertices % tuple(solid.vertices.ravel().tolist())
    text += faces % tuple((solid.faces + 1).ravel().tolist())
    write_text(path, "# printctl; mm\n" + text)


def write_ply(
    path: Path,
    solid: Solid,
    scalar: NDArray[np.floating] | None = None,
    scalar_name: str = "scalar",
) -> None:
    """Write ``solid`` as little-endian PLY in mm.

    Parameters
    ----------
    path : Path
    solid : Solid
    scalar : (n,), optional
        One value a vertex, such as a signed deviation; NaN where there is none.
    scalar_name : str
        Its property in the file; give the unit in it, as in ``deviation_um``.

    Raises
    ------
    SolidError
        When ``scalar`` hasn't one value a vertex, or its name isn't one word.
    OSError
        When the file can't be written.
    """
    fields = [("x", "<f4"), ("y", "<f4"), ("z", "<f4")]
    if scalar is not None:
        if scalar.shape != (len(solid.vertices),):
            raise SolidError(
                f"{scalar_name}: shape {scalar.shape} for {len(solid.vertices)} vertices; "
                "give one value each"
            )
        if not scalar_name.isidentifier() or scalar_name in "xyz":
            raise SolidError(f"scalar_name {scalar_name!r}: give one word of letters and digits")
        fields.append((scalar_name, "<f4"))
    vertices = np.empty(len(solid.vertices), dtype=fields)
    for axis, name in enumerate("xyz"):
        vertices[name] = solid.vertices[:, axis]
    if scalar is not None:
        vertices[scalar_name] = scalar
    faces = np.empty(len(solid.faces), dtype=[("count", "u1"), ("index", "<i4", 3)])
    faces["count"], faces["index"] = 3, solid.faces
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment printctl; mm",
        f"element vertex {len(vertices)}",
        *(f"property float {name}" for name, _ in fields),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    write_bytes(path, "\n".join(header).encode() + vertices.tobytes() + faces.tobytes())


def write_solid_vtp(path: Path, solid: Solid) -> None:
    """Write ``solid`` as VTP in mm.

    Raises
    ------
    OSError
        When the file can't be written.
    """
    faces = solid.faces.astype("<i4")
    points = _array("Points", solid.vertices.astype("<f4"), "Float32", 3)
    corners = _array("connectivity", faces, "Int32", 1)
    offsets = _array("offsets", 3 * np.arange(1, len(faces) + 1, dtype="<i4"), "Int32", 1)
    write_text(
        path,
        '<?xml version="1.0"?>\n'
        '<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt64">\n'
        f'<PolyData><Piece NumberOfPoints="{len(solid.vertices)}" NumberOfPolys="{len(faces)}">\n'
        f"<Points>{points}</Points>\n<Polys>{corners}{offsets}</Polys>\n"
        "</Piece></PolyData>\n</VTKFile>\n",
    )


def _array(name: str, values: NDArray[np.generic], kind: str, components: int) -> str:
    """Inline binary: the byte count, then the bytes, in base64."""
    data = np.ascontiguousarray(values).tobytes()
    packed = base64.b64encode(np.array(len(data), dtype="<u8").tobytes() + data).decode()
    return (
        f'<DataArray Name="{name}" type="{kind}" NumberOfComponents="{components}" '
        f'format="binary">{packed}</DataArray>'
    )
