"""Straight vessel pieces and labelled polylines: what every reader builds its network of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final, NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from design.errors import NetworkError
from design.geometry.polyline import places_along
from design.network import MAX_MM, VesselKind, VesselNetwork
from kernels.arrays import FloatArray, IntArray

GAP_MM: Final = 1e-6
"""Pieces that share a node number must meet within this distance, mm."""
KINDS: Final = {kind.name.lower(): int(kind) for kind in VesselKind}
"""Number of each kind by its name in files."""
TOWARDS_ROOT: Final = (int(VesselKind.VEIN), int(VesselKind.LYMPH))
"""Kinds whose flow runs towards the root of their tree."""


def read_utf8(path: Path, form: str) -> str:
    """Return a file's text; ``form`` names its format for the message.

    Raises
    ------
    NetworkError
        When it isn't UTF-8.
    OSError
        When it can't be read.
    """
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as exc:
        raise NetworkError(f"{path}: not UTF-8 text; save the network as {form}") from exc


@dataclass(frozen=True)
class Pieces:
    """Straight pieces; piece ``i`` stands in line ``line[i]`` of ``path``."""

    path: Path
    line: IntArray  # (n,), as in the file
    vessel: IntArray  # (n,)
    nodes: IntArray  # (n, 2), the file's node numbers
    points: FloatArray  # (n, 2, 3), mm, both ends
    radius: FloatArray  # (n, 2), mm, at both ends
    kind: IntArray  # (n,), as in the file
    tree: IntArray  # (n,)

    def __len__(self) -> int:
        return len(self.line)

    def where(self, rows: IntArray, **changes: IntArray) -> Pieces:
        """Return some of the pieces, with other values of some attributes."""
        names = ("line", "vessel", "nodes", "points", "radius", "kind", "tree")
        return replace(self, **{name: getattr(self, name)[rows] for name in names} | changes)

    def fail(self, row: int, text: str) -> NoReturn:
        """Raise `NetworkError` about ``row`` with its file, line and vessel."""
        raise NetworkError(f"{self.path}, line {self.line[row]}, vessel {self.vessel[row]}: {text}")


def check_pieces(pieces: Pieces) -> None:
    """Raise `NetworkError` for impossible numbers, or a piece that joins itself."""
    meant = (np.abs(pieces.points) <= MAX_MM).all(axis=(1, 2))
    meant &= (np.abs(pieces.radius) <= MAX_MM).all(axis=1)
    if not meant.all():
        text = f"a number is NaN, infinite or beyond {MAX_MM:g} mm; mend the row or give the unit"
        pieces.fail(int(np.argmin(meant)), text)
    thin = pieces.radius.min(axis=1) <= 0
    if thin.any():
        row = int(np.argmax(thin))
        pieces.fail(row, f"radius {pieces.radius[row].min():g} mm isn't above 0; mend the row")
    circular = pieces.nodes[:, 0] == pieces.nodes[:, 1]
    if circular.any():
        row = int(np.argmax(circular))
        pieces.fail(row, f"the piece joins node {pieces.nodes[row, 0]} to itself; mend the row")


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
    vessel = np.cumsum(np.r_[True, ~follows]) - 1 if len(row) else pieces.vessel[row]
    return pieces.where(row, vessel=vessel, nodes=nodes[row])


def _node_positions(pieces: Pieces, node: IntArray, count: int) -> FloatArray:
    """Place of each node where it is first given; every other mention must agree."""
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


class Labels:
    """Labels of places, and which of them are the same node.

    Parameters
    ----------
    places : sequence of (3,) float64, mm
        Of the first labels.
    """

    def __init__(self, places: Sequence[FloatArray]) -> None:
        self._same = list(range(len(places)))
        self._places = list(places)

    def add(self, place: FloatArray) -> int:
        """Return a new label."""
        self._same.append(len(self._same))
        self._places.append(place)
        return self._same[-1]

    def unite(self, label: int, other: int) -> None:
        """Let a label be the same node as another: there, and not where it was."""
        self._same[self.root(label)] = self.root(other)

    def root(self, label: int) -> int:
        """Return the label that stands for a label's node."""
        while self._same[label] != label:
            label = self._same[label]
        return label

    def roots(self) -> IntArray:
        """Return the same for all labels."""
        root = np.array(self._same)
        while (root[root] != root).any():
            root = root[root]
        return root

    def places(self) -> FloatArray:
        """Return the place of each label itself, (labels, 3), mm."""
        return np.array(self._places)

    def place(self, label: int) -> FloatArray:
        """Return where a label's node is, (3,), mm."""
        return self._places[self.root(label)]


@dataclass
class LabelledPath:
    """A polyline, labels of both its ends, and joints on it."""

    points: FloatArray  # (k, 3), mm
    radius: FloatArray  # (k,), mm
    ends: tuple[int, int]  # labels
    vessel: int  # that it is, or is left of
    # Place along it, counted in its points, and label of each.
    joints: list[tuple[float, int]] = field(default_factory=list)

    @property
    def labelled(self) -> list[tuple[float, int]]:
        """Places along it that have a label."""
        last = float(len(self.points) - 1)
        return [(0.0, self.ends[0]), *self.joints, (last, self.ends[1])]

    def point(self, at: float) -> FloatArray:
        """Return the point at a place along it."""
        k = min(int(at), len(self.points) - 2)
        return self.points[k] + (at - k) * (self.points[k + 1] - self.points[k])

    def rows(self, path: int, kept: NDArray[np.bool_] | None = None) -> PathPoints:
        """Return its points, or only those ``kept``, and its joints in their order along it."""
        index = np.arange(len(self.points), dtype=np.float64)
        inner = index if kept is None else index[kept]
        named = dict.fromkeys(inner.tolist(), -1) | dict(self.labelled)
        at = np.array(sorted(named))
        return PathPoints(
            path=np.full(len(at), path),
            vessel=np.full(len(at), self.vessel),
            at=at,
            label=np.array([named[place] for place in at.tolist()]),
            place=places_along(self.points, index, at),
            radius=np.interp(at, index, self.radius),
        )


class PathPoints(NamedTuple):
    """Points of paths in turn."""

    path: IntArray  # (n,)
    vessel: IntArray  # (n,)
    at: FloatArray  # (n,), place along the path, counted in its points
    label: IntArray  # (n,), -1 for none
    place: FloatArray  # (n, 3), mm
    radius: FloatArray  # (n,), mm

    def where(self, rows: IntArray | NDArray[np.bool_]) -> PathPoints:
        """Return some of the points, by a mask or in an order."""
        return PathPoints._make(column[rows] for column in self)

    @staticmethod
    def joined(parts: Sequence[PathPoints]) -> PathPoints:
        """Return the points of several."""
        return PathPoints._make(np.concatenate(column) for column in zip(*parts, strict=True))

    def nodes(self, labels: Labels) -> IntArray:
        """Return the node of each, (n,), and put what has a label at its node's place."""
        root, named = labels.roots(), self.label >= 0
        node = np.where(named, root[self.label], len(root) + np.arange(len(named)))
        self.place[named] = labels.places()[node[named]]
        return node

    def pieces(
        self, path: Path, node: IntArray, line: IntArray, kind: IntArray, tree: IntArray
    ) -> Pieces:
        """Return the pieces between points of one path; ``line``, ``kind``, ``tree`` of each."""
        row = np.flatnonzero((self.path[:-1] == self.path[1:]) & (node[:-1] != node[1:]))
        ends = np.stack([row, row + 1], axis=1)
        return Pieces(
            path=path,
            line=line[row],
            vessel=self.path[row],
            nodes=node[ends],
            points=self.place[ends],
            radius=self.radius[ends],
            kind=kind[row],
            tree=tree[row],
        )
