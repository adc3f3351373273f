"""Exports for other programs: tables (CSV), surfaces and axes (VTP), volumes (NRRD).

Goes in: a registration. Comes out: files.
"""

from __future__ import annotations

import csv
import gzip
import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.files import write_bytes, write_text
from design.geometry.polyline import arc_lengths, places_along
from design.geometry.vtk import polydata_counts, vtk_document
from design.network import VesselNetwork
from kernels.arrays import FloatArray
from registration.measuring.judging import list_findings
from registration.result import RegistrationReport, report_dict
from registration.scan import Scan
from registration.segmentation.filters import binned

VESSELS, SECTIONS, DEFECTS = "vessels.csv", "sections.csv", "defects.csv"
ZONES = "characteristics.csv"
_SECTION_COLUMNS = {
    "along_mm": "along_mm",
    "diameter_um": "diameter_um",
    "area_mm2": "area_mm2",
    "ovality_along": "ovality",
    "offset_along_um": "offset_um",
    "noise_um": "noise_um",
    "designed_along_um": "designed_um",
    "interval_95_um": "interval_95_um",
    "lower_um": "lower_um",
    "upper_um": "upper_um",
    "decision_along": "decision",
}


def write_tables(folder: Path, report: RegistrationReport | Mapping[str, Any]) -> tuple[str, ...]:
    """Write vessels, sections, defects and characteristics as CSV; return the files' names.

    A number that isn't known is an empty field. Units stand in the columns' names. Beside what
    was gauged, a vessel's row has its resistance and flow as designed and as printed.

    Parameters
    ----------
    folder : Path
    report : RegistrationReport or mapping
        Or its numbers; decisions stand in the tables of judged ones (`judging.judge`).

    Raises
    ------
    OSError
        When a file can't be written.
    """
    numbers = report_dict(report) if isinstance(report, RegistrationReport) else report
    write_text(folder / VESSELS, as_csv(_rows(numbers)))
    write_text(
        folder / SECTIONS,
        as_csv(_sections(numbers["vessels"]), ("vessel", *_SECTION_COLUMNS.values())),
    )
    write_text(
        folder / DEFECTS, as_csv([_defect(d) for d in list_findings(numbers)], _DEFECT_COLUMNS)
    )
    rows = [_zone(row) for row in numbers.get("characteristics", ())]
    write_text(folder / ZONES, as_csv(rows, _ZONE_COLUMNS))
    return VESSELS, SECTIONS, DEFECTS, ZONES


def vessel_rows(report: RegistrationReport) -> list[dict[str, object]]:
    """Every vessel's deviation, a row each, as `vessels.csv` holds it; None where not known.

    Among the columns are ``designed_um``, ``measured_um``, ``error_percent``, ``rms_um`` and
    ``open`` (`VesselGauge` says what each is), and resistance and flow as designed and as printed.
    """
    return _rows(report_dict(report))


def _rows(numbers: Mapping[str, Any]) -> list[dict[str, object]]:
    vessels = numbers["vessels"]
    flow = numbers["perfusion"]["vessels"] if numbers["perfusion"] else [{}] * len(vessels)
    return [
        {key: value for key, value in vessel.items() if not isinstance(value, list)} | driven
        for vessel, driven in zip(vessels, flow, strict=True)
    ]


_DEFECT_COLUMNS = (
    "kind", "vessel", "other", "from_mm", "to_mm", "at_mm", "x_mm", "y_mm", "z_mm", "size_um",
    "error_um", "percent", "wall_um", "significance", "seen", "doubt", "local", "decision",
    "deviation_um", "deviation_percent", "u_um", "lower_um", "upper_um",
)  # fmt: skip
_ZONE_COLUMNS = (
    "feature", "characteristic", "vessel", "zone_um", "low_um", "high_um", "limit_um", "decision",
    "seen_fraction", "note",
)  # fmt: skip


def as_csv(rows: Sequence[Mapping[str, Any]], columns: Iterable[str] | None = None) -> str:
    """Rows as CSV with a heading; the first row's keys are the columns unless they are given."""
    names = list(columns if columns is not None else rows[0] if rows else ())
    text = io.StringIO()
    table = csv.DictWriter(text, names, restval="", lineterminator="\n", extrasaction="raise")
    table.writeheader()
    table.writerows(
        {key: "" if value is None else value for key, value in row.items()} for row in rows
    )
    return text.getvalue()


def _sections(vessels: Sequence[Mapping[str, Any]]) -> list[dict[str, object]]:
    return [
        {"vessel": vessel["vessel"], **dict(zip(_SECTION_COLUMNS.values(), row, strict=True))}
        for vessel in vessels
        for row in zip(*(_along(vessel, key) for key in _SECTION_COLUMNS), strict=True)
    ]


def _along(vessel: Mapping[str, Any], key: str) -> Sequence[Any]:
    """A list of the vessel's, or as many unknowns where nothing was judged."""
    values: Sequence[Any] = vessel.get(key) or [None] * len(vessel["along_mm"])
    return values


def _zone(row: Mapping[str, Any]) -> dict[str, object]:
    low, high = row["interval_95_um"]
    plain = {**row, "low_um": low, "high_um": high}
    return {name: plain.get(name) for name in _ZONE_COLUMNS}


def _defect(defect: Mapping[str, Any]) -> dict[str, object]:
    plain = dict(defect)
    plain["x_mm"], plain["y_mm"], plain["z_mm"] = plain.pop("point_mm")
    plain["lower_um"], plain["upper_um"] = plain.get("tolerance_um") or (None, None)
    return {name: plain.get(name) for name in _DEFECT_COLUMNS}


Numbers = NDArray[np.generic]


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
    counts = polydata_counts(len(points), lines=count["Lines"], polygons=count["Polys"])
    sections: dict[str, Mapping[str, Numbers]] = {
        "PointData": values,
        "Points": {"Points": points},
        kind: {"connectivity": connectivity, "offsets": offsets},
    }
    write_text(path, vtk_document("PolyData", counts, sections))


def write_scan_nrrd(
    path: Path, scan: Scan, report: RegistrationReport, voxel_mm: float | None = None
) -> None:
    """Write a scan with its registration as the volume's own directions and origin.

    3D Slicer then shows it where the design lies: an STL, PLY or VTP of ours, which Slicer takes
    as left-posterior-superior, is in the same space. The directions are those of the scaled fit:
    a shrunken part is shown at the design's size.

    Parameters
    ----------
    path : Path
        Ends in ``.nrrd``.
    scan : Scan
        The volume.
    report : RegistrationReport
        Of that scan.
    voxel_mm : float, optional
        Voxels are averaged to about this edge, which makes a file of a tenth of the size; the
        scan's own voxels by default.

    Raises
    ------
    OSError
        When the file can't be written.
    """
    volume, voxel, first = _binned(scan, voxel_mm)
    matrix = report.scaled_scan_to_part
    directions = matrix[:3, :3] * voxel
    origin = matrix[:3, :3] @ first + matrix[:3, 3]
    header = nrrd_header(volume, directions, origin, "scan in the frame of its part, mm")
    write_bytes(path, header + gzip.compress(volume.tobytes(), 1))


def _binned(
    scan: Scan, voxel_mm: float | None
) -> tuple[NDArray[np.generic], FloatArray, FloatArray]:
    """Volume, its voxels' edges as x, y, z, and the middle of the first one, mm."""
    edges = np.array(scan.geometric_voxel_mm)
    if voxel_mm is None:
        # NRRD has no bool and no half floats; everything else goes as it is.
        volume: NDArray[np.generic] = np.ascontiguousarray(scan.volume)
        if scan.counts is not None:
            volume = scan.counts.decibels(volume)
        if volume.dtype.kind not in "iu" and volume.dtype not in (np.float32, np.float64):
            volume = volume.astype(np.float32)
        return volume, edges[::-1].copy(), np.zeros(3)
    bins = np.maximum(1, np.round(voxel_mm / edges)).astype(int)
    bins = np.minimum(bins, scan.volume.shape)
    bz, by, bx = bins.tolist()
    volume = binned(scan, (bz, by, bx))
    if scan.volume.dtype.kind in "iu" and scan.scale != "db":
        # Back to whole numbers: half the file, and less noise to compress.
        volume = np.round(volume).astype(scan.volume.dtype)
    return volume, (edges * bins)[::-1].copy(), ((bins - 1) / 2 * edges)[::-1].copy()


def nrrd_header(
    volume: NDArray[np.generic], directions: FloatArray, origin: FloatArray, comment: str
) -> bytes:
    """NRRD0005 header (teem.sourceforge.net/nrrd/format.html); axes from fastest to slowest.

    Parameters
    ----------
    volume : (nz, ny, nx) array
        Follows the header, compressed by gzip.
    directions : (3, 3) float64, mm
        Columns: from a voxel to the next in x, y and z.
    origin : (3,) float64, mm
        Middle of the first voxel.
    comment : str
        What it is, one line of ASCII.
    """
    vectors = " ".join(_vector(directions[:, axis]) for axis in range(3))
    lines = [
        "NRRD0005",
        f"# printctl: {comment}",
        f"type: {_type(volume.dtype)}",
        "dimension: 3",
        "space: left-posterior-superior",
        "sizes: " + " ".join(str(n) for n in volume.shape[::-1]),
        f"space directions: {vectors}",
        "kinds: domain domain domain",
        f"endian: {'big' if volume.dtype.str[0] == '>' else 'little'}",
        "encoding: gzip",
        'space units: "mm" "mm" "mm"',
        f"space origin: {_vector(origin)}",
    ]
    return ("\n".join(lines) + "\n\n").encode("ascii")


def _vector(values: FloatArray) -> str:
    return "(" + ",".join(repr(float(v)) for v in values) + ")"


def _type(dtype: np.dtype[np.generic]) -> str:
    if dtype.kind == "f":
        return "float" if dtype.itemsize == 4 else "double"
    return f"{'u' if dtype.kind == 'u' else ''}int{8 * dtype.itemsize}"
