"""Read and write networks as SWC: trees of points in µm, as in neuroanatomy.

A line is ``number type x y z radius parent``; the radius, too, is in µm, and a root's parent is
-1. Lines that begin with ``#`` are comments, of which a reader heeds ``# SCALE x y z`` (factors of
the numbers) and ``# unit: mm``. A point has one radius and one parent, so loops
can't be written. Where a vessel's radius at a node differs from its parent's, a point of its own
at the same place keeps it; such a pair reads back as one node.

Types 0 to 4 are neurons', 5 and above are free: `KIND_TYPE`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from design.errors import NetworkError
from design.files import write_text
from design.network import VesselKind, VesselNetwork
from design.network_files.pieces import (
    TOWARDS_ROOT,
    Pieces,
    chain_pieces,
    check_pieces,
    fuse_vessels,
    read_utf8,
)
from design.units import MM_PER, LengthUnit
from kernels.arrays import FloatArray, IntArray

KIND_TYPE: Final = {kind: 10 + int(kind) for kind in VesselKind}
"""Type of each kind of vessel in our files."""

_KIND: Final = {number: int(kind) for kind, number in KIND_TYPE.items()}
_UM: Final = 1 / MM_PER["um"]
_SAME_MM: Final = 1e-9
"""A child so near to its parent is the same node."""
_SCALE = re.compile(r"#\s*scale\b[:=]?\s*(.*)", re.IGNORECASE)
_UNIT = re.compile(r"#\s*units?\b\s*(?:[:=]\s*(.*\S)|[\[(]?([^\W\d]+)[\])]?)\s*$", re.IGNORECASE)
"""``# unit: mm``, whatever stands behind the colon; without one a single word."""
_UNIT_OF: Final[dict[str, LengthUnit]] = {
    "um": "um", "µm": "um", "μm": "um", "micron": "um", "micrometer": "um", "micrometre": "um",
    "mm": "mm", "millimeter": "mm", "millimetre": "mm", "cm": "cm", "m": "m",
    "meter": "m", "metre": "m", "centimeter": "cm", "centimetre": "cm", "in": "in", "inch": "in",
    "inche": "in",
}  # fmt: skip
PointRow = tuple[int, int, float, float, float, float, int]
"""Number, kind, x, y, z, radius, parent; a negative parent is none."""


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
    turned = np.isin(network.kind, TOWARDS_ROOT)
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


class SwcHeader(NamedTuple):
    """Unit that comments of a file name, if any, and factors of x, y and z."""

    unit: LengthUnit | None
    scale: tuple[float, float, float]

    @property
    def radius_scale(self) -> float:
        """Factor of the radii: the mean of the others, by which volumes stay right."""
        return float(np.cbrt(np.prod(self.scale)))


def read_swc_header(path: Path) -> SwcHeader:
    """Read the comments of a file that say how long its unit is.

    Raises
    ------
    NetworkError
        For a unit that isn't known or contradicts another, or a scale that isn't three numbers
        above 0.
    OSError
        When the file can't be read.
    """
    unit: LengthUnit | None = None
    scale = (1.0, 1.0, 1.0)
    for number, row in enumerate(read_utf8(path, "SWC").splitlines(), start=1):
        if match := _UNIT.match(row.strip()):
            named = _unit(match[1] or match[2])
            if named is None:
                raise NetworkError(
                    f"{path}, line {number}: unit {match[1] or match[2]!r} isn't one of "
                    f"{', '.join(MM_PER)}; mend the line, or remove it and give unit (--unit)"
                )
            if unit not in (None, named):
                raise NetworkError(
                    f"{path}, line {number}: unit {named} here, {unit} in a line before; remove "
                    "the wrong one"
                )
            unit = named
        if match := _SCALE.match(row.strip()):
            try:
                x, y, z = (float(word) for word in match[1].replace(",", " ").split())
            except ValueError:
                x = y = z = 0.0
            if not (np.isfinite([x, y, z]).all() and min(x, y, z) > 0.0):
                raise NetworkError(
                    f"{path}, line {number}: {row.strip()!r} isn't SCALE and three numbers above "
                    "0; mend or remove the line"
                )
            scale = (x, y, z)
    return SwcHeader(unit, scale)


def _unit(word: str) -> LengthUnit | None:
    """Unit that a word, perhaps in brackets, names; None for none that is known."""
    bare = word.strip().strip("[]()").strip().rstrip(".").lower()
    return _UNIT_OF.get(bare) or _UNIT_OF.get(bare.removesuffix("s"))


def read_network_swc(
    path: Path, unit: LengthUnit | None = None, kind: VesselKind = VesselKind.ARTERY
) -> VesselNetwork:
    """Read a network of trees; they are numbered in the order of their roots.

    Parameters
    ----------
    path : Path
    unit : {"um", "mm", "cm", "m", "in"}, optional
        As the file's comments say by default, and µm where they don't.
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
    header = read_swc_header(path)
    scale = np.array([*header.scale, header.radius_scale])
    line, rows = _parse(path)
    rows = [(n, _KIND.get(t, int(kind)), x, y, z, r, p) for n, t, x, y, z, r, p in rows]
    return trees_of_points(path, line, rows, scale * MM_PER[unit or header.unit or "um"])


def trees_of_points(
    path: Path, line: Sequence[int], rows: Sequence[PointRow], scale: FloatArray
) -> VesselNetwork:
    """Return the network of points that each name their parent.

    Parameters
    ----------
    path : Path
        Of the file, for messages.
    line : sequence of int
        Line of the file in which each point stands.
    rows : sequence of PointRow
        Kinds as `VesselKind`.
    scale : (4,) float64
        Of x, y, z and radius, mm.

    Raises
    ------
    NetworkError
        As `read_network_swc`.
    """
    if len(rows) < 2:
        raise NetworkError(f"{path}: fewer than two points; give at least one vessel")
    pieces = _pieces(path, _sorted(path, line, rows, scale))
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


def _parse(path: Path) -> tuple[list[int], list[PointRow]]:
    line: list[int] = []
    rows: list[PointRow] = []
    for number, row in enumerate(read_utf8(path, "SWC").splitlines(), start=1):
        words = row.split("#", 1)[0].split()
        if not words:
            continue
        try:
            n, t, x, y, z, r, p = words[:7]
            rows.append((int(n), int(t), float(x), float(y), float(z), float(r), int(p)))
        except ValueError as exc:
            raise NetworkError(
                f"{path}, line {number}: {row.strip()!r} isn't number, type, x, y, z, radius and "
                "parent; mend the line"
            ) from exc
        line.append(number)
    return line, rows


def _sorted(
    path: Path, line: Sequence[int], fields: Sequence[PointRow], scale: FloatArray
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
    table = np.array([row[2:6] for row in fields])[order] * scale
    return _Points(
        line=np.array(line, dtype=np.int64)[order],
        kind=np.array([fields[i][1] for i in order], dtype=np.int64),
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
    back = np.isin(points.kind[real], TOWARDS_ROOT)
    ends[back] = ends[back, ::-1]
    pieces = Pieces(
        path=path,
        line=points.line[real],
        vessel=np.arange(len(real)),
        nodes=node[ends],
        points=points.place[node[ends]],
        radius=points.radius[ends],
        kind=points.kind[real],
        tree=tree[real],
    )
    return fuse_vessels(pieces, np.ones(size, dtype=np.bool_))
