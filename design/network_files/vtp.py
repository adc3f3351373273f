"""Read and write networks as VTK XML PolyData (`.vtp`), for ParaView and PyVista."""

from __future__ import annotations

import base64
import binascii
import re
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NoReturn
from xml.sax.saxutils import quoteattr

import numpy as np
from lxml import etree  # type: ignore[import-untyped]
from numpy.typing import NDArray

from design.errors import NetworkError
from design.files import write_text
from design.geometry.vtk import VTK_TYPES, polydata_counts, vtk_document
from design.network import VesselKind, VesselNetwork
from design.network_files.pieces import (
    PathPoints,
    chain_pieces,
    fuse_vessels,
    join_equal_points,
)
from design.units import MM_PER, LengthUnit
from kernels.arrays import FloatArray, IntArray


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
        if values.dtype.str[1:] not in VTK_TYPES:
            raise NetworkError(
                f"{name}: type {values.dtype} isn't one of VTK's; give float64 or int64"
            )
    points = len(network.points)
    sections: dict[str, dict[str, NDArray[np.generic]]] = {
        "PointData": {"radius_mm": network.radius},
        "CellData": cells,
        "Points": {"Points": network.points},
        "Lines": {"connectivity": np.arange(points), "offsets": network.offset[1:]},
    }
    counts = polydata_counts(points, lines=network.vessel_count)
    write_text(path, vtk_document("PolyData", counts, sections))


RADIUS_MM: Final = "radius_mm"
RADII: Final = ("radius", "Radius", "MaximumInscribedSphereRadius")
"""Names of a radius in the unit of the file; the last two are VMTK's."""
_NUMPY: Final = {
    "Float64": "f8", "Float32": "f4", "Int64": "i8", "Int32": "i4", "Int16": "i2", "Int8": "i1",
    "UInt64": "u8", "UInt32": "u4", "UInt16": "u2", "UInt8": "u1",
}  # fmt: skip
_ZLIB: Final = "vtkZLibDataCompressor"
_APPENDED: Final = re.compile(rb"<AppendedData\b([^>]*)>\s*_")


def read_vtp_lines(
    path: Path, unit: LengthUnit, kind: VesselKind = VesselKind.ARTERY
) -> tuple[VesselNetwork, bool]:
    """Read polylines in ``unit``, each a vessel, and whether a network was written so.

    `write_network_vtp` says by cell arrays ``vessel``, ``kind`` and ``tree`` what is a vessel of
    its own; of other lines several may run through one lumen.

    The radius is the point array `RADIUS_MM`, which is in mm, or one of `RADII`, in ``unit``.
    Lines share nodes at equal ends alone: `merge_shared` joins them at other equal points. Data may
    be ascii, binary or appended, as it is or compressed by zlib.

    Parameters
    ----------
    path : Path
    unit : {"um", "mm", "cm", "m", "in"}
    kind : VesselKind
        Where the file has no array ``kind``.

    Raises
    ------
    NetworkError
        When the file can't be read so, has no lines or no radius, or holds impossible numbers.
    OSError
        When the file can't be opened.
    """
    file = _parse(path)
    points = file.points() * MM_PER[unit]
    radius = file.radius(MM_PER[unit], len(points))
    connectivity, offsets = file.lines(len(points))
    _check_numbers(path, points, radius, connectivity)
    sizes = np.diff(np.concatenate([[0], offsets]))
    cell = np.repeat(np.arange(len(sizes)), sizes)
    place, row = points[connectivity], radius[connectivity]
    # A point given twice in a row has no length.
    moves = np.r_[True, (np.diff(place, axis=0) != 0.0).any(axis=1) | (np.diff(cell) > 0)]
    cell, place, row = cell[moves], place[moves], row[moves]
    real = np.bincount(cell, minlength=len(sizes))[cell] > 1
    if not real.any():
        file.fail("no two points of a line are apart; give at least one vessel")
    cell, place, row = cell[real], place[real], row[real]
    kinds = file.cell_numbers("kind", len(sizes), int(kind), len(VesselKind))[cell]
    trees = file.cell_numbers("tree", len(sizes), 0, None)[cell]
    first = np.flatnonzero(np.diff(cell, prepend=-1))
    ends = np.column_stack([first, np.r_[first[1:], len(cell)] - 1])
    tips = place[ends.ravel()]
    _, one, number = np.unique(tips, axis=0, return_index=True, return_inverse=True)
    node = len(tips) + np.arange(len(cell))
    node[ends] = one[number.reshape(-1, 2)]
    at = np.arange(len(cell), dtype=np.float64)
    ways = PathPoints(cell, cell, at, node, place, row)
    pieces = ways.pieces(path, node, cell + 1, kinds, trees)
    known = set(file.cell_arrays())
    if (sizes == 2).all() and "vessel" not in known:
        # SimVascular writes each straight piece as a line.
        pieces = join_equal_points(pieces)
        pieces = fuse_vessels(pieces, np.ones(pieces.nodes.max() + 1, dtype=bool))
    return chain_pieces(pieces), {"vessel", "kind", "tree"} <= known


def _check_numbers(
    path: Path, points: FloatArray, radius: FloatArray, connectivity: IntArray
) -> None:
    bad = ~(np.isfinite(points).all(axis=1) & np.isfinite(radius) & (radius > 0.0))
    used = connectivity[bad[connectivity]]
    if len(used):
        raise NetworkError(
            f"{path}: point {used[0]} has a coordinate or a radius that is NaN, infinite or not "
            f"above 0 ({len(used)} such points); mend the file"
        )


@dataclass(frozen=True)
class _File:
    """The piece of a file, and how its numbers are written."""

    path: Path
    piece: etree._Element
    order: str
    header: str
    compressed: bool
    appended: bytes
    raw: bool

    def fail(self, text: str) -> NoReturn:
        raise NetworkError(f"{self.path}: {text}")

    def points(self) -> FloatArray:
        """Coordinates, (p, 3), in the file's unit."""
        element = self.piece.find("Points/DataArray")
        if element is None:
            self.fail("no points; export the centrelines as PolyData lines")
        return self.numbers(element).astype(np.float64).reshape(-1, 3)

    def radius(self, mm_per_unit: float, count: int) -> FloatArray:
        """Radius of each point, (p,), mm."""
        arrays = {a.get("Name"): a for a in self.piece.findall("PointData/DataArray")}
        for name, scale in ((RADIUS_MM, 1.0), *((name, mm_per_unit) for name in RADII)):
            if name in arrays:
                values = self.numbers(arrays[name]).astype(np.float64) * scale
                if len(values) != count:
                    self.fail(f"{name} has {len(values)} values for {count} points; write it again")
                return values
        raise NetworkError(
            f"{self.path}: no point array {RADIUS_MM} (in mm), {' or '.join(RADII)} (in the "
            f"file's unit); its point arrays are {', '.join(map(str, arrays)) or 'none'}"
        )

    def lines(self, count: int) -> tuple[IntArray, IntArray]:
        """Points of all lines in turn, and where each line ends among them."""
        arrays = {a.get("Name"): a for a in self.piece.findall("Lines/DataArray")}
        if not {"connectivity", "offsets"} <= set(arrays):
            self.fail("no lines; export the centrelines as PolyData lines")
        points, ends = (
            self.numbers(arrays[n]).astype(np.int64) for n in ("connectivity", "offsets")
        )
        if len(ends) == 0:
            self.fail("no lines; give at least one vessel")
        whole = bool(np.diff(ends, prepend=0).min() >= 2) and ends[-1] == len(points)
        if not whole or points.min() < 0 or points.max() >= count:
            self.fail(
                "a line has fewer than two points, or points that aren't there; mend the file"
            )
        return points, ends

    def cell_arrays(self) -> dict[str | None, etree._Element]:
        """Arrays that hold a value for each line, by name."""
        return {a.get("Name"): a for a in self.piece.findall("CellData/DataArray")}

    def cell_numbers(self, name: str, count: int, otherwise: int, below: int | None) -> IntArray:
        """Whole numbers of a cell array, one a line; ``otherwise`` where there is no such array."""
        arrays = self.cell_arrays()
        if name not in arrays:
            return np.full(count, otherwise, dtype=np.int64)
        values = self.numbers(arrays[name]).astype(np.int64)
        if len(values) != count:
            self.fail(f"{name} has {len(values)} values for {count} lines; lines alone are read")
        if below is not None and not ((values >= 0) & (values < below)).all():
            self.fail(
                f"{name} goes from {values.min()} to {values.max()}; 0 to {below - 1} are known"
            )
        return values

    def numbers(self, element: etree._Element) -> NDArray[np.generic]:
        """The values of a DataArray, flat."""
        kind, form = element.get("type", ""), element.get("format", "ascii")
        if kind not in _NUMPY:
            self.fail(f"type {kind or 'missing'} isn't one of VTK's numbers; write it again")
        # Not that of children: VTK's InformationKey.
        text = "".join(element.xpath("text()")).strip()
        try:
            if form == "ascii":
                return np.array(text.split(), dtype=_NUMPY[kind])
            if form == "binary":
                data = self._bytes(text.encode(), 0, raw=False)
                return np.frombuffer(data, dtype=self.order + _NUMPY[kind])
            if form == "appended":
                data = self._bytes(self.appended, int(element.get("offset", "")), raw=self.raw)
                return np.frombuffer(data, dtype=self.order + _NUMPY[kind])
        except (ValueError, IndexError, binascii.Error, zlib.error) as exc:
            self.fail(f"the numbers of {element.get('Name') or 'an array'} can't be read ({exc})")
        raise NetworkError(
            f"{self.path}: data mode {form} isn't known; save it with ascii, binary or appended"
        )

    def _bytes(self, data: bytes, at: int, *, raw: bool) -> bytes:
        """Undo base64, the length in front, and compression, of the numbers that begin ``at``."""
        width = np.dtype(self.header).itemsize

        def decoded(at: int, size: int) -> tuple[bytes, int]:
            """So many bytes, and where the next ones begin."""
            end = at + (size if raw else 4 * -(-size // 3))
            part = data[at:end] if raw else base64.b64decode(data[at:end])
            if len(part) < size:
                raise ValueError(f"{len(part)} of {size} bytes are there")
            return part[:size], end

        first = int(np.frombuffer(decoded(at, width)[0], self.header)[0])
        if not self.compressed:
            return decoded(at, width + first)[0][width:]
        # Three numbers (blocks, their size, that of the last), then each block's compressed size,
        # are encoded apart from the blocks.
        head, at = decoded(at, (3 + first) * width)
        sizes = np.frombuffer(head, self.header)[3:].astype(np.int64)
        blocks, _ = decoded(at, int(sizes.sum()))
        ends = np.cumsum(sizes).tolist()
        starts = [0, *ends[:-1]]
        return b"".join(zlib.decompress(blocks[a:b]) for a, b in zip(starts, ends, strict=True))


def _parse(path: Path) -> _File:
    parser = etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=True)
    text, appended, raw = path.read_bytes(), b"", False
    if found := _APPENDED.search(text):
        # Raw bytes are no XML.
        raw = b"base64" not in found[1]
        appended, text = text[found.end() :], text[: found.start()] + b"</VTKFile>"
    try:
        root = etree.fromstring(text, parser)
    except etree.XMLSyntaxError as exc:
        raise NetworkError(f"{path}: not XML ({exc}); save it as VTK PolyData") from exc
    if root.tag != "VTKFile" or root.get("type") != "PolyData":
        raise NetworkError(f"{path}: not VTK PolyData; export the centrelines as .vtp")
    pieces = root.findall("PolyData/Piece")
    if len(pieces) != 1:
        raise NetworkError(f"{path}: {len(pieces)} pieces where one is read; merge them first")
    compressor = root.get("compressor")
    if compressor not in (None, _ZLIB):
        raise NetworkError(f"{path}: compressed by {compressor}; save it uncompressed or by zlib")
    order = ">" if root.get("byte_order") == "BigEndian" else "<"
    header = order + _NUMPY.get(root.get("header_type", "UInt32"), "u4")
    return _File(path, pieces[0], order, header, compressor is not None, appended, raw)


_CM: Final = 1 / MM_PER["cm"]
_FLAT: Final = 1e-4
"""A component of a unit vector that SimVascular takes for nought."""


def write_simvascular_paths(
    folder: Path, network: VesselNetwork, spacing_mm: float = 0.5, name: str = "path"
) -> list[Path]:
    """Write a path for each run of vessels, for the ``Paths`` folder of a SimVascular project.

    Where vessels meet, the widest that leaves goes on with the path of the widest that enters,
    the next with the next; the others begin there. Files are ``name_0001.pth`` and so on, by the
    number of the first vessel. A path holds no radii; SimVascular draws those as contours.

    The control points are the polyline's, the path's points lie at most ``spacing_mm`` apart on
    it, each with its tangent and a normal (``rotation``). Editing a path in SimVascular fits its
    spline through the control points anew.

    Parameters
    ----------
    folder : Path
    network : VesselNetwork
    spacing_mm : float
    name : str
        Of the files.

    Returns
    -------
    list of Path
        The files.

    Raises
    ------
    NetworkError
        When ``spacing_mm`` isn't above 0.
    OSError
        When a file can't be written.
    """
    if not (np.isfinite(spacing_mm) and spacing_mm > 0.0):
        raise NetworkError(f"spacing_mm is {spacing_mm:g}; give a value above 0")
    runs = vessel_runs(network)
    digits = max(4, len(str(len(runs))))
    files = []
    for number, run in enumerate(runs, start=1):
        files.append(folder / f"{name}_{number:0{digits}d}.pth")
        write_text(files[-1], _document(number, _joined(network, run), spacing_mm))
    return files


def vessel_runs(network: VesselNetwork) -> list[list[int]]:
    """Vessels in runs, first to last node; each vessel is in one run, each run goes with the flow.

    At each node the widest vessel that enters is followed by the widest that leaves, and so on.
    """
    first, last = network.vessel_nodes.T
    entering = _by_width(last, network.radius[network.offset[1:] - 1])
    leaving = _by_width(first, network.radius[network.offset[:-1]])
    heir = np.full(network.vessel_count, -1)
    for node, vessels in entering.items():
        for one, two in zip(vessels, leaving.get(node, ()), strict=False):
            heir[one] = two
    begins = np.ones(network.vessel_count, dtype=bool)
    begins[heir[heir >= 0]] = False
    runs: list[list[int]] = []
    seen = np.zeros(network.vessel_count, dtype=bool)
    # Rings have no beginning: they come last, begun anywhere.
    for start in (*np.flatnonzero(begins), *np.flatnonzero(~begins)):
        run: list[int] = []
        vessel = int(start)
        while vessel >= 0 and not seen[vessel]:
            seen[vessel] = True
            run.append(vessel)
            vessel = int(heir[vessel])
        if run:
            runs.append(run)
    return sorted(runs)


def _by_width(node: IntArray, radius: FloatArray) -> dict[int, list[int]]:
    """Vessels at each node, widest first."""
    vessels: dict[int, list[int]] = {}
    for i in np.argsort(-radius, kind="stable").tolist():
        vessels.setdefault(int(node[i]), []).append(i)
    return vessels


def _joined(network: VesselNetwork, run: list[int]) -> FloatArray:
    """Points of a run of vessels, (k, 3), mm, without repeated places."""
    points = np.concatenate([network.polyline(i)[0] for i in run])
    moves = np.r_[True, np.linalg.norm(np.diff(points, axis=0), axis=1) > 0.0]
    kept: FloatArray = points[moves]
    return kept


def _along(points: FloatArray, spacing_mm: float) -> tuple[FloatArray, FloatArray]:
    """Places at most ``spacing_mm`` apart on a polyline, its own points among them; tangents."""
    step = np.diff(points, axis=0)
    length = np.linalg.norm(step, axis=1)
    parts = np.maximum(1, np.ceil(length / spacing_mm)).astype(np.int64)
    piece = np.repeat(np.arange(len(step)), parts)
    part = np.arange(len(piece)) - np.repeat(np.cumsum(parts) - parts, parts)
    place = points[piece] + step[piece] * (part / parts[piece])[:, None]
    tangent = (step / length[:, None])[piece]
    return np.concatenate([place, points[-1:]]), np.concatenate([tangent, tangent[-1:]])


def _normals(tangent: FloatArray) -> FloatArray:
    """Unit normals (n, 3) to unit tangents, by SimVascular's rule.

    (0, 1, -t_y/t_z) where t_z isn't nought, else (1, -t_x/t_y, 0), else (0, 0, 1), to length 1.
    """
    x, y, z = tangent.T
    nought, one = np.zeros_like(x), np.ones_like(x)
    with np.errstate(divide="ignore", invalid="ignore"):
        steep = np.column_stack([nought, one, -y / z])
        level = np.column_stack([one, -x / y, nought])
    along_x = np.column_stack([nought, nought, one])
    chosen = np.where((np.abs(y) > _FLAT)[:, None], level, along_x)
    chosen = np.where((np.abs(z) > _FLAT)[:, None], steep, chosen)
    unit: FloatArray = chosen / np.linalg.norm(chosen, axis=1)[:, None]
    return unit


def _document(number: int, points: FloatArray, spacing_mm: float) -> str:
    """Text of a path file, as SimVascular's sv4guiPathIO writes and reads it."""
    place, tangent = _along(points, spacing_mm)
    normal = _normals(tangent)
    # Method 0 is a fixed total number of points.
    how = f'method="0" calculation_number="{len(place)}" spacing="0"'
    controls = "\n".join(_element("point", p * _CM, i) for i, p in enumerate(points))
    rows = "\n".join(
        f'<path_point id="{i}">{_element("pos", p * _CM)}{_element("tangent", t)}'
        f"{_element('rotation', n)}</path_point>"
        for i, (p, t, n) in enumerate(zip(place, tangent, normal, strict=True))
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<path id="{number}" {how} version="1.0" reslice_size="5" point_2D_display_size="" '
        f'point_size="">\n<timestep id="0">\n<path_element {how}>\n'
        f"<control_points>\n{controls}\n</control_points>\n"
        f"<path_points>\n{rows}\n</path_points>\n"
        "</path_element>\n</timestep>\n</path>\n"
    )


def _element(tag: str, values: FloatArray, number: int | None = None) -> str:
    numbered = "" if number is None else f" id={quoteattr(str(number))}"
    x, y, z = values.tolist()
    return f'<{tag}{numbered} x="{x!r}" y="{y!r}" z="{z!r}"/>'
