"""Write a network as VTK XML PolyData (`.vtp`) for ParaView and PyVista."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from design.errors import NetworkError
from design.files import write_text
from design.network import VesselNetwork

_VTK_TYPE = {"f8": "Float64", "f4": "Float32", "i8": "Int64", "i4": "Int32", "u1": "UInt8"}


def write_network_vtp(
    path: Path, network: VesselNetwork, per_vessel: Mapping[str, NDArray[np.generic]]
) -> None:
    """Write ``network`` as polylines, one cell a vessel, at full precision.

    Point data: ``radius_mm``. Cell data: ``vessel``, ``kind`` (number of the `VesselKind`),
    ``tree`` and each of ``per_vessel``.

    Parameters
    ----------
    path : Path
        Ends in ``.vtp``.
    network : VesselNetwork
        In mm.
    per_vessel : mapping of name to (v,) or (v, k) array
        Such as flow or wall shear; give the unit in the name.

    Raises
    ------
    NetworkError
        When an array hasn't one row a vessel, or a type VTK doesn't know.
    OSError
        When the file can't be written.
    """
    cells: dict[str, NDArray[np.generic]] = {
        "vessel": np.arange(network.vessel_count),
        "kind": network.kind,
        "tree": network.tree,
        **per_vessel,
    }
    for name, values in cells.items():
        if len(values) != network.vessel_count:
            raise NetworkError(
                f"{name}: {len(values)} values for {network.vessel_count} vessels; give one each"
            )
    points = len(network.points)
    sections = (
        ("PointData", [_array("radius_mm", network.radius)]),
        ("CellData", [_array(name, values) for name, values in cells.items()]),
        ("Points", [_array("Points", network.points)]),
        (
            "Lines",
            [
                _array("connectivity", np.arange(points)),
                _array("offsets", network.offset[1:]),
            ],
        ),
    )
    body = "".join(f"<{tag}>\n{''.join(arrays)}</{tag}>\n" for tag, arrays in sections)
    write_text(
        path,
        '<?xml version="1.0"?>\n'
        '<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt64">\n'
        f'<PolyData>\n<Piece NumberOfPoints="{points}" NumberOfVerts="0" '
        f'NumberOfLines="{network.vessel_count}" NumberOfStrips="0" NumberOfPolys="0">\n'
        f"{body}</Piece>\n</PolyData>\n</VTKFile>\n",
    )


def _array(name: str, values: NDArray[np.generic]) -> str:
    """One DataArray: its length in bytes as UInt64, then little-endian values, in base64."""
    code = values.dtype.str[1:]
    if code not in _VTK_TYPE:
        raise NetworkError(f"{name}: type {values.dtype} isn't one of VTK's; give float64 or int64")
    data = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<")).tobytes()
    text = base64.b64encode(np.uint64(len(data)).astype("<u8").tobytes() + data).decode()
    components = 1 if values.ndim == 1 else values.shape[1]
    return (
        f'<DataArray type="{_VTK_TYPE[code]}" Name={quoteattr(name)} '
        f'NumberOfComponents="{components}" format="binary">{text}</DataArray>\n'
    )
