"""Read and write `network.csv`: one straight vessel piece per row, full precision."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from design.errors import NetworkError
from design.files import atomic_replacement
from design.network import VesselKind, VesselNetwork
from design.units import MM_PER, LengthUnit
from kernels.arrays import FloatArray, IntArray

# Read a vessel network from a `network.csv` file.


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
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as exc:
        raise NetworkError(f"{path}: not UTF-8 text; save the network as CSV") from exc
    pieces = parse_pieces(path, text, MM_PER[unit])
    check_pieces(pieces)
    return chain_pieces(pieces)


# Parse `network.csv` text into checked arrays of vessel pieces with their line numbers.
#
# Columns: ``vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind,tree``. Pieces that
# meet share a node number; designed flow runs from node0 to node1. Radii are in mm always, as their
# columns say; the coordinates' columns name no unit, so a reader must be told it.

_HEADER = "vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind,tree"
COLUMNS = tuple(_HEADER.split(","))
GAP_MM = 1e-6
"""Pieces that share a node number must meet within this distance, mm."""
_KIND_NUMBER = {kind.name.lower(): int(kind) for kind in VesselKind}


@dataclass(frozen=True)
class Pieces:
    """Straight pieces; piece ``i`` stands in line ``line[i]`` of ``path``.

    Attributes
    ----------
    line, vessel, kind, tree : (n,) int64
        As in the file.
    nodes : (n, 2) int64
        The file's node numbers.
    points : (n, 2, 3) float64, mm
        Both ends.
    radius : (n, 2) float64, mm
        At both ends.
    """

    path: Path
    line: IntArray
    vessel: IntArray
    nodes: IntArray
    points: FloatArray
    radius: FloatArray
    kind: IntArray
    tree: IntArray

    def __len__(self) -> int:
        return len(self.line)

    def fail(self, row: int, text: str) -> NoReturn:
        """Raise `NetworkError` about ``row`` with its file, line and vessel."""
        raise NetworkError(f"{self.path}, line {self.line[row]}, vessel {self.vessel[row]}: {text}")


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
        kind=columns("kind", lambda name: _KIND_NUMBER[name.strip()]).ravel().astype(np.int64),
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
    wanted = f"one of {', '.join(_KIND_NUMBER)}" if name == "kind" else "a number"
    if name in ("vessel", "node0", "node1", "tree"):
        wanted = "a whole number"
    for line, field in zip(lines, fields, strict=True):
        try:
            convert(field)
        except (ValueError, KeyError) as exc:
            raise NetworkError(f"{path}, line {line}: {name} is {field!r}; give {wanted}") from exc
    raise NetworkError(f"{path}: column {name} can't be read; give {wanted}")


def check_pieces(pieces: Pieces) -> None:
    """Raise `NetworkError` for NaN, a radius not above 0, or a piece that joins itself."""
    finite = np.isfinite(pieces.points).all(axis=(1, 2)) & np.isfinite(pieces.radius).all(axis=1)
    if not finite.all():
        pieces.fail(int(np.argmin(finite)), "a number is NaN or infinite; mend the row")
    thin = pieces.radius.min(axis=1) <= 0
    if thin.any():
        row = int(np.argmax(thin))
        pieces.fail(row, f"radius {pieces.radius[row].min():g} mm isn't above 0; mend the row")
    circular = pieces.nodes[:, 0] == pieces.nodes[:, 1]
    if circular.any():
        row = int(np.argmax(circular))
        pieces.fail(row, f"the piece joins node {pieces.nodes[row, 0]} to itself; mend the row")


# Chain straight pieces of a `network.csv` into vessel polylines between nodes.


def chain_pieces(pieces: Pieces) -> VesselNetwork:
    """Make a network of pieces in any order.

    A node of the file stays a node where its degree isn't 2, where the vessel's number changes,
    or where the radius jumps: a polyline has one radius a point, so the vessel is cut there and
    nothing is lost. The other nodes become inner points. Vessels keep the order in which they
    first appear, nodes that of their numbers.

    Raises
    ------
    NetworkError
        A vessel's pieces form no chain, differ in kind or tree, leave a gap, or have no length.
    """
    labels, node = np.unique(pieces.nodes, return_inverse=True)
    node = node.reshape(-1, 2)
    position = _node_positions(pieces, node, len(labels))
    row = _rows_in_flow_order(pieces)
    node, radius = node[row], pieces.radius[row]
    _check_same_kind(pieces, row)

    degree = np.bincount(node.ravel())
    inner = (
        (pieces.vessel[row[:-1]] == pieces.vessel[row[1:]])
        & (node[:-1, 1] == node[1:, 0])
        & (degree[node[:-1, 1]] == 2)
        & (radius[:-1, 1] == radius[1:, 0])
    )
    first = np.flatnonzero(np.r_[True, ~inner])
    count = np.diff(np.r_[first, len(row)])
    last = first + count - 1
    offset = np.r_[0, np.cumsum(count + 1)]
    # A vessel of k pieces has k + 1 points: each piece's start, then the last piece's end.
    is_end = np.zeros(offset[-1], dtype=bool)
    is_end[offset[1:] - 1] = True
    point_node = np.empty(offset[-1], dtype=np.int64)
    point_radius = np.empty(offset[-1])
    point_node[~is_end], point_node[is_end] = node[:, 0], node[last, 1]
    point_radius[~is_end], point_radius[is_end] = radius[:, 0], radius[last, 1]
    kept, ends = np.unique(np.stack([node[first, 0], node[last, 1]], 1), return_inverse=True)

    network = VesselNetwork(
        nodes=position[kept],
        vessel_nodes=ends.reshape(-1, 2),
        kind=pieces.kind[row[first]],
        tree=pieces.tree[row[first]],
        offset=offset,
        points=position[point_node],
        radius=point_radius,
    )
    flat = network.lengths() == 0
    if flat.any():
        pieces.fail(int(row[first[np.argmax(flat)]]), "zero length; move or remove it")
    return network


def fuse_vessels(pieces: Pieces, fusible: NDArray[np.bool_]) -> Pieces:
    """Give vessels of one kind and tree that go on in each other the same number.

    Parameters
    ----------
    pieces : Pieces
    fusible : (m,) bool
        Nodes, by number, at which they may.
    """
    nodes = pieces.nodes
    ends = np.full((2, len(fusible)), -1, dtype=np.int64)
    for side in (0, 1):
        ends[side, nodes[:, 1 - side]] = np.arange(len(pieces))
    degree = np.bincount(nodes.ravel(), minlength=len(fusible))
    into, out = ends[:, fusible & (degree == 2) & (ends >= 0).all(axis=0)]
    alike = (pieces.kind[into] == pieces.kind[out]) & (pieces.tree[into] == pieces.tree[out])
    links = pieces.vessel[np.stack([into, out])[:, alike]]
    size = int(pieces.vessel.max()) + 1
    graph = coo_matrix((np.ones(links.shape[1]), links), shape=(size, size))
    return replace(pieces, vessel=connected_components(graph, directed=False)[1][pieces.vessel])


def join_equal_points(pieces: Pieces) -> Pieces:
    """Make one node of points at the same place, to the bit, and one piece of equal pieces.

    Pieces without length are left out, and of pieces of one kind between the same two points all
    but the first. What is left of a vessel in several runs is several vessels.
    """
    flat = pieces.points.reshape(-1, 3)
    _, first, node = np.unique(flat, axis=0, return_index=True, return_inverse=True)
    nodes = first[node.reshape(-1, 2)]
    key = np.column_stack([np.sort(nodes, axis=1), pieces.kind])
    row = np.sort(np.unique(key, axis=0, return_index=True)[1])
    row = row[nodes[row, 0] != nodes[row, 1]]
    follows = (pieces.vessel[row[1:]] == pieces.vessel[row[:-1]]) & (
        nodes[row[1:], 0] == nodes[row[:-1], 1]
    )
    return Pieces(
        path=pieces.path,
        line=pieces.line[row],
        vessel=np.cumsum(np.r_[True, ~follows]) - 1 if len(row) else pieces.vessel[row],
        nodes=nodes[row],
        points=pieces.points[row],
        radius=pieces.radius[row],
        kind=pieces.kind[row],
        tree=pieces.tree[row],
    )


def _node_positions(pieces: Pieces, node: IntArray, count: int) -> FloatArray:
    """Where each node is first said to be; every other mention must agree."""
    flat, points = node.ravel(), pieces.points.reshape(-1, 3)
    first = np.full(count, len(flat), dtype=np.int64)
    np.minimum.at(first, flat, np.arange(len(flat)))
    gap = np.linalg.norm(points - points[first[flat]], axis=1)
    worst = int(np.argmax(gap))
    if gap[worst] > GAP_MM:
        here, there = worst // 2, int(first[flat[worst]]) // 2
        pieces.fail(
            here,
            f"node {pieces.nodes.ravel()[worst]} lies {gap[worst]:g} mm from where line "
            f"{pieces.line[there]} has it (at most {GAP_MM:g} mm); close the gap or use "
            "another node number",
        )
    return points[first]


def _rows_in_flow_order(pieces: Pieces) -> IntArray:
    """Rows sorted by vessel (in order of first appearance) and along each vessel's flow."""
    _, first, vessel = np.unique(pieces.vessel, return_index=True, return_inverse=True)
    row = np.argsort(first[vessel], kind="stable")
    starts = np.flatnonzero(np.diff(first[vessel][row], prepend=-1))
    ends = np.r_[starts[1:], len(row)]
    joined = pieces.nodes[row[:-1], 1] == pieces.nodes[row[1:], 0]
    breaks = np.r_[0, np.cumsum(~joined)]
    # Files are mostly in order already; only the other vessels take the slow way.
    for start, end in zip(starts, ends, strict=True):
        if breaks[end - 1] != breaks[start]:
            row[start:end] = _sorted_chain(pieces, row[start:end])
    return row


def _sorted_chain(pieces: Pieces, rows: IntArray) -> IntArray:
    """Rows of one vessel, each piece after the one that ends where it starts."""
    leaving: dict[int, int] = {}
    entering: dict[int, int] = {}
    for row in rows.tolist():
        for node, seen, doing in zip(
            pieces.nodes[row].tolist(), (leaving, entering), ("leave", "enter"), strict=True
        ):
            if node in seen:
                pieces.fail(
                    row,
                    f"this piece and that in line {pieces.line[seen[node]]} both {doing} node "
                    f"{node}; a vessel doesn't branch: turn the piece round or give it a vessel "
                    "number of its own",
                )
            seen[node] = row
    heads = [row for node, row in leaving.items() if node not in entering]
    chain = [heads[0] if heads else int(rows[0])]
    while (row_after := leaving.get(int(pieces.nodes[chain[-1], 1]))) not in (None, chain[0]):
        chain.append(row_after)
    if len(chain) != len(rows):
        stray = next(row for row in rows.tolist() if row not in set(chain))
        pieces.fail(
            stray,
            f"broken chain: the piece from node {pieces.nodes[stray, 0]} to "
            f"{pieces.nodes[stray, 1]} isn't joined to the vessel's piece in line "
            f"{pieces.line[chain[-1]]}; share the node's number or give it another vessel number",
        )
    return np.array(chain, dtype=np.int64)


def _check_same_kind(pieces: Pieces, row: IntArray) -> None:
    same = pieces.vessel[row[:-1]] == pieces.vessel[row[1:]]
    for name, values in (("kind", pieces.kind[row]), ("tree", pieces.tree[row])):
        differs = same & (values[:-1] != values[1:])
        if differs.any():
            pieces.fail(
                int(row[1 + np.argmax(differs)]),
                f"its {name} differs from that of its vessel's other pieces; a vessel has one",
            )


# Write a vessel network to a `network.csv` file, in mm.

_BATCH_ROWS = 20_000
_KINDS = np.array([kind.name.lower() for kind in VesselKind])


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
        _KINDS[network.kind[vessel]].tolist(),
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
