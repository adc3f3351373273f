"""Read vessels from X-CAVATE's text, and join them to a network."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Final, NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from design.errors import NetworkError
from design.network import VesselKind, VesselNetwork
from design.network_files.merge import merge_shared
from design.network_files.pieces import (
    LabelledPath,
    Labels,
    PathPoints,
    Pieces,
    chain_pieces,
    read_utf8,
)
from design.units import MM_PER, LengthUnit
from kernels.arrays import FloatArray, IntArray

_HEAD: Final = re.compile(r"vessel:\s*(\d+)\s*,\s*number of points:\s*(\d+)\s*$", re.IGNORECASE)


REACH: Final = 1.05
"""An end within so many radii of a vessel's axis lies in that vessel."""
SAME_JOINT: Final = 0.05
"""Joints nearer to each other along a vessel than this part of its radius are one."""
MOST_NAMED: Final = 5
"""Detached pieces, and vessels of each, that the report names."""
_TINY_MM: Final = 1e-6
"""A point so near to a joint is left out."""


@dataclass(frozen=True)
class Snap:
    """An end that was put on the axis of another vessel."""

    vessel: int  # numbers in the file
    onto: int
    end: str  # ``"start"`` or ``"end"``
    moved_mm: float  # mm


class XcavateNetwork(NamedTuple):
    """A network of such a file, and how its vessels were joined."""

    network: VesselNetwork
    snaps: tuple[Snap, ...]  # every end that was put on the axis of another vessel
    notes: tuple[str, ...]  # sentences for the user


def read_network_xcavate(
    path: Path,
    ends: Path | None = None,
    kind: VesselKind = VesselKind.ARTERY,
    unit: LengthUnit = "cm",
) -> XcavateNetwork:
    """Read vessels and join them.

    A vessel is a line ``Vessel: 0, Number of Points: 100`` and a line ``x, y, z, radius`` for
    each point, all in cm as X-CAVATE has it; a fifth number, where there is one, is 0 in a vein and
    another in an artery. Vessels begin and end within the vessel that they leave or join, not on
    its axis: each is put there, once lines through one lumen are merged. Designed flow runs along
    each vessel as it is given.

    Parameters
    ----------
    path : Path
    ends : Path, optional
        The file of inlets and outlets: the word ``inlet`` or ``outlet`` on a line of its own, then
        a line ``x, y, z`` for each. A vessel that ends at an inlet or begins at an outlet is
        turned round.
    kind : VesselKind
        Of points without a fifth number.
    unit : {"um", "mm", "cm", "m", "in"}
        Of both files.

    Raises
    ------
    NetworkError
        For a line that can't be read, another number of points than announced, a radius not above
        0, a vessel without length, or an inlet where no vessel ends; with the line.
    OSError
        When a file can't be read.
    """
    scale = MM_PER[unit]
    lines = [line.scaled(scale) for line in _lines(path, kind)]
    if ends is not None:
        lines = _turned(lines, ends, scale)
    merged, notes = _merged(path, lines)
    network, snaps, detached = _join_lines(path, merged)
    # Merged vessels meet at nodes already.
    moved = tuple(snap for snap in snaps if not notes or snap.moved_mm > 0.0)
    free = int(np.count_nonzero(network.degree() == 1))
    return XcavateNetwork(network, moved, (*notes, _note(moved, free), *detached))


def _merged(path: Path, lines: list[_Line]) -> tuple[list[_Line], tuple[str, ...]]:
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
        left.append(_Line(vessel, np.full(len(points), number), points, radius, kind))
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
    for number, row in enumerate(read_utf8(path, "text").splitlines(), start=1):
        if row.strip():
            yield number, row.strip()


def _lines(path: Path, kind: VesselKind) -> list[_Line]:
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
            _fail(path, number, f"radius {values[3]:g} isn't above 0; mend the line")
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
) -> _Line:
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
    return _Line(
        vessel=vessel,
        number=np.array([n for n, _ in rows], dtype=np.int64)[moves],
        points=table[:, :3],
        radius=table[:, 3],
        kind=kinds.astype(np.int64),
    )


def _turned(lines: list[_Line], ends: Path, scale: float) -> list[_Line]:
    """The same lines, those turned round that end at an inlet or begin at an outlet."""
    turned = list(lines)
    tips = np.array([line.points[[0, -1]] for line in lines])
    reach = REACH * np.array([line.radius[[0, -1]] for line in lines])
    for number, word, place in _ends(ends):
        gap = np.linalg.norm(tips - place * scale, axis=2)
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
        yield number, word, np.array(values)


class _Line(NamedTuple):
    """A vessel as it was read; where its kind changes, it is cut."""

    vessel: int  # its number in the file
    number: IntArray  # (k,), the line of the file in which each point stands
    points: FloatArray  # (k, 3), mm
    radius: FloatArray  # (k,), mm
    kind: IntArray  # (k,), a `VesselKind` each

    def scaled(self, factor: float) -> _Line:
        """The same, its points and radii times a factor."""
        return self._replace(points=self.points * factor, radius=self.radius * factor)

    def reversed(self) -> _Line:
        """The same from its other end."""
        return _Line._make([self.vessel, *(column[::-1] for column in self[1:])])


class _Foot(NamedTuple):
    """The place on an axis nearest to an end: the line, and the place along it in points."""

    line: int
    at: float
    gap_mm: float


def _join_lines(
    path: Path, lines: list[_Line]
) -> tuple[VesselNetwork, list[Snap], tuple[str, ...]]:
    """Put every end that lies within another vessel on its axis, and cut that vessel there.

    An end lies within the vessel of whose radius (at the nearest place of its axis) the distance
    is the smallest part, if that is at most `REACH`. The end moves, the other vessel doesn't;
    points that the end would have to turn back to are left out. Ends that lie in the same place
    of a vessel, to `SAME_JOINT` of its radius, share a node. Also returns the
    ends that were moved, and a sentence on detached pieces.
    """
    near = _Near(lines)
    ends = [(i, side) for i in range(len(lines)) for side in (0, 1)]
    feet = [near.foot(lines[i].points[-side], i) for i, side in ends]
    labels = Labels([lines[i].points[-side] for i, side in ends])
    paths = [
        LabelledPath(one.points, one.radius, (2 * i, 2 * i + 1), i) for i, one in enumerate(lines)
    ]
    snaps = []
    for (i, side), foot in zip(ends, feet, strict=True):
        if foot is None:
            continue
        labels.unite(2 * i + side, _joint(paths[foot.line], foot.at, labels))
        end = ("start", "end")[side]
        snaps.append(Snap(lines[i].vessel, lines[foot.line].vessel, end, foot.gap_mm))
    joined = [(i, foot.line) for (i, _), foot in zip(ends, feet, strict=True) if foot is not None]
    detached = _detached(lines, near, np.array(joined, dtype=np.int64).reshape(-1, 2))
    return chain_pieces(_pieces(path, lines, paths, labels)), snaps, detached


def _detached(lines: list[_Line], near: _Near, joined: IntArray) -> tuple[str, ...]:
    """A sentence on the groups of lines that no joint connects with the largest; none for one.

    ``joined`` (k, 2) are pairs of lines that share a joint.
    """
    pairs = coo_array((np.ones(len(joined)), joined.T), shape=(len(lines), len(lines)))
    count, group = connected_components(pairs, directed=False)
    if count == 1:
        return ()
    length = [np.linalg.norm(np.diff(line.points, axis=0), axis=1).sum() for line in lines]
    main = int(np.argmax(np.bincount(group, length)))
    named = []
    for own in np.flatnonzero(np.arange(count) != main)[:MOST_NAMED]:
        # Either an end of the group lies nearest to the others' axes, or one of theirs to its.
        inside = group == own
        gap, onto, end = min(
            (*near.gap(lines[i].points[-side], inside[near.line] != inside[i]), i)
            for i in range(len(lines))
            for side in (0, 1)
        )
        which, against = (end, onto) if inside[end] else (onto, end)
        of = np.flatnonzero(inside)
        vessels = f"vessel {lines[of[0]].vessel}"
        if len(of) > 1:
            vessels = f"vessels {', '.join(str(lines[i].vessel) for i in of[:MOST_NAMED])}"
            vessels += f" and {len(of) - MOST_NAMED} more" if len(of) > MOST_NAMED else ""
        nearest = f"vessel {lines[which].vessel}, " if len(of) > 1 else ""
        named.append(f"{vessels} ({nearest}{gap:.3g} mm from vessel {lines[against].vessel})")
    more = f" and {count - 1 - MOST_NAMED} more" if count - 1 > MOST_NAMED else ""
    return (
        f"The network is in {count} pieces; apart from the largest: {'; '.join(named)}{more}; "
        f"distances are between axes. An end joins a vessel within {REACH:g} of its radius: extend "
        "the file's vessels where they should meet.",
    )


class _Near:
    """Stretches of all lines, found by where they lie.

    Attributes
    ----------
    line : (k,) int64
        The line that each stretch is of.
    at : (k,) int64
        Number of the stretch in its line.
    """

    def __init__(self, lines: list[_Line]) -> None:
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

    def gap(self, end: FloatArray, among: NDArray[np.bool_]) -> tuple[float, int]:
        """Distance of an end from the nearest axis ``among`` all stretches, and that one's line."""
        rows = np.flatnonzero(among)
        gap = self._along(end, rows)[1]
        k = int(np.argmin(gap))
        return float(gap[k]), int(self.line[rows[k]])

    def _along(self, end: FloatArray, rows: IntArray) -> tuple[FloatArray, FloatArray]:
        """Nearest place on each stretch to an end, as a share of it, and its distance, mm."""
        start, way = self._start[rows], self._way[rows]
        along = (np.einsum("ij,ij->i", end - start, way) / self._length2[rows]).clip(0.0, 1.0)
        return along, np.linalg.norm(start + along[:, None] * way - end, axis=1)

    def foot(self, end: FloatArray, own: int) -> _Foot | None:
        """Place on another line's axis within whose vessel an end lies deepest; None for none."""
        rows = np.sort(np.array(self._tree.query_ball_point(end, self._far), dtype=np.int64))
        rows = rows[self.line[rows] != own]
        if not len(rows):
            return None
        along, gap = self._along(end, rows)
        ratio = gap / (self._radius[rows] + along * self._taper[rows])
        k = int(np.argmin(ratio))
        if ratio[k] > REACH:
            return None
        return _Foot(int(self.line[rows[k]]), float(self.at[rows[k]] + along[k]), float(gap[k]))


def _joint(path: LabelledPath, at: float, labels: Labels) -> int:
    """Label of the joint at a place along a path, made where there is none near it."""
    point = path.point(at)
    radius = float(np.interp(at, np.arange(len(path.radius)), path.radius))
    for other, label in path.labelled:
        if np.linalg.norm(path.point(other) - point) <= SAME_JOINT * radius:
            return label
    label = labels.add(point)
    path.joints.append((at, label))
    return label


def _pieces(path: Path, lines: list[_Line], paths: list[LabelledPath], labels: Labels) -> Pieces:
    """Pieces of all lines between their points and joints; vessels are cut where kinds change."""
    points = PathPoints.joined([one.rows(i, _kept(one, labels)) for i, one in enumerate(paths)])
    begins = np.cumsum([0, *(len(line.points) for line in lines)])[points.path]
    row = begins + points.at.astype(np.int64)
    number = np.concatenate([line.number for line in lines])[row]
    kind = np.concatenate([line.kind for line in lines])[row]
    nothing = np.zeros(len(row), dtype=np.int64)
    pieces = points.pieces(path, points.nodes(labels), number, kind, nothing)
    lost = np.setdiff1d(np.arange(len(lines)), pieces.vessel)
    if len(lost):
        raise NetworkError(
            f"{path}, line {lines[lost[0]].number[0]}: the vessel begins and ends in the same "
            "joint and has no length beside it; remove it"
        )
    cut = (np.diff(pieces.vessel) != 0) | (np.diff(pieces.kind) != 0)
    return replace(pieces, vessel=np.cumsum(np.r_[False, cut]))


def _kept(path: LabelledPath, labels: Labels) -> NDArray[np.bool_]:
    """Points of a path that aren't at a joint, nor passed by an end that moves."""
    last = len(path.points) - 1
    kept = np.ones(last + 1, dtype=np.bool_)
    for at, _ in path.labelled:
        nearest = round(at)
        kept[nearest] &= np.abs(path.point(at) - path.points[nearest]).max() > _TINY_MM
    for side, end, way in ((0, 0, 1), (1, last, -1)):
        joint = labels.place(path.ends[side])
        moved, k = float(np.linalg.norm(joint - path.points[end])), end + way
        while 0 < k < last and np.linalg.norm(joint - path.points[k]) <= moved:
            kept[k] = False
            k += way
    return kept
