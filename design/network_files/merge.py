"""Merge vessels that run along each other: lines through one lumen are one vessel."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order, connected_components

from design.geometry.segments import close_pairs
from design.network import VesselKind, VesselNetwork
from design.network_files.pieces import (
    TOWARDS_ROOT,
    LabelledPath,
    Labels,
    PathPoints,
    Pieces,
    chain_pieces,
    fuse_vessels,
    join_equal_points,
)
from design.network_files.stretches import (
    LIMITS,
    Feet,
    Samples,
    Stretch,
    nearest_feet,
    sample,
    shared_stretches,
)
from kernels.arrays import FloatArray, IntArray


class NetworkWithNotes(NamedTuple):
    """A network, and sentences for the user on what its reader made of it."""

    network: VesselNetwork
    notes: tuple[str, ...]


def merge_shared(
    path: Path, network: VesselNetwork, *, by_place: bool = False, identical: bool = False
) -> NetworkWithNotes:
    """Merge vessels of one kind where they run along each other.

    Vessels are compared in their order. Where the axis of one stays near earlier ones'
    (`MergeLimits.same_axis`), over two radii at least or all the way between two of their nodes, it
    is the same lumen. Axis and radii of the earlier vessel are kept, and the later one begins where
    they part. Vessels that touch, cross or run side by side are left as they are, and so are those
    that diverge from a node that they share.

    Where merged vessels were given in opposite directions, all of the part of the network that
    they belong to is directed away from the end that most of them share (veins, lymph: towards
    it).

    Parameters
    ----------
    path : Path
        Of the file, for messages.
    network : VesselNetwork
    by_place : bool
        Whether points at the same place, to the bit, are one node. They are joined after merging:
        cut there before, lines of one lumen would be too short to be recognised.
    identical : bool
        Merge only vessels with the same points: for formats that state which vessels meet where.
    """
    pairs = _beside(network)
    if identical:
        pairs = pairs[[_same_line(network, one, two) for one, two in pairs.tolist()]]
    links = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(network.vessel_count,) * 2)
    _, group = connected_components(links, directed=False)
    involved = np.unique(pairs)
    involved = involved[np.argsort(group[involved], kind="stable")]
    merge = _Merge(network)
    for vessels in np.split(involved, np.flatnonzero(np.diff(group[involved])) + 1):
        merge.add(vessels)
    if not (merge.shared or by_place):
        return NetworkWithNotes(network, ())
    pieces, turned = merge.pieces(path, by_place=by_place)
    merged = chain_pieces(pieces)
    if not merge.shared:
        return NetworkWithNotes(merged, ())
    return NetworkWithNotes(merged, (_note(network, merged, merge.shared, turned),))


def _same_line(network: VesselNetwork, one: int, two: int) -> bool:
    """Whether two vessels have the same points, in either direction."""
    line, other = network.polyline(one)[0], network.polyline(two)[0]
    return np.array_equal(line, other) or np.array_equal(line, other[::-1])


def side_by_side(network: VesselNetwork) -> tuple[str, ...]:
    """Return a note on vessels that run within a radius of each other and don't meet."""
    pairs = _beside(network, 1.0, 2.0)
    nodes = network.vessel_nodes[pairs]
    pairs = pairs[~(nodes[:, 0, :, None] == nodes[:, 1, None, :]).any(axis=(1, 2))]
    if not len(pairs):
        return ()
    one, two = pairs[0].tolist()
    line = network.polyline(one)[0]
    x, y, z = line[len(line) // 2]
    return (
        f"{len(pairs)} pairs of vessels run within a radius of each other and are kept as two, as "
        f"vessels {one} and {two} near ({x:.4g}, {y:.4g}, {z:.4g}) mm: their lumens overlap. If "
        "they are one vessel, give one line for it.",
    )


def _beside(
    network: VesselNetwork, apart: float = LIMITS.same_axis, least: float = 1.0
) -> IntArray:
    """Pairs of vessels (k, 2) that may run within `apart` radii of each other for `least` radii."""
    start, end, r0, r1, vessel = network.pieces()
    length = np.linalg.norm(end - start, axis=1)
    no_nodes = np.arange(2 * len(start)).reshape(-1, 2)
    reach = apart / 2 * np.maximum(r0, r1)
    pairs, _, _ = close_pairs(start, end, reach, no_nodes, 0.0, 0.0)
    of = vessel[pairs]
    kept = (of[:, 0] != of[:, 1]) & (network.kind[of[:, 0]] == network.kind[of[:, 1]])
    pairs = pairs[kept & (length[pairs] > 0.0).all(axis=1)]
    along = _length_beside(start[pairs], (end - start)[pairs], reach[pairs].sum(axis=1))
    of, which = np.unique(vessel[pairs], axis=0, return_inverse=True)
    total = np.bincount(which.reshape(-1), along, minlength=len(of))
    # A vessel that lies along another between two nodes may be shorter than a radius.
    enough = least * np.minimum(network.mean_radius(), network.lengths() / 2)
    return of[(total > 0.0) & (total >= enough[of].min(axis=1))]


def _length_beside(start: FloatArray, way: FloatArray, reach: FloatArray) -> FloatArray:
    """Length (k,) over which straight pieces (k, 2, 3) lie within ``reach`` of each other, mm."""
    length = np.linalg.norm(way, axis=2)
    unit = way[:, 0] / length[:, :1]
    cosine = np.einsum("ij,ij->i", unit, way[:, 1]) / length[:, 1]
    rate = length[:, 1] * np.where(np.abs(cosine) < LIMITS.parallel, 1.0, cosine)
    offset = np.einsum("ij,ij->i", unit, start[:, 1] - start[:, 0])
    # Places along the second piece, 0 to 1, above both ends of the first.
    above = np.sort(np.stack([-offset, length[:, 0] - offset]) / rate, axis=0).clip(0.0, 1.0)
    away = start[:, 1] - start[:, 0] - offset[:, None] * unit
    leaning = way[:, 1] - (rate)[:, None] * unit
    # |away + t leaning|² <= reach²
    a = np.maximum(np.einsum("ij,ij->i", leaning, leaning), 1e-300)
    b = np.einsum("ij,ij->i", away, leaning) / a
    c = (np.einsum("ij,ij->i", away, away) - reach**2) / a
    half = np.sqrt(np.maximum(b * b - c, 0.0))
    low, high = np.maximum(above[0], -b - half), np.minimum(above[1], -b + half)
    near = np.maximum(high - low, 0.0) * np.abs(rate)
    return np.where(np.abs(cosine) < LIMITS.parallel, 0.0, near)


class _Shared(NamedTuple):
    """A stretch of a vessel, and the vessels that it runs along."""

    vessel: int
    others: frozenset[int]
    stretch: Stretch


class _Along(NamedTuple):
    """A path, its samples, and their feet on the paths that are kept."""

    path: LabelledPath
    own: Samples
    feet: Feet
    kept: list[LabelledPath]

    def foot(self, k: int) -> tuple[LabelledPath, float, float]:
        """Path and place along it below a sample, and the sample's radius, mm."""
        return self.kept[self.feet.path[k]], float(self.feet.at[k]), float(self.own.radius[k])


class _Merge:
    """Paths that are kept, and which labels of their ends and joints are the same node."""

    def __init__(self, network: VesselNetwork) -> None:
        self.shared: list[_Shared] = []
        self._network = network
        self._paths: list[LabelledPath] = []
        self._labels = Labels(list(network.nodes))
        self._left_out: list[tuple[FloatArray, LabelledPath, float, float]] = []

    def add(self, vessels: IntArray) -> None:
        """Add vessels that may run along each other, and along no others."""
        kept: list[LabelledPath] = []
        samples: list[Samples] = []
        for vessel in vessels.tolist():
            points, radius = self._network.polyline(vessel)
            first, last = self._network.vessel_nodes[vessel].tolist()
            rests = [LabelledPath(points, radius, (first, last), vessel)]
            if kept:
                rests = self._without_shared(rests[0], kept, samples)
            kept += rests
            samples += [sample(rest.points, rest.radius) for rest in rests]
        self._paths += kept

    def _without_shared(
        self, path: LabelledPath, kept: list[LabelledPath], samples: list[Samples]
    ) -> list[LabelledPath]:
        """What of a path doesn't run along those kept, joined to them."""
        own = sample(path.points, path.radius)
        feet = nearest_feet(own, samples)
        last = len(own.at) - 1

        def is_node(k: int) -> bool:
            """Whether the path's end at sample ``k`` is a node of the path below it."""
            label = self._labels.root(path.ends[k > 0])
            return any(
                abs(at - feet.at[k]) < 1e-6 and self._labels.root(other) == label
                for at, other in kept[feet.path[k]].labelled
            )

        stretches = shared_stretches(own, feet, at_node=(is_node(0), is_node(last)))
        if not stretches:
            return [path]
        along = _Along(path, own, feet, kept)
        rests: list[LabelledPath] = []
        begin, label = 0, path.ends[0]
        for one in stretches:
            others = frozenset(kept[k].vessel for k in feet.path[one.first : one.last + 1])
            self.shared.append(_Shared(path.vessel, others, one))
            self._leave_out(along, one.first, one.last)
            self._join_ends(along, one)
            joints = [self._joint(*along.foot(k)) for k in (one.first, one.last)]
            rests += self._rest(along, (begin, one.first), (label, joints[0]))
            begin, label = one.last, joints[1]
        return rests + self._rest(along, (begin, last), (label, path.ends[1]))

    def _join_ends(self, along: _Along, one: Stretch) -> None:
        """Join paths below a stretch where one ends and another goes on."""
        feet = along.feet
        at_end = feet.to_end <= feet.radius
        for k in range(one.first, one.last):
            if feet.path[k] != feet.path[k + 1] and at_end[k] and at_end[k + 1]:
                one_end, other_end = (self._joint(*along.foot(row)) for row in (k, k + 1))
                self._labels.unite(other_end, one_end)

    def _leave_out(self, along: _Along, first: int, last: int) -> None:
        """Record where points are left out, in case that others share them."""
        for k in range(first, last + 1):
            if along.own.at[k] == round(along.own.at[k]):
                self._left_out.append((along.own.points[k], *along.foot(k)))

    def _rest(
        self, along: _Along, span: tuple[int, int], ends: tuple[int, int]
    ) -> list[LabelledPath]:
        """The path between two samples; none where it stays in the lumen that it leaves."""
        (first, last), own, path = span, along.own, along.path
        rows = np.arange(first, last + 1)
        free = [ends[side] == path.ends[side] for side in (0, 1)]
        short = own.length[last] - own.length[first] <= own.radius[rows].max()
        if (short and any(free)) or self._in_lumen(along, rows, free, short=short):
            self._leave_out(along, first, last)
            for side in (0, 1):
                if free[side]:
                    joint = ends[1 - side] if short else self._joint(*along.foot(span[side]))
                    self._labels.unite(ends[side], joint)
            return []
        rows = rows[(own.at[rows] == np.round(own.at[rows])) | (rows == first) | (rows == last)]
        return [LabelledPath(own.points[rows], own.radius[rows], ends, path.vessel)]

    def _in_lumen(self, along: _Along, rows: IntArray, free: list[bool], *, short: bool) -> bool:
        """Whether samples stay in the lumen of one path, or of two that are joined near them.

        At a free end, only where the path below ends, too: else it may be an outlet of its own.
        """
        feet = along.feet
        reach = feet.radius[rows]
        given = along.own.at[rows] == np.round(along.own.at[rows])
        limit = np.where(given, LIMITS.in_lumen, LIMITS.chord) * reach
        if not short and (feet.gap[rows] > limit).any():
            return False
        if (feet.to_end[rows] > reach)[[0, -1]][free].any():
            return False
        one, two = (along.kept[k] for k in feet.path[rows][[0, -1]])
        nodes = {self._labels.root(label): one.point(at) for at, label in one.labelled}
        joints = [nodes[k] for _, label in two.labelled if (k := self._labels.root(label)) in nodes]
        return one is two or any(
            np.linalg.norm(along.own.points[rows] - joint, axis=1).min()
            <= LIMITS.joint_reach * reach.max()
            for joint in joints
        )

    def _joint(self, path: LabelledPath, at: float, radius: float) -> int:
        """Label of the node at a place along a path, made where there is none near it."""
        point = path.point(at)
        gaps = [float(np.linalg.norm(path.point(one) - point)) for one, _ in path.labelled]
        if min(gaps) <= LIMITS.near_end * radius:
            return path.labelled[int(np.argmin(gaps))][1]
        if np.linalg.norm(path.point(round(at)) - point) <= LIMITS.near_point * radius:
            at = float(round(at))
        label = self._labels.add(path.point(at))
        path.joints.append((at, label))
        return label

    def pieces(self, path: Path, *, by_place: bool) -> tuple[Pieces, int]:
        """Straight pieces of all paths, and how many vessels were turned round for it."""
        moved = self._moved_places() if by_place else {}
        point = self._points()
        node, root = point.nodes(self._labels), self._labels.roots()
        for k in np.flatnonzero([tuple(one) in moved for one in point.place.tolist()]).tolist():
            point.place[k] = self._labels.place(moved[tuple(point.place[k].tolist())])
        kind, tree = self._network.kind[point.vessel], self._trees()[point.vessel]
        pieces = point.pieces(path, node, point.vessel + 1, kind, tree)
        # How many ends of the given vessels, and how many of their pieces, each node holds.
        share = np.bincount(root[self._network.vessel_nodes.ravel()], minlength=len(root))
        before = np.zeros(len(node) + len(root), dtype=np.int64)
        before[: len(self._network.nodes)] = self._network.degree()
        if by_place:
            pieces, share, before = self._joined(pieces, share)
        opposed = {
            v for one in self.shared if one.stretch.opposed for v in (one.vessel, *one.others)
        }
        turned = 0
        if opposed:
            pieces, flipped = _directed(pieces, np.isin(pieces.line - 1, sorted(opposed)), share)
            turned = len(np.unique(pieces.line[flipped]))
        # Where merging left two ends of vessels alone, they go on as one.
        return fuse_vessels(pieces, before != 2), turned

    def _moved_places(self) -> dict[tuple[float, ...], int]:
        """Points that were left out and are another vessel's, too; joints that are there now."""
        compared = [path.vessel for path in self._paths]
        apart = [
            self._network.polyline(v)[0]
            for v in range(self._network.vessel_count)
            if v not in set(compared)
        ]
        own = {id(path): {*map(tuple, path.points.tolist())} for path in self._paths}
        kept = set().union(*own.values(), *({*map(tuple, one.tolist())} for one in apart))
        moved: dict[tuple[float, ...], int] = {}
        for point, path, at, radius in self._left_out:
            place = tuple(point.tolist())
            if place in kept and place not in own[id(path)]:
                # As in `_rest`, no vessel of its own is shorter than a radius.
                moved.setdefault(place, self._joint(path, at, radius / LIMITS.near_end))
        return moved

    def _joined(self, pieces: Pieces, share: IntArray) -> tuple[Pieces, IntArray, IntArray]:
        """Pieces with one node a place; how many ends and pieces of given vessels each holds."""
        given = self._network
        places = np.concatenate([pieces.points.reshape(-1, 3), given.points])
        _, first, inverse = np.unique(places, axis=0, return_index=True, return_inverse=True)
        number = first[inverse.reshape(-1)]
        label, at = np.unique(pieces.nodes, return_index=True)
        ends = np.bincount(
            number[at[label < len(share)]], share[label[label < len(share)]], minlength=len(number)
        )
        held = np.full(len(given.points), 3)
        held[given.offset[:-1]] = held[given.offset[1:] - 1] = 1
        before = np.bincount(number[2 * len(pieces) :], held, minlength=len(number))
        return join_equal_points(pieces), ends.astype(np.int64), before.astype(np.int64)

    def _points(self) -> PathPoints:
        """Points of all paths and of the vessels that run along no other."""
        network = self._network
        vessel = np.repeat(np.arange(network.vessel_count), np.diff(network.offset))
        label = np.full(len(vessel), -1)
        label[network.offset[:-1]], label[network.offset[1:] - 1] = network.vessel_nodes.T
        compared = [path.vessel for path in self._paths] + [one.vessel for one in self.shared]
        own = ~np.isin(vessel, compared)
        at = (np.arange(len(vessel)) - network.offset[vessel]).astype(np.float64)
        rest = PathPoints(vessel, vessel, at, label, network.points, network.radius).where(own)
        paths = [one.rows(network.vessel_count + k) for k, one in enumerate(self._paths)]
        points = PathPoints.joined([rest, *paths])
        return points.where(np.argsort(points.vessel, kind="stable"))

    def _trees(self) -> IntArray:
        """Tree of each vessel; trees that share a vessel are one."""
        tree = self._network.tree.copy()
        for one in self.shared:
            numbers = tree[[one.vessel, *one.others]]
            tree[np.isin(tree, numbers)] = numbers.min()
        return tree


def _directed(
    pieces: Pieces, opposed: NDArray[np.bool_], share: IntArray
) -> tuple[Pieces, NDArray[np.bool_]]:
    """Direct the parts that hold ``opposed`` pieces from one end on; also which were turned."""
    nodes, points, radius = pieces.nodes.copy(), pieces.points.copy(), pieces.radius.copy()
    vessel = pieces.vessel.copy()
    turned = np.zeros(len(pieces), dtype=bool)
    size = int(nodes.max()) + 1
    for kind in np.unique(pieces.kind[opposed]).tolist():
        own = np.flatnonzero(pieces.kind == kind)
        links = coo_matrix((np.ones(len(own)), nodes[own].T), shape=(size, size)).tocsr()
        _, part = connected_components(links, directed=False)
        for number in np.unique(part[nodes[own[opposed[own]], 0]]).tolist():
            rows = own[part[nodes[own, 0]] == number]
            root = _root_of(nodes[rows], radius[rows], share)
            if root is None:
                continue
            order = breadth_first_order(links, root, directed=False, return_predecessors=False)
            rank = np.zeros(size)
            rank[order] = np.arange(len(order))
            back = rank[nodes[rows, 0]] > rank[nodes[rows, 1]]
            if kind in TOWARDS_ROOT:
                back = ~back
            turned[rows[back]] = True
            # A vessel may be turned in part: its pieces are chained anew.
            vessel[rows] = vessel.max() + 1 + np.arange(len(rows))
    for array in (nodes, points, radius):
        array[turned] = array[turned][:, ::-1]
    return replace(pieces, vessel=vessel, nodes=nodes, points=points, radius=radius), turned


def _root_of(nodes: IntArray, radius: FloatArray, share: IntArray) -> int | None:
    """End of a part that most vessels share, the widest of these; None where nothing ends."""
    flat = nodes.ravel()
    ends = np.flatnonzero(np.bincount(flat)[flat] == 1)
    if not len(ends):
        return None
    best = max(ends.tolist(), key=lambda k: (share[flat[k]], radius.ravel()[k]))
    return int(flat[best])


def _note(before: VesselNetwork, after: VesselNetwork, shared: list[_Shared], turned: int) -> str:
    stretches = [one.stretch for one in shared]
    note = (
        f"Vessels that run along each other are one: {len({one.vessel for one in shared})} of "
        f"{before.vessel_count} merged with others over {sum(s.length for s in stretches):.4g} mm "
        f"in all, the axes at most {max(s.gap for s in stretches):.3g} mm or "
        f"{100 * max(s.gap_ratio for s in stretches):.0f} % of the radius apart; left are "
        f"{after.vessel_count} vessels"
    )
    uneven = max(s.radius_difference for s in stretches)
    if uneven > LIMITS.reported_difference:
        note += (
            f"; their radii differ by up to {100 * uneven:.0f} %: those that stand first in the "
            "file are kept"
        )
    arteries = bool((after.kind == VesselKind.ARTERY).all())
    if arteries and len(after.outlets()) == 1 < len(after.inlets()):
        note += (
            f"; all {len(after.inlets())} lines run to one end, which is more likely the inlet: "
            "if so, reverse the lines in the file"
        )
    if turned:
        note += f"; turned round, as merged vessels had opposite directions: {turned}"
    return f"{note}."
