"""Write a solid as VTK XML PolyData (`.vtp`), in mm, for ParaView and flow solvers."""

from __future__ import annotations

import base64
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from design.files import write_text
from design.solids.solid import Solid


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
