"""Write the scanned surface with its deviation, and the measured axes, as VTP for ParaView."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from design.files import write_text
from design.geometry.polyline import arc_lengths, places_along
from design.network import VesselNetwork
from registration.result import RegistrationReport

Numbers = NDArray[np.generic]

_VTK_TYPE = {"f8": "Float64", "f4": "Float32", "i8": "Int64", "i4": "Int32", "u1": "UInt8"}


def write_surface_vtp(path: Path, report: RegistrationReport) -> None:
    """The scanned surface after the scaled fit, part frame, mm, as VTK XML PolyData.

    Point data: ``deviation_um`` (scaled fit) and ``rigid_deviation_um``, NaN where the surface
    wasn't seen; ``seen`` (0 or 1).

    Raises
    ------
    OSError
        When the file can't be written.
    """
    again = report.scaled_scan_to_part @ np.linalg.inv(report.transform_scan_to_part)
    vertices = report.surface.vertices @ again[:3, :3].T + again[:3, 3]
    values: dict[str, Numbers] = {
        "deviation_um": report.scaled_deviation_um.astype(np.float32),
        "rigid_deviation_um": report.deviation_um.astype(np.float32),
        "seen": report.seen.astype(np.uint8),
    }
    faces = report.surface.faces.astype(np.int32)
    offsets = 3 * np.arange(1, len(faces) + 1, dtype=np.int32)
    _write(path, vertices.astype(np.float32), ("Polys", faces.ravel(), offsets), values)


def write_axes_vtp(path: Path, network: VesselNetwork, report: RegistrationReport) -> None:
    """The measured sections of each vessel as points on its designed axis, joined by a line.

    Point data: ``vessel``, ``along_mm``, ``diameter_um``, ``ovality``, ``offset_um``,
    ``noise_um``. ParaView's Tube filter draws them by diameter.

    Raises
    ------
    OSError
        When the file can't be written.
    """
    gauges = [gauge for gauge in report.vessels if gauge.sections > 0]
    points = [_on_axis(network, gauge.vessel, gauge.along_mm) for gauge in gauges]
    counts = [gauge.sections for gauge in gauges]
    values: dict[str, Numbers] = {
        "vessel": np.repeat([gauge.vessel for gauge in gauges], counts).astype(np.int32),
        "along_mm": _joined([gauge.along_mm for gauge in gauges]),
        "diameter_um": _joined([gauge.diameter_um for gauge in gauges]),
        "ovality": _joined([gauge.ovality_along for gauge in gauges]),
        "offset_um": _joined([gauge.offset_along_um for gauge in gauges]),
        "noise_um": _joined([gauge.noise_um for gauge in gauges]),
    }
    places = np.concatenate([np.empty((0, 3)), *points])
    ends = np.cumsum(counts).astype(np.int64)
    _write(path, places, ("Lines", np.arange(len(places)), ends), values)


def _joined(parts: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    return np.concatenate([np.empty(0), *parts])


def _on_axis(
    network: VesselNetwork, vessel: int, along: NDArray[np.float64]
) -> NDArray[np.float64]:
    points, _ = network.polyline(vessel)
    upto = arc_lengths(points)
    return places_along(points, upto, along)


def _write(
    path: Path,
    points: Numbers,
    cells: tuple[str, Numbers, Numbers],
    values: Mapping[str, Numbers],
) -> None:
    kind, connectivity, offsets = cells
    count = {"Polys": 0, "Lines": 0, kind: len(offsets)}
    data = "".join(_array(name, each) for name, each in values.items())
    write_text(
        path,
        '<?xml version="1.0"?>\n'
        '<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt64">\n'
        f'<PolyData>\n<Piece NumberOfPoints="{len(points)}" NumberOfVerts="0" '
        f'NumberOfLines="{count["Lines"]}" NumberOfStrips="0" NumberOfPolys="{count["Polys"]}">\n'
        f"<PointData>\n{data}</PointData>\n"
        f"<Points>\n{_array('Points', points)}</Points>\n"
        f"<{kind}>\n{_array('connectivity', connectivity)}{_array('offsets', offsets)}</{kind}>\n"
        "</Piece>\n</PolyData>\n</VTKFile>\n",
    )


def _array(name: str, values: Numbers) -> str:
    """One DataArray: its length in bytes as UInt64, then little-endian values, in base64."""
    kind = _VTK_TYPE[values.dtype.str[1:]]
    raw = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<")).tobytes()
    text = base64.b64encode(np.uint64(len(raw)).astype("<u8").tobytes() + raw).decode()
    components = 1 if values.ndim == 1 else values.shape[1]
    return (
        f'<DataArray type="{kind}" Name={quoteattr(name)} '
        f'NumberOfComponents="{components}" format="binary">{text}</DataArray>\n'
    )
