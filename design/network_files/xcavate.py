"""Read vessels from X-CAVATE's text (points in cm), and join them to a network."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Final, NoReturn

import numpy as np
from scipy.spatial import cKDTree

from design.errors import NetworkError
from design.network import VesselKind, VesselNetwork
from design.network_files.csv_format import Pieces, chain_pieces
from design.network_files.merge import merge_shared
from design.units import MM_PER
from kernels.arrays import FloatArray, IntArray

_MM: Final = MM_PER["cm"]
_HEAD: Final = re.compile(r"vessel:\s*(\d+)\s*,\s*number of points:\s*(\d+)\s*$", re.IGNORECASE)


@dataclass(frozen=True, eq=False)
class XcavateNetwork:
    """A network of such a file, and how its vessels were joined.

    Attributes
    ----------
    network : VesselNetwork
    snaps : tuple of Snap
        Every end that was put on the axis of another vessel; vessels by the file's numbers.
    notes : tuple of str
        Sentences for the user.
    """

    network: VesselNetwork
    snaps: tuple[Snap, ...]
    notes: tuple[str, ...]


def read_network_xcavate(
    path: Path, ends: Path | None = None, kind: VesselKind = VesselKind.ARTERY
) -> XcavateNetwork:
    """Read vessels and join them.

    A vessel is a line ``Vessel: 0, Number of Points: 100`` and a line ``x, y, z, radius`` for
    each point, all in cm; a fifth number, where there is one, is 0 in a vein and another in an
    artery. Vessels begin and end within the vessel that they leave or join, not on its axis:
    `join_lines` puts them there, once lines through one lumen are merged. Designed flow runs along
    each vessel as it is given.

    Parameters
    ----------
    path : Path
    ends : Path, optional
        The file of inlets and outlets: the word ``inlet`` or ``outlet`` on a line of its own, then
        a line ``x, y, z`` (cm) for each. A vessel that ends at an inlet or begins at an outlet is
        turned round.
    kind : VesselKind
        Of points without a fifth number.

    Raises
    ------
    NetworkError
        For a line that can't be read, another number of points than announced, a radius not above
        0, a vessel without length, or an inlet where no vessel ends; with the line.
    OSError
        When a file can't be read.
    """
    lines = _lines(path, kind)
    if ends is not None:
        lines = _turned(lines, ends)
    merged, notes = _merged(path, lines)
    joined = join_lines(path, merged)
    # Merged vessels meet at nodes already.
    snaps = tuple(snap for snap in joined.snaps if not notes or snap.moved_mm > 0.0)
    return XcavateNetwork(joined.network, snaps, (*notes, _note(snaps, joined.free)))


def _merged(path: Path, lines: list[Line]) -> tuple[list[Line], tuple[str, ...]]:
    """Lines without what runs along others, and notes on it."""
    kinds = [np.diff(line.kind[:-1], prepend=line.kind[0]) != 0 for line in lines]
    parts = [
        (line, a, b)
        for line, cut in zip(lines, kinds, strict=True)
        for a, b in pairwise([0, *np.flatnonzero(cut).tolist(), len(line.points) - 1])
    ]
    network = VesselNetwork(
        nodes=np.concatenate([line.points[[a, b]] for line, a, b in parts]),
        vessel_nodes=np.arange(2 * len(parts)).reshape(-1, 2),
        kind=np.array([line.kind[a] for line, a, _ in parts]),
        tree=np.zeros(len(parts), dtype=np.int64),
        offset=np.cumsum([0, *(b - a + 1 for _, a, b in parts)]),
        points=np.concatenate([line.points[a : b + 1] for line, a, b in parts]),
        radius=np.concatenate([line.radius[a : b + 1] for line, a, b in parts]),
    )
    merged, notes = merge_shared(path, network)
    if not notes:
        return lines, ()
    origin = {
        tuple(point): (line.vessel, number)
        for line in reversed(lines)
        for point, number in zip(line.points.tolist(), line.number.tolist(), strict=True)
    }
    left = []
    for k in range(merged.vessel_count):
        points, radius = merged.polyline(k)
        places = [origin[place] for place in map(tuple, points.tolist()) if place in origin]
        vessel, number = places[0] if places else (lines[0].vessel, int(lines[0].number[0]))
        kind = np.full(len(points), merged.kind[k])
        left.append(Line(vessel, np.full(len(points), number), points, radius, kind))
    return left, notes


def _note(snaps: tuple[Snap, ...], free: int) -> str:
    loose = f"free ends (inlets, outlets or loose): {free}"
    if not snaps:
        return f"No vessel begins or ends within another; {loose}."
    far = max(snaps, key=lambda snap: snap.moved_mm)
    return (
        f"Ends of vessels put on the axis of the vessel within which they lie: {len(snaps)}, by "
        f"{np.mean([snap.moved_mm for snap in snaps]):.3f} mm on average and "
        f"{far.moved_mm:.3f} mm at most ({far.end} of the file's vessel {far.vessel}, on vessel "
        f"{far.onto}); {loose}."
    )


def _fail(path: Path, number: int, text: str) -> NoReturn:
    raise NetworkError(f"{path}, line {number}: {text}")


def _text(path: Path) -> Iterator[tuple[int, str]]:
    """Lines that hold something, and their numbers."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as exc:
        raise NetworkError(f"{path}: not UTF-8 text; save the network as text") from exc
    for number, row in enumerate(text.splitlines(), start=1):
        if row.strip():
            yield number, row.strip()


def _lines(path: Path, kind: VesselKind) -> list[Line]:
    heads: list[tuple[int, int, int]] = []
    rows: list[list[tuple[int, list[float]]]] = []
    columns = 0
    for number, row in _text(path):
        if match := _HEAD.match(row):
            heads.append((number, int(match[1]), int(match[2])))
            rows.append([])
            continue
        if not heads:
            _fail(path, number, f"{row[:60]!r} stands before any 'Vessel: 0, Number of Points: n'")
        values = _numbers(path, number, row)
        columns = columns or len(values)
        if len(values) != columns or columns not in (4, 5):
            _fail(
                path,
                number,
                f"{len(values)} numbers; each point needs x, y, z, radius, and in all or none a "
                "fifth for artery or vein",
            )
        if values[3] <= 0:
            _fail(path, number, f"radius {values[3]:g} cm isn't above 0; mend the line")
        rows[-1].append((number, values))
    if not heads:
        raise NetworkError(
            f"{path}: no line 'Vessel: 0, Number of Points: n'; this isn't X-CAVATE's network"
        )
    return [_line(path, head, own, kind) for head, own in zip(heads, rows, strict=True)]


def _numbers(path: Path, number: int, row: str) -> list[float]:
    try:
        values = [float(word) for word in row.split(",")]
    except ValueError:
        _fail(path, number, f"{row[:60]!r} isn't numbers between commas; mend the line")
    if not np.isfinite(values).all():
        _fail(path, number, f"{row[:60]!r}: a number is NaN or infinite; mend the line")
    return values


def _line(
    path: Path,
    head: tuple[int, int, int],
    rows: list[tuple[int, list[float]]],
    kind: VesselKind,
) -> Line:
    number, vessel, announced = head
    if len(rows) != announced:
        _fail(
            path, number, f"vessel {vessel} announces {announced} points and has {len(rows)}; mend"
        )
    table = np.array([values for _, values in rows]).reshape(len(rows), -1 if rows else 4)
    moves = np.ones(len(rows), dtype=bool)
    moves[1:] = np.any(np.diff(table[:, :3], axis=0) != 0.0, axis=1)
    if moves.sum() < 2:
        _fail(path, number, f"vessel {vessel} has fewer than two points apart; remove or mend it")
    table = table[moves]
    kinds: IntArray = np.full(len(table), int(kind), dtype=np.int64)
    if table.shape[1] == 5:
        kinds = np.where(table[:, 4] == 0, int(VesselKind.VEIN), int(VesselKind.ARTERY))
    return Line(
        vessel=vessel,
        number=np.array([n for n, _ in rows], dtype=np.int64)[moves],
        points=table[:, :3] * _MM,
        radius=table[:, 3] * _MM,
        kind=kinds.astype(np.int64),
    )


def _turned(lines: list[Line], ends: Path) -> list[Line]:
    """The same lines, those turned round that end at an inlet or begin at an outlet."""
    turned = list(lines)
    tips = np.array([line.points[[0, -1]] for line in lines])
    reach = REACH * np.array([line.radius[[0, -1]] for line in lines])
    for number, word, place in _ends(ends):
        gap = np.linalg.norm(tips - place, axis=2)
        which, side = np.unravel_index(int(np.argmin(gap)), gap.shape)
        if gap[which, side] > reach[which, side]:
            _fail(
                ends,
                number,
                f"the nearest end of a vessel to this {word} is {gap[which, side]:.3g} mm away "
                f"(vessel {lines[which].vessel}); at most its radius plus 5 % is allowed",
            )
        if (word == "inlet") == bool(side):
            turned[which] = lines[which].reversed()
    return turned


def _ends(path: Path) -> Iterator[tuple[int, str, FloatArray]]:
    word = ""
    for number, row in _text(path):
        if row.lower() in ("inlet", "outlet"):
            word = row.lower()
            continue
        values = _numbers(path, number, row)
        if not word or len(values) != 3:
            _fail(path, number, f"{row[:60]!r} isn't 'inlet', 'outlet' or x, y, z below one")
        yield number, word, np.array(values) * _MM


# Join separately read vessel polylines to a network: snap loose ends to axes, make nodes.

REACH: Final = 1.05
"""An end within so many radii of a vessel's axis lies in that vessel."""
_SAME: Final = 0.05
"""Joints nearer to each other along a vessel than this part of its radius are one."""
_TINY_MM: Final = 1e-6


@dataclass(frozen=True, eq=False)
class Line:
    """A vessel as it was read.

    Attributes
    ----------
    vessel : int
        Its number in the file.
    number : (k,) int64
        The line of the file in which each point stands.
    points : (k, 3) float64, mm
    radius : (k,) float64, mm
    kind : (k,) int64
        A `VesselKind` each; where it changes, the vessel is cut.
    """

    vessel: int
    number: IntArray
    points: FloatArray
    radius: FloatArray
    kind: IntArray

    def reversed(self) -> Line:
        """The same from its other end."""
        return replace(
            self,
            number=self.number[::-1],
            points=self.points[::-1],
            radius=self.radius[::-1],
            kind=self.kind[::-1],
        )


@dataclass(frozen=True)
class Snap:
    """An end that was put on the axis of another vessel.

    Attributes
    ----------
    vessel, onto : int
        The vessels' numbers in the file.
    end : str
        ``"start"`` or ``"end"``.
    moved_mm : float, mm
    """

    vessel: int
    onto: int
    end: str
    moved_mm: float


@dataclass(frozen=True, eq=False)
class JoinedNetwork:
    """The network, the ends that were moved, and how many ends meet nothing."""

    network: VesselNetwork
    snaps: tuple[Snap, ...]
    free: int


@dataclass(frozen=True)
class _Foot:
    """The place on an axis nearest to an end: the line, and the place along it in points."""

    line: int
    at: float
    gap_mm: float


def join_lines(path: Path, lines: list[Line]) -> JoinedNetwork:
    """Put every end that lies within another vessel on its axis, and cut that vessel there.

    An end lies within the vessel of whose radius (at the nearest place of its axis) the distance
    is the smallest part, if that is at most `REACH`. The end moves, the other vessel doesn't;
    points that the end would have to turn back to are left out. Ends that lie in the same place
    of a vessel, to `_SAME` of its radius, share a node.

    Parameters
    ----------
    path : Path
        Of the file, for messages.
    lines : list of Line

    Raises
    ------
    NetworkError
        When nothing is left of a vessel between its joints.
    """
    near = _Near(lines)
    feet = [
        (i, side, near.foot(line.points[-side], i))
        for i, line in enumerate(lines)
        for side in (0, 1)
    ]
    spots = _Spots(lines)
    snaps, free = [], 0
    for i, side, foot in feet:
        if foot is None:
            free += 1
            continue
        spots.meet(i, side, foot)
        end = ("start", "end")[side]
        snaps.append(Snap(lines[i].vessel, lines[foot.line].vessel, end, foot.gap_mm))
    network = chain_pieces(_pieces(path, lines, spots))
    return JoinedNetwork(network, tuple(snaps), free)


class _Near:
    """Stretches of all lines, found by where they lie.

    Attributes
    ----------
    line : (k,) int64
        The line that each stretch is of.
    at : (k,) int64
        Number of the stretch in its line.
    """

    def __init__(self, lines: list[Line]) -> None:
        self.line = np.repeat(np.arange(len(lines)), [len(line.points) - 1 for line in lines])
        self.at = np.concatenate([np.arange(len(line.points) - 1) for line in lines])
        self._start = np.concatenate([line.points[:-1] for line in lines])
        self._way = np.concatenate([np.diff(line.points, axis=0) for line in lines])
        self._radius = np.concatenate([line.radius[:-1] for line in lines])
        self._taper = np.concatenate([np.diff(line.radius) for line in lines])
        self._length2 = np.einsum("ij,ij->i", self._way, self._way)
        widest = max(float(line.radius.max()) for line in lines)
        self._far = REACH * widest + float(np.sqrt(self._length2.max())) / 2
        self._tree = cKDTree(self._start + self._way / 2)

    def foot(self, end: FloatArray, own: int) -> _Foot | None:
        """Place on another line's axis within whose vessel an end lies deepest; None for none."""
        rows = np.sort(np.array(self._tree.query_ball_point(end, self._far), dtype=np.int64))
        rows = rows[self.line[rows] != own]
        if not len(rows):
            return None
        start, way = self._start[rows], self._way[rows]
        along = (np.einsum("ij,ij->i", end - start, way) / self._length2[rows]).clip(0.0, 1.0)
        gap = np.linalg.norm(start + along[:, None] * way - end, axis=1)
        ratio = gap / (self._radius[rows] + along * self._taper[rows])
        k = int(np.argmin(ratio))
        if ratio[k] > REACH:
            return None
        return _Foot(int(self.line[rows[k]]), float(self.at[rows[k]] + along[k]), float(gap[k]))


class _Spots:
    """Places of joints along the lines, and which of them are the same node.

    Each line has a spot at both ends, ``2 i`` and ``2 i + 1``, and one wherever others meet it.
    """

    def __init__(self, lines: list[Line]) -> None:
        self._lines = lines
        self._same = list(range(2 * len(lines)))
        self._place = [line.points[k] for line in lines for k in (0, -1)]
        self.on: list[list[tuple[float, int]]] = [
            [(0.0, 2 * i), (float(len(line.points) - 1), 2 * i + 1)] for i, line in enumerate(lines)
        ]

    def meet(self, i: int, side: int, foot: _Foot) -> None:
        """Let an end and a place on another line be one node: there, and not where the end was."""
        spot = self._spot(foot)
        self._same[self.root(2 * i + side)] = self.root(spot)

    def root(self, spot: int) -> int:
        """The node of a spot."""
        while self._same[spot] != spot:
            spot = self._same[spot]
        return spot

    def place(self, spot: int) -> FloatArray:
        """Where the node of a spot is, (3,), mm."""
        return self._place[self.root(spot)]

    def _spot(self, foot: _Foot) -> int:
        line = self._lines[foot.line]
        point, radius = _between(line, foot.at)
        for at, spot in self.on[foot.line]:
            if np.linalg.norm(_between(line, at)[0] - point) <= _SAME * radius:
                return spot
        self._same.append(len(self._same))
        self._place.append(point)
        self.on[foot.line].append((foot.at, self._same[-1]))
        return self._same[-1]


def _between(line: Line, at: float) -> tuple[FloatArray, float]:
    """Point and radius at a place along a line, in points."""
    k = min(int(at), len(line.points) - 2)
    part = at - k
    point = line.points[k] + part * (line.points[k + 1] - line.points[k])
    return point, float(line.radius[k] + part * (line.radius[k + 1] - line.radius[k]))


@dataclass
class _Rows:
    """Points of a line with its joints: file line, node, place, radius, kind."""

    number: list[int]
    node: list[int]
    place: list[FloatArray]
    radius: list[float]
    kind: list[int]


def _pieces(path: Path, lines: list[Line], spots: _Spots) -> Pieces:
    rows = [_rows(line, spots, i) for i, line in enumerate(lines)]
    # Inner points are nodes of their own, above those of the joints.
    inner = 1 + max(max(row.node) for row in rows)
    parts: list[Pieces] = []
    label = 0
    for row in rows:
        node = np.array(row.node, dtype=np.int64)
        bare = node < 0
        node[bare] = inner + np.arange(int(bare.sum()))
        inner += int(bare.sum())
        place, radius = np.array(row.place), np.array(row.radius)
        kind = np.array(row.kind, dtype=np.int64)[:-1]
        vessel = label + np.cumsum(np.diff(kind, prepend=kind[0]) != 0)
        label = int(vessel[-1]) + 1
        keep = node[:-1] != node[1:]
        if not keep.any():
            raise NetworkError(
                f"{path}, line {row.number[0]}: the vessel begins and ends in the same joint and "
                "has no length beside it; remove it"
            )
        parts.append(
            Pieces(
                path=path,
                line=np.array(row.number, dtype=np.int64)[:-1][keep],
                vessel=vessel[keep],
                nodes=np.column_stack([node[:-1], node[1:]])[keep],
                points=np.stack([place[:-1], place[1:]], axis=1)[keep],
                radius=np.column_stack([radius[:-1], radius[1:]])[keep],
                kind=kind[keep],
                tree=np.zeros(int(keep.sum()), dtype=np.int64),
            )
        )
    return Pieces(
        path,
        *(
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("line", "vessel", "nodes", "points", "radius", "kind", "tree")
        ),
    )


def _rows(line: Line, spots: _Spots, i: int) -> _Rows:
    """A line's points and its joints in their order along it; at one place the joint alone."""
    last = len(line.points) - 1
    kept = np.ones(last + 1, dtype=bool)
    for at, _ in spots.on[i]:
        near = round(at)
        kept[near] &= np.abs(_between(line, at)[0] - line.points[near]).max() > _TINY_MM
    for end, way in ((0, 1), (last, -1)):
        joint = spots.place(2 * i + (end > 0))
        moved, k = float(np.linalg.norm(joint - line.points[end])), end + way
        while 0 < k < last and np.linalg.norm(joint - line.points[k]) <= moved:
            kept[k] = False
            k += way
    entries = [(float(k), -1) for k in np.flatnonzero(kept)]
    rows = _Rows([], [], [], [], [])
    for at, spot in sorted(entries + spots.on[i]):
        k = int(at)
        rows.number.append(int(line.number[k]))
        rows.node.append(-1 if spot < 0 else spots.root(spot))
        rows.place.append(line.points[k] if spot < 0 else spots.place(spot))
        rows.radius.append(_between(line, at)[1])
        rows.kind.append(int(line.kind[k]))
    return rows
