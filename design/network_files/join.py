"""Join separately read vessel polylines to a network: snap loose ends to axes, make nodes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from design.errors import NetworkError
from design.network import VesselNetwork
from design.network_files.csv_format import Pieces, chain_pieces
from kernels.arrays import FloatArray, IntArray

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
