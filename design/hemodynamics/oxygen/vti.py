"""Write the oxygen concentration in the tissue as VTK image data (`.vti`) for ParaView."""

from __future__ import annotations

import base64
import struct
import zlib
from pathlib import Path
from typing import Final
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from design.files import write_text
from design.hemodynamics.oxygen.solution import OxygenSolution

_BLOCK: Final = 1 << 20


def write_oxygen_vti(path: Path, solution: OxygenSolution) -> None:
    """Write ``oxygen_millimolar`` and ``tissue_share``, float32, a point at each cell's middle.

    Raises
    ------
    OSError
        When the file can't be written.
    """
    inner = (slice(1, -1),) * 3
    fields = {
        "oxygen_millimolar": solution.concentration[inner],
        "tissue_share": solution.tissue_share[inner],
    }
    grid = solution.grid
    shape = fields["tissue_share"].shape
    extent = " ".join(f"0 {n - 1}" for n in shape)
    origin = " ".join(repr(float(x)) for x in grid.origin_mm + grid.spacing_mm)
    spacing = " ".join([repr(float(grid.spacing_mm))] * 3)
    arrays = "".join(_array(name, values) for name, values in fields.items())
    write_text(
        path,
        '<?xml version="1.0"?>\n'
        '<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian" header_type="UInt32" '
        'compressor="vtkZLibDataCompressor">\n'
        f'<ImageData WholeExtent="{extent}" Origin="{origin}" Spacing="{spacing}">\n'
        f'<Piece Extent="{extent}">\n<PointData Scalars="oxygen_millimolar">\n'
        f"{arrays}</PointData>\n</Piece>\n</ImageData>\n</VTKFile>\n",
    )


def _array(name: str, values: NDArray[np.float64]) -> str:
    # VTK counts x fastest.
    data = np.ascontiguousarray(values.transpose(2, 1, 0), dtype="<f4").tobytes()
    blocks = [zlib.compress(data[k : k + _BLOCK], 6) for k in range(0, len(data), _BLOCK)]
    last = len(data) % _BLOCK
    head = struct.pack(f"<{3 + len(blocks)}I", len(blocks), _BLOCK, last, *map(len, blocks))
    coded = base64.b64encode(head) + base64.b64encode(b"".join(blocks))
    return (
        f'<DataArray type="Float32" Name={quoteattr(name)} format="binary">'
        f"{coded.decode('ascii')}</DataArray>\n"
    )
