"""Read and write networks as SWC: trees of points in µm, as in neuroanatomy.

A line is ``number type x y z radius parent``; the radius, too, is in µm, and a root's parent is
-1. Lines that begin with ``#`` are comments. A point has one radius and one parent, so loops
can't be written. Where a vessel's radius at a node differs from its parent's, a point of its own
at the same place keeps it; such a pair reads back as one node.

Types 0 to 4 are neurons', 5 and above are free: `KIND_TYPE`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from design.errors import NetworkError
from design.files import write_text
from design.network import FloatArray, IntArray, VesselKind, VesselNetwork
from design.network_files.csv_format.chain import chain_pieces
from design.network_files.csv_format.pieces import Pieces, check_pieces

KIND_TYPE: Final = {kind: 10 + int(kind) for kind in VesselKind}
"""Type of each kind of vessel in our files."""

_KIND = {number: int(kind) for kind, number in KIND_TYPE.items()}
_TOWARDS_ROOT = (int(VesselKind.VEIN), int(VesselKind.LYMPH))
_UM = 1000.0
_SAME_MM = 1e-9


def write_network_swc(path: Path, network: VesselNetwork) -> None:
    """Write a network of trees.

    Roots are where the flow enters; of veins and lymph, where it leaves. Tree numbers aren't
    kept: a reader counts the roots. Nor are vessels that meet end to end without a change of
    radius: they read back as one.

    Raises
    ------
    NetworkError
        When vessels form loops, or a tree mixes kinds that flow from and towards its root.
    OSError
        When the file can't be written.
    """
    vessel, turned = _parents_first(network)
    lines = [
        "# x, y, z and radius in um",
        *(f"# type {t}: {k.name.lower()}" for k, t in KIND_TYPE.items()),
    ]
    place: dict[int, tuple[int, float]] = {}
    count = 0
    for i, back in zip(vessel, turned, strict=True):
        points, radius = network.polyline(i)
        near, far = network.vessel_nodes[i].tolist()
        if back:
            points, radius, near, far = points[::-1], radius[::-1], far, near
        kind = KIND_TYPE[VesselKind(int(network.kind[i]))]
        rows = np.column_stack([points, radius]) * _UM
        parent, wide = place.get(near, (-1, 0.0))
        skipped = 1 if parent >= 0 and wide == radius[0] else 0
        for x, y, z, r in rows[skipped:].tolist():
            count += 1
            lines.append(f"{count} {kind} {x!r} {y!r} {z!r} {r!r} {parent}")
            if parent < 0:
                place[near] = (count, float(radius[0]))
            parent = count
        place[far] = (count, float(radius[-1]))
    write_text(path, "\n".join(lines) + "\n")


def _parents_first(network: VesselNetwork) -> tuple[list[int], list[bool]]:
    """Vessels such that each begins where an earlier one ended; and whether it is turned round."""
    turned = np.isin(network.kind, _TOWARDS_ROOT)
    ends = np.where(turned[:, None], network.vessel_nodes[:, ::-1], network.vessel_nodes)
    reached = np.bincount(ends[:, 1], minlength=len(network.nodes))
    if reached.max() > 1:
        raise NetworkError(
            f"SWC holds trees only: node {int(np.argmax(reached))} is reached by "
            f"{int(reached.max())} vessels ({int((reached > 1).sum())} such nodes); write the "
            "network as CSV, JSON, npz or VTP"
        )
    leaving: dict[int, list[int]] = {}
    for i, node in enumerate(ends[:, 0].tolist()):
        leaving.setdefault(node, []).append(i)
    stack = [i for node in sorted(leaving) if reached[node] == 0 for i in leaving[node]][::-1]
    order: list[int] = []
    while stack:
        order.append(stack.pop())
        stack.extend(reversed(leaving.get(int(ends[order[-1], 1]), [])))
    if len(order) < len(ends):
        raise NetworkError(
            f"SWC holds trees only: {len(ends) - len(order)} vessels flow in a ring; write the "
            "network as CSV, JSON, npz or VTP"
        )
    return order, turned[order].tolist()


def read_network_swc(path: Path, kind: VesselKind = VesselKind.ARTERY) -> VesselNetwork:
    """Read a network of trees; they are numbered in the order of their roots.

    Parameters
    ----------
    path : Path
        In µm, as the format says.
    kind : VesselKind
        Of the points whose type isn't one of `KIND_TYPE`.

    Raises
    ------
    NetworkError
        For a line that can't be read, a parent that isn't there, points in a ring, a radius not
        above 0, or a piece without length; with the line.
    OSError
        When the file can't be read.
    """
    points = _parse(path, kind)
    pieces = _pieces(path, points)
    check_pieces(pieces)
    return chain_pieces(pieces)


@dataclass(frozen=True)
class _Points:
    """Points of the file, parents before children; ``parent`` is a place among them or -1."""

    line: IntArray
    kind: IntArray
    place: FloatArray
    radius: FloatArray
    parent: IntArray


def _parse(path: Path, kind: VesselKind) -> _Points:
    try:
        text = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError as exc:
        raise NetworkError(f"{path}: not UTF-8 text; save the network as SWC") from exc
    line: list[int] = []
    fields: list[tuple[int, int, float, float, float, float, int]] = []
    for number, row in enumerate(text, start=1):
        words = row.split("#", 1)[0].split()
        if not words:
            continue
        try:
            n, t, x, y, z, r, p = words[:7]
            fields.append((int(n), int(t), float(x), float(y), float(z), float(r), int(p)))
        except ValueError as exc:
            raise NetworkError(
                f"{path}, line {number}: {row.strip()!r} isn't number, type, x, y, z, radius and "
                "parent; mend the line"
            ) from exc
        line.append(number)
    if len(fields) < 2:
        raise NetworkError(f"{path}: fewer than two points; give at least one vessel")
    return _sorted(path, np.array(line), fields, int(kind))


def _sorted(
    path: Path,
    line: IntArray,
    fields: list[tuple[int, int, float, float, float, float, int]],
    other: int,
) -> _Points:
    """Points with parents before their children, refused where that can't be."""
    number: dict[int, int] = {}
    for i, row in enumerate(fields):
        if number.setdefault(row[0], i) != i:
            raise NetworkError(f"{path}, line {line[i]}: point {row[0]} is there twice; renumber")
    children: list[list[int]] = [[] for _ in fields]
    roots = []
    for i, row in enumerate(fields):
        if row[6] < 0:
            roots.append(i)
        elif row[6] in number:
            children[number[row[6]]].append(i)
        else:
            raise NetworkError(f"{path}, line {line[i]}: parent {row[6]} isn't in the file")
    order: list[int] = []
    stack = roots[::-1]
    while stack:
        order.append(stack.pop())
        stack.extend(reversed(children[order[-1]]))
    if len(order) < len(fields):
        lost = min(set(range(len(fields))) - set(order))
        raise NetworkError(f"{path}, line {line[lost]}: the point's parents form a ring; cut it")
    rank = np.empty(len(fields), dtype=np.int64)
    rank[order] = np.arange(len(fields))
    table = np.array([row[2:6] for row in fields])[order] / _UM
    return _Points(
        line=line[order],
        kind=np.array([_KIND.get(fields[i][1], other) for i in order], dtype=np.int64),
        place=table[:, :3],
        radius=table[:, 3],
        parent=np.array([rank[number[fields[i][6]]] if fields[i][6] >= 0 else -1 for i in order]),
    )


def _pieces(path: Path, points: _Points) -> Pieces:
    """Pieces from parent to child; a child at its parent's place is the same node."""
    size = len(points.parent)
    child = np.flatnonzero(points.parent >= 0)
    apart = np.zeros(size)
    apart[child] = np.linalg.norm(points.place[child] - points.place[points.parent[child]], axis=1)
    node = np.arange(size)
    tree = np.zeros(size, dtype=np.int64)
    roots = 0
    for i, parent in enumerate(points.parent.tolist()):
        if parent < 0:
            tree[i], roots = roots, roots + 1
            continue
        tree[i] = tree[parent]
        if apart[i] <= _SAME_MM:
            node[i] = node[parent]
    real = child[node[child] != node[points.parent[child]]]
    if len(real) == 0:
        raise NetworkError(f"{path}: no two points are apart; give at least one vessel")
    ends = np.column_stack([points.parent[real], real])
    # Veins and lymph flow towards the root.
    back = np.isin(points.kind[real], _TOWARDS_ROOT)
    ends[back] = ends[back, ::-1]
    return Pieces(
        path=path,
        line=points.line[real],
        vessel=_vessels(points, node, real),
        nodes=node[ends],
        points=points.place[node[ends]],
        radius=points.radius[ends],
        kind=points.kind[real],
        tree=tree[real],
    )


def _vessels(points: _Points, node: IntArray, real: IntArray) -> IntArray:
    """Vessel of each piece: a piece goes on with its parent's where nothing else joins them."""
    degree = np.bincount(node[points.parent[real]], minlength=len(node))
    vessel = np.full(len(node), -1, dtype=np.int64)
    count = 0
    for i in real.tolist():
        parent = int(points.parent[i])
        goes_on = (
            vessel[parent] >= 0
            and degree[node[parent]] == 1
            and points.kind[parent] == points.kind[i]
        )
        vessel[i] = vessel[parent] if goes_on else count
        count += 0 if goes_on else 1
    return vessel[real]
