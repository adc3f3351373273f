"""VTK XML text of points, cells and their values, for ParaView and flow solvers."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from typing import Any, Final
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

VTK_TYPES: Final = {"f8": "Float64", "f4": "Float32", "i8": "Int64", "i4": "Int32", "u1": "UInt8"}
"""VTK's names of numpy's types."""


def vtk_document(
    kind: str,
    counts: Mapping[str, int],
    sections: Mapping[str, Mapping[str, NDArray[Any]]],
    *,
    bare_scalars: bool = False,
) -> str:
    """Return a VTK XML file of one piece.

    Parameters
    ----------
    kind : str
        PolyData or UnstructuredGrid.
    counts : mapping
        The piece's attributes, such as NumberOfPoints.
    sections : mapping of tag to arrays by name
    bare_scalars : bool
        Leave out the number of components of scalars: svMultiPhysics reads columns otherwise.
    """
    body = "".join(
        f"<{tag}>\n{''.join(_array(n, v, bare_scalars) for n, v in arrays.items())}</{tag}>\n"
        for tag, arrays in sections.items()
    )
    piece = " ".join(f'{name}="{count}"' for name, count in counts.items())
    return (
        '<?xml version="1.0"?>\n'
        f'<VTKFile type="{kind}" version="1.0" byte_order="LittleEndian" header_type="UInt64">\n'
        f"<{kind}>\n<Piece {piece}>\n{body}</Piece>\n</{kind}>\n</VTKFile>\n"
    )


def polydata_counts(points: int, *, lines: int = 0, polygons: int = 0) -> dict[str, int]:
    """Return the counts of a PolyData piece."""
    return {
        "NumberOfPoints": points,
        "NumberOfVerts": 0,
        "NumberOfLines": lines,
        "NumberOfStrips": 0,
        "NumberOfPolys": polygons,
    }


def _array(name: str, values: NDArray[Any], bare_scalars: bool) -> str:
    """One DataArray: its length in bytes as UInt64, then little-endian values, in base64."""
    raw = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<")).tobytes()
    text = base64.b64encode(np.uint64(len(raw)).astype("<u8").tobytes() + raw).decode()
    components = 1 if values.ndim == 1 else values.shape[1]
    bare = bare_scalars and values.ndim == 1
    width = "" if bare else f'NumberOfComponents="{components}" '
    return (
        f'<DataArray type="{VTK_TYPES[values.dtype.str[1:]]}" Name={quoteattr(name)} {width}'
        f'format="binary">{text}</DataArray>\n'
    )
