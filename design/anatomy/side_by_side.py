"""Lay an artery and a vein side by side along a tree of tubes with room for both."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from design.anatomy.curves import derived_tree, tree_runs
from design.vasculature.options import GrowthOptions
from design.vasculature.tree import VesselTree
from design.vasculature.treemath import tree_radii
from kernels.arrays import FloatArray


@dataclass(frozen=True)
class Companion:
    """A vessel beside another: what it is by the other's figures.

    Attributes
    ----------
    drop : float
        Its pressure drop over the other's.
    flow : float
        Its flow over the other's.
    tube : float
        Radius of the tube that holds both, over the other's radius; both together are as wide as
        ``1 + radius``.
    """

    drop: float
    flow: float
    tube: float

    @property
    def radius(self) -> float:
        """Its radius over the other's, at the same length (Poiseuille)."""
        return float((self.flow / self.drop) ** 0.25)


VEIN = Companion(drop=0.5, flow=1.0, tube=2.1)
"""A vein beside its artery, then 1.19 times as wide. Half of the pressure drop is ours."""


class _Sides(NamedTuple):
    """How two vessels lie side by side."""

    gap: float = 1.2  # room between them over the clearance
    wider: float = 1.05  # room for each over its radius: where both bend they come nearer
    inlets: float = 1.1  # room between the inlets over that further on: they aren't moved
    turn: float = float(np.radians(15.0))  # twist from piece to piece
    steepest: float = 0.8  # way round the tube over the way along it, at most
    straight: float = 0.1  # sine of the branches' angles to their trunk below which none has a side
    merge: float = 1.3  # way along a branch, over its trunk's radius, on which both come together
    merge_steps: int = 3


SIDES = _Sides()


class _Node(NamedTuple):
    """A node of the tubes' axes, between the two vessels."""

    point: FloatArray
    side: FloatArray  # unit vector to where the vein lies
    away: FloatArray  # (2,), mm, of artery and vein from it
    parent: int  # -1 for the inlet
    origin: int  # segment of the tubes that ends there


def tube_options(options: GrowthOptions, beside: Companion = VEIN) -> GrowthOptions:
    """Return options with which a tree of tubes grows that have room for two vessels each."""
    return replace(
        options,
        pressure_drop_pa=options.pressure_drop_pa / beside.tube**4,
        clearance_mm=(1.0 + SIDES.gap) * options.clearance_mm,
    )


def side_by_side(
    tubes: VesselTree, options: GrowthOptions, beside: Companion = VEIN
) -> tuple[VesselTree, VesselTree]:
    """Lay an artery and a vein along a tree of tubes, each with radii by its own lengths.

    The vein lies on one side of a sheet through the tubes' axes, the artery on the other. At
    each joint the sheet holds both branches, so that neither crosses the other vessel; between
    joints it turns by the smaller angle. Both vessels touch the sheet but for half of the gap.

    Parameters
    ----------
    tubes : VesselTree
        Grown with `tube_options`.
    options : GrowthOptions
        Of the artery, or of what else lies beside ``beside``.
    """
    radius = tree_radii(tubes) / beside.tube
    pair = _laid(tubes, options, radius, beside)
    # Paths beside the axes are longer, and so the vessels wider.
    wider = max(
        float(tree_radii(pair[0])[0]) / radius[0],
        float(tree_radii(pair[1])[0]) / beside.radius / radius[0],
    )
    return _laid(tubes, options, wider * radius, beside)


def _laid(
    tubes: VesselTree, options: GrowthOptions, artery: FloatArray, beside: Companion
) -> tuple[VesselTree, VesselTree]:
    """Return the two with room for arteries of these radii (n,), mm, and their veins."""
    half = 0.5 * SIDES.gap * np.maximum(options.clearance_mm, options.clearance_ratio * artery)
    wide = np.column_stack([SIDES.wider * artery, SIDES.wider * (beside.radius * artery)])
    nodes = _Sheet(tubes, wide + half[:, None]).laid()
    points, side, away, parent, origin = (np.array(one) for one in zip(*nodes, strict=True))
    up, inflow = parent[1:], float(tubes.flow_ul_s[0])

    def vessel(points: FloatArray, drop: float, flow: float) -> VesselTree:
        drop_pa = drop * options.pressure_drop_pa
        made = derived_tree(
            tubes,
            points[up],
            points[1:],
            up - 1,
            origin=origin[1:],
            flow_ul_s=flow * inflow,
            pressure_drop_pa=drop_pa,
        )
        return replace(made, notes=())

    return (
        vessel(points - away[:, :1] * side, 1.0, 1.0),
        vessel(points + away[:, 1:] * side, beside.drop, beside.flow),
    )


class _Sheet:
    """The sheet between artery and vein, laid vessel by vessel from the inlet down."""

    def __init__(self, tubes: VesselTree, away: FloatArray) -> None:
        """Begin with how far from a segment's axis artery and vein lie, ``away`` (n, 2), mm."""
        self.tubes, self.radius = tubes, tree_radii(tubes)
        self.away = away
        way = tubes.distal - tubes.proximal
        self.length = np.linalg.norm(way, axis=1)
        self.way = way / self.length[:, None]
        self.node = np.zeros(len(self.length), dtype=np.int64)
        self.end_side = np.zeros((len(self.length), 3))
        self.nodes: list[_Node] = []

    def laid(self) -> list[_Node]:
        """Return all nodes, parents before their children."""
        for run in tree_runs(self.tubes):
            self._lay(run.tolist(), int(self.tubes.parent[run[0]]))
        return self.nodes

    def _lay(self, run: list[int], above: int) -> None:
        """Lay the sheet along one vessel."""
        own = self.away[run[0]]
        if above < 0:
            side = self._first_side(run)
            up = self._add(_Node(self.tubes.proximal[run[0]], side, SIDES.inlets * own, -1, -1))
            before, merge = own, 0.0
        else:
            side, up = _across(self.end_side[above], self.way[run[0]]), int(self.node[above])
            before, merge = self.away[above], SIDES.merge * float(self.radius[above])
        sides = [side]
        for one, two in pairwise(run):
            sides.append(_across(_carried(sides[-1], self.way[one], self.way[two]), self.way[two]))
        total = float(self.length[run].sum())
        merge = min(merge, 0.6 * total)
        twist = self._twist(run[-1], sides[-1], total - merge, float(own.sum()))
        gone = 0.0
        for n, s in enumerate(run):
            parts = 1 if above < 0 and n == 0 else self._parts(s, twist, total, gone, merge)
            for k in range(1, parts + 1):
                at = gone + k / parts * self.length[s]
                normal = sides[n]
                if k == parts and n + 1 < len(run):
                    # As far from both pieces, where the bend lies across the sheet.
                    normal = sides[n] + sides[n + 1]
                    normal = normal / max(0.5, 1.0 + float(sides[n] @ sides[n + 1]))
                part = _smooth((at - merge) / (total - merge))
                turned = _turned(normal, self.way[s], twist * part)
                here = own + (before - own) * (1.0 - _smooth(at / merge) if merge > 0 else 0.0)
                point = self.tubes.proximal[s] + k / parts * self.length[s] * self.way[s]
                up = self._add(_Node(point, turned, here, up, s))
            gone += float(self.length[s])
        last = run[-1]
        self.node[last], self.end_side[last] = up, self.nodes[up].side

    def _add(self, node: _Node) -> int:
        """Add a node; return its number."""
        self.nodes.append(node)
        return len(self.nodes) - 1

    def _parts(self, s: int, twist: float, total: float, gone: float, merge: float) -> int:
        """Count pieces for one of a vessel's: as its twist and the way to its place need."""
        long = float(self.length[s])
        begin, end = ((at - merge) / (total - merge) for at in (gone, gone + long))
        parts = 1 + int(abs(twist) * (_smooth(end) - _smooth(begin)) / SIDES.turn)
        if gone < merge:
            parts = max(parts, 1 + int(SIDES.merge_steps * min(long, merge - gone) / merge))
        return parts

    def _twist(self, last: int, side: FloatArray, total: float, apart: float) -> float:
        """Return the angle by which the sheet turns on ``total`` mm to hold the joint."""
        wanted = self._joint_normal(last)
        if wanted is None:
            return 0.0
        way = self.way[last]
        angle = float(np.arctan2(np.cross(side, wanted) @ way, side @ wanted))
        angle = (angle + 0.5 * np.pi) % np.pi - 0.5 * np.pi
        most = SIDES.steepest * total / apart
        return float(np.clip(angle, -most, most))

    def _joint_normal(self, last: int) -> FloatArray | None:
        """Return the unit vector across a vessel most normal to the branches at its end.

        None at terminals, and where both branches go straight on.
        """
        a, b = self.tubes.children[last].tolist()
        if a < 0:
            return None
        way, reach = self.way[last], 1.5 * float(self.radius[last])
        headings = np.array([self._heading(a, reach), self._heading(b, reach)])
        one = _across(np.eye(3)[int(np.argmin(np.abs(way)))], way)
        frame = np.array([one, np.cross(way, one)])
        across = headings @ frame.T
        if (across**2).sum() < SIDES.straight**2:
            return None
        _, vectors = np.linalg.eigh(across.T @ across)
        normal: FloatArray = vectors[:, 0] @ frame
        return normal

    def _heading(self, s: int, reach: float) -> FloatArray:
        """Return direction from a segment's begin to where its vessel is ``reach`` further on."""
        begin, gone = self.tubes.proximal[s], 0.0
        while gone + self.length[s] < reach:
            a, b = self.tubes.children[s].tolist()
            if a < 0 or b >= 0:
                break
            gone += float(self.length[s])
            s = a
        part = min(1.0, (reach - gone) / float(self.length[s]))
        way = self.tubes.proximal[s] + part * self.length[s] * self.way[s] - begin
        heading: FloatArray = way / np.linalg.norm(way)
        return heading

    def _first_side(self, run: list[int]) -> FloatArray:
        """Return the first joint's normal, brought up to the inlet."""
        side = self._joint_normal(run[-1])
        if side is None:
            side = _across(self.way[run[-1]][[1, 2, 0]], self.way[run[-1]])
        for one, two in zip(run[:0:-1], run[-2::-1], strict=True):
            side = _across(_carried(side, self.way[one], self.way[two]), self.way[two])
        return side


def _smooth(part: float) -> float:
    """Return 0 to 1 without slope at either end."""
    part = min(max(part, 0.0), 1.0)
    return part * part * (3.0 - 2.0 * part)


def _across(vector: FloatArray, way: FloatArray) -> FloatArray:
    """Return the unit vector across ``way``, as near to ``vector`` as can be."""
    across = vector - (vector @ way) * way
    size = float(np.linalg.norm(across))
    if size < 1e-6:
        across = np.cross(way, np.eye(3)[int(np.argmin(np.abs(way)))])
        size = float(np.linalg.norm(across))
    unit: FloatArray = across / size
    return unit


def _carried(vector: FloatArray, one: FloatArray, two: FloatArray) -> FloatArray:
    """Turn a vector as ``one`` turns to ``two`` by the shortest way (parallel transport)."""
    axis = np.cross(one, two)
    carried: FloatArray = (
        vector + np.cross(axis, vector) + np.cross(axis, np.cross(axis, vector)) / (1.0 + one @ two)
    )
    return carried


def _turned(vector: FloatArray, axis: FloatArray, angle: float) -> FloatArray:
    """Return a vector across an axis turned about it."""
    turned: FloatArray = np.cos(angle) * vector + np.sin(angle) * np.cross(axis, vector)
    return turned
