"""Read and write `network.csv`, a straight piece per row; read points with their parents."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple, NoReturn

import numpy as np

from design.errors import NetworkError
from design.files import atomic_replacement
from design.network import VesselNetwork
from design.network_files.pieces import (
    GAP_MM,
    KINDS,
    Pieces,
    chain_pieces,
    check_pieces,
    read_utf8,
)
from design.network_files.swc import PointRow, trees_of_points
from design.units import MM_PER, LengthUnit
from kernels.arrays import FloatArray, IntArray


def read_network_csv(path: Path, unit: LengthUnit) -> VesselNetwork:
    """Read a network whose coordinates are in ``unit`` (radii are in mm, as their columns say).

    The pieces of one vessel are chained into a polyline, whatever their order in the file. A node
    of the file stays a node of the network where its degree isn't 2, where the vessel's number
    changes, or where the radius jumps; a vessel that has such a node within it is cut there.
    Vessels keep the order in which they first appear and nodes that of their numbers, so that a
    file of `write_network_csv` gives back the same network to the bit. Further columns are
    ignored.

    Parameters
    ----------
    path : Path
        The file, UTF-8, separated by commas, semicolons or tabs.
    unit : "um", "mm", "cm", "m" or "in"
        Unit of x0 to z1.

    Returns
    -------
    VesselNetwork
        In mm.

    Raises
    ------
    NetworkError
        Missing column, bad number, unknown kind, broken chain, pieces with a gap, vessel of zero
        length; with the file and the line.
    OSError
        When the file can't be read.
    """
    pieces = parse_pieces(path, read_utf8(path, "CSV"), MM_PER[unit])
    check_pieces(pieces)
    return chain_pieces(pieces)


# Columns: ``vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind,tree``. Pieces that
# meet share a node number; designed flow runs from node0 to node1. Radii are in mm always, as their
# columns say; the coordinates' columns name no unit, so a reader needs it.
_HEADER = "vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind,tree"
COLUMNS = tuple(_HEADER.split(","))


def parse_pieces(path: Path, text: str, mm_per_unit: float) -> Pieces:
    """Turn the text of a `network.csv` into arrays.

    Raises
    ------
    NetworkError
        Column missing or doubled, row of wrong length, unreadable number, unknown kind.
    """
    lines, fields = _fields(path, text)

    def column(name: str, convert: Callable[[str], float]) -> list[float]:
        try:
            return [convert(field) for field in fields[name]]
        except (ValueError, KeyError):
            _blame(path, lines, name, fields[name], convert)

    def columns(names: str, convert: Callable[[str], float]) -> FloatArray:
        return np.array([column(name, convert) for name in names.split()]).T

    return Pieces(
        path=path,
        line=np.array(lines, dtype=np.int64),
        vessel=columns("vessel", int).ravel().astype(np.int64),
        nodes=columns("node0 node1", int).astype(np.int64),
        points=columns("x0 y0 z0 x1 y1 z1", float).reshape(-1, 2, 3) * mm_per_unit,
        radius=columns("radius0_mm radius1_mm", float),
        kind=columns("kind", lambda name: KINDS[name.strip()]).ravel().astype(np.int64),
        tree=columns("tree", int).ravel().astype(np.int64),
    )


def open_table(text: str) -> tuple[Table, list[str]]:
    """Rows below the header, and its column names in lower case.

    Fields are separated by the comma, semicolon or tab that the header has most of. Comments (#)
    and a spreadsheet's ``sep=;`` before the header are passed over.
    """
    stream = io.StringIO(text, newline=None)
    skipped, header = 0, ""
    for header in stream:
        if header.strip() and not header.lstrip().lower().startswith(("#", "sep=")):
            break
        skipped += 1
    separator = max(",;\t", key=header.count)
    names = [name.strip().lower() for name in next(csv.reader([header], delimiter=separator), [])]
    return Table(csv.reader(stream, delimiter=separator), skipped + 1), names


class Table(NamedTuple):
    """Reader of rows, and how many lines stand before them."""

    reader: Iterator[list[str]]
    before: int


def table_rows(path: Path, table: Table, header: Sequence[str]) -> Iterator[tuple[int, list[str]]]:
    """Line number and fields of each row that isn't empty or a comment.

    Raises
    ------
    NetworkError
        For a row of another length than the header.
    """
    for number, row in enumerate(table.reader, start=table.before + 1):
        if not row or row[0].lstrip().startswith("#") or not "".join(row).strip():
            continue
        if len(row) != len(header):
            raise NetworkError(
                f"{path}, line {number}: {len(row)} fields where the header has {len(header)}; "
                "give as many as there are columns"
            )
        yield number, row


def _fields(path: Path, text: str) -> tuple[list[int], dict[str, tuple[str, ...]]]:
    """Line number of each row, and the columns' text by name."""
    reader, header = open_table(text)
    wrong = [name for name in COLUMNS if header.count(name) != 1]
    if wrong:
        raise NetworkError(
            f"{path}, line {reader.before}: column {', '.join(wrong)} missing or doubled; "
            f"the header must name {_HEADER}, or for points with their parents "
            "x,y,z,radius,parent"
        )
    lines: list[int] = []
    rows: list[list[str]] = []
    for line, row in table_rows(path, reader, header):
        lines.append(line)
        rows.append(row)
    if not rows:
        raise NetworkError(f"{path}: no pieces below the header; give at least one vessel")
    return lines, dict(zip(header, zip(*rows, strict=True), strict=True))


def _blame(
    path: Path,
    lines: Sequence[int],
    name: str,
    fields: Sequence[str],
    convert: Callable[[str], float],
) -> NoReturn:
    """Find the field that ``convert`` refused, and say what was wanted."""
    wanted = f"one of {', '.join(KINDS)}" if name == "kind" else "a number"
    if name in ("vessel", "node0", "node1", "tree"):
        wanted = "a whole number"
    for line, field in zip(lines, fields, strict=True):
        try:
            convert(field)
        except (ValueError, KeyError) as exc:
            raise NetworkError(f"{path}, line {line}: {name} is {field!r}; give {wanted}") from exc
    raise NetworkError(f"{path}: column {name} can't be read; give {wanted}")


POINT_COLUMNS: Final = ("x", "y", "z", "radius", "parent")


def has_points(path: Path) -> bool:
    """Whether the columns of a CSV file are those of points with parents.

    Raises
    ------
    OSError
        When the file can't be read.
    """
    _, names = open_table(path.read_text(encoding="utf-8-sig", errors="replace"))
    return set(names) >= set(POINT_COLUMNS)


def read_points_csv(path: Path, unit: LengthUnit) -> VesselNetwork:
    """Read points with the columns x, y, z, radius, parent, and id and kind where they are given.

    Fields are separated by commas, semicolons or tabs. All lengths are in the file's unit. The
    parent is the ``id`` of another row; without a column ``id`` rows are numbered from 0. A root's
    parent is -1 or empty.

    Raises
    ------
    NetworkError
        For a number that can't be read, and as `trees_of_points`; with the line.
    OSError
        When the file can't be read.
    """
    table, names = open_table(read_utf8(path, "CSV"))
    doubled = [name for name in dict.fromkeys(names) if name and names.count(name) > 1]
    if doubled:
        raise NetworkError(f"{path}: column {', '.join(doubled)} is doubled; keep one of each")
    line: list[int] = []
    rows: list[PointRow] = []
    for at, fields in table_rows(path, table, names):
        given = dict(zip(names, (field.strip() for field in fields), strict=True))
        try:
            x, y, z, radius = (float(given[name]) for name in POINT_COLUMNS[:4])
            number = int(given["id"]) if "id" in given else len(rows)
            parent = int(given["parent"] or -1)
            kind = KINDS[given.get("kind") or "artery"]
        except (KeyError, ValueError) as exc:
            raise NetworkError(
                f"{path}, line {at}: {','.join(fields)!r} isn't {', '.join(names)}; "
                "id and parent are whole numbers (parent -1: a root), kind is one of "
                f"{', '.join(KINDS)}"
            ) from exc
        if parent < -1:
            raise NetworkError(
                f"{path}, line {at}: parent {parent} isn't a row; give -1 for a root"
            )
        if parent == number:
            start = "" if "id" in names else "; rows count from 0, or give a column id"
            raise NetworkError(f"{path}, line {at}: point {number} is its own parent{start}")
        line.append(at)
        rows.append((number, kind, x, y, z, radius, parent))
    return trees_of_points(path, line, rows, np.full(4, MM_PER[unit]))


_BATCH_ROWS: Final = 20_000
"""Written at a time."""


def write_network_csv(path: Path, network: VesselNetwork) -> None:
    """Write ``network`` in mm; every number reads back to the same bits.

    Inner points of the polylines get node numbers after the network's own. A node without a
    vessel has no row.

    Raises
    ------
    NetworkError
        When a polyline doesn't start and end on its vessel's nodes.
    OSError
        When the file can't be written.
    """
    number = _point_numbers(network)
    points = _points_on_nodes(network)
    vessel_of_point = np.repeat(np.arange(network.vessel_count), np.diff(network.offset))
    first = np.flatnonzero(vessel_of_point[:-1] == vessel_of_point[1:])
    with atomic_replacement(path) as draft, draft.open("w", encoding="utf-8", newline="") as out:
        # The csv module writes floats by repr, the shortest text that gives the same bits.
        table = csv.writer(out, lineterminator="\n")
        table.writerow(COLUMNS)
        for batch in np.split(first, range(_BATCH_ROWS, len(first), _BATCH_ROWS)):
            table.writerows(_rows(network, vessel_of_point[batch], batch, number, points))


def _rows(
    network: VesselNetwork, vessel: IntArray, first: IntArray, number: IntArray, points: FloatArray
) -> Iterator[tuple[object, ...]]:
    """Return rows of the pieces that begin at the points ``first``."""
    return zip(
        vessel.tolist(),
        number[first].tolist(),
        number[first + 1].tolist(),
        *points[first].T.tolist(),
        *points[first + 1].T.tolist(),
        network.radius[first].tolist(),
        network.radius[first + 1].tolist(),
        network.kind_names()[vessel].tolist(),
        network.tree[vessel].tolist(),
        strict=True,
    )


def _ends(network: VesselNetwork) -> IntArray:
    """First and last point of each vessel, (v, 2)."""
    return np.stack([network.offset[:-1], network.offset[1:] - 1], axis=1)


def _point_numbers(network: VesselNetwork) -> IntArray:
    """Node number in the file of each point, (p,)."""
    ends = _ends(network)
    short = ends[:, 1] <= ends[:, 0]
    if short.any():
        raise NetworkError(
            f"vessel {int(np.argmax(short))} has fewer than two points; give it both ends"
        )
    number = np.full(len(network.points), -1, dtype=np.int64)
    number[ends] = network.vessel_nodes
    inner = np.flatnonzero(number < 0)
    number[inner] = len(network.nodes) + np.arange(len(inner))
    return number


def _points_on_nodes(network: VesselNetwork) -> FloatArray:
    """Points with the ends exactly on the nodes, so that the file agrees with itself."""
    ends = _ends(network)
    at_nodes = network.nodes[network.vessel_nodes]
    gap = np.linalg.norm(network.points[ends] - at_nodes, axis=2).max(axis=1)
    if gap.max() > GAP_MM:
        raise NetworkError(
            f"vessel {int(np.argmax(gap))}: an end of its polyline lies {gap.max():g} mm from its "
            f"node (at most {GAP_MM:g} mm); put the node's own coordinates there"
        )
    points = network.points.copy()
    points[ends] = at_nodes
    return points
