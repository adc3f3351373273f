"""Turn an existing artery into the fixed trunk of a tree to be grown."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from design.errors import GrowthError
from design.network import VesselNetwork
from design.tissue import Tissue
from design.vasculature.growth.kernels.cost import PLANNED, TRUNK, Segments, refresh_all
from design.vasculature.growth.kernels.points import named_points
from design.vasculature.options import GrowthOptions, Law
from design.vasculature.tree import VesselTree
from kernels.arrays import BoolArray, FloatArray, IntArray

TOLERANCE = 0.25
"""How far a polyline may be straightened, over its vessel's mean radius."""
NARROW_PART = 0.45
"""Part of the terminals up to which a given trunk's branches are kept narrow."""


@dataclass(frozen=True)
class Trunk:
    """A tree of straight segments that stay where they are.

    Attributes
    ----------
    proximal, distal : (n, 3) float64, mm
        Segment 0 is the root; parents come before their children.
    parent : (n,) int64
    children : (n, 2) int64
        -1 for none; the second alone is -1 at a bend.
    flow : (n,) float64
        Of the tips, over the mean tip's.
    root_radius_mm : float, mm
        As it was given.
    moved_mm : float, mm
        Furthest that straightening moved a point of the axes.
    planned : (n,) bool, optional
        Segments that stay too, but belong to branches of the trunk.
    widest_branch : float
        Radius, over the root's, at which a branch takes on no more terminals while the tree has
        less than 45 % of them: others leave the trunk for what it would have fed. Later it grows
        with the tree.
    """

    proximal: FloatArray
    distal: FloatArray
    parent: IntArray
    children: IntArray
    flow: FloatArray
    root_radius_mm: float
    moved_mm: float
    planned: BoolArray | None = None
    widest_branch: float = np.inf

    @property
    def tips(self) -> int:
        """Terminals that it has of its own."""
        return int((self.children[:, 0] < 0).sum())

    def check(self, goal: int, options: GrowthOptions, tissue: Tissue) -> None:
        """Refuse what can't be grown from it.

        Raises
        ------
        GrowthError
        """
        if len(self.parent) == 0:
            raise GrowthError("the trunk has no segments; give one, or grow without")
        if self.tips > goal:
            raise GrowthError(
                f"the trunk has {self.tips} ends and {goal} terminals were asked for; ask for more"
            )
        if options.turn_angle_degrees[0] > 0:
            raise GrowthError(
                "a trunk goes straight on where a branch leaves it, but turn_angle_degrees asks "
                f"for {options.turn_angle_degrees[0]:g} at least; let it begin at 0"
            )
        self._check_ends(tissue)

    def _check_ends(self, tissue: Tissue) -> None:
        """Refuse ends outside the tissue: each would be a terminal that perfuses nothing."""
        ends = self.distal[self.children[:, 0] < 0]
        out = np.flatnonzero(~tissue.contains(ends))
        if not len(out):
            return
        raise GrowthError(
            f"{len(out)} of the trunk's {len(ends)} ends lie outside the tissue: "
            f"{named_points(ends, out, tissue.grid.distance(ends))} from it. Each would count as a "
            "terminal and perfuse nothing: take those branches away or let them end in the tissue; "
            "if all lie outside, check the trunk's unit and place"
        )

    def plant(self, segments: Segments, law: Law) -> None:
        """Lay it out as the first segments of a growing tree."""
        own = segments[: len(self.parent)]
        for axis, name in enumerate("xyz"):
            own[f"p{name}"], own[f"d{name}"] = self.proximal[:, axis], self.distal[:, axis]
        own["length"] = np.linalg.norm(self.distal - self.proximal, axis=1)
        own["parent"], own["flow"], own["relative_viscosity"] = self.parent, self.flow, 1.0
        own["left"], own["right"] = self.children.T
        own["allowed"] = np.inf
        own["given"] = TRUNK if self.planned is None else np.where(self.planned, PLANNED, TRUNK)
        refresh_all(segments, len(own), law)

    def note(self, segments: Segments, tissue: Tissue) -> str:
        """Return what the user should know of the trunk in a finished tree."""
        own = segments[segments["given"] != 0]
        begin, end = (np.column_stack([own[f"{side}{x}"] for x in "xyz"]) for side in "pd")
        out = np.count_nonzero(~tissue.grid.capsule_inside(begin, end, own["radius"]))
        return (
            f"the trunk's {len(self.parent)} segments stay where they are (straightened by "
            f"{self.moved_mm:.3g} mm at most), but their radii follow from the "
            f"{segments['terminals'][0]} terminals that they feed now: {own['radius'][0]:.3g} mm "
            f"at the root in place of {self.root_radius_mm:.3g} mm. {out} of its {len(own)} pieces "
            "reach out of the tissue, and it isn't held against itself"
        )


def trunk_of(source: VesselNetwork | VesselTree) -> Trunk:
    """Take a network or a tree as a trunk.

    A network's polylines are straightened by as little as a quarter of their radius (Douglas &
    Peucker 1973, doi 10.3138/FM57-6770-U75U-7727); what still bends stays bent.

    Raises
    ------
    GrowthError
        When the network isn't one tree: several inlets, loops, parts, or a joint of more than two
        branches.
    """
    if isinstance(source, VesselTree):
        return _of_tree(source)
    return _of_network(source)


def _of_tree(tree: VesselTree) -> Trunk:
    tips = tree.children[:, 0] < 0
    radius4 = tree.flow_ul_s[0] * tree.reduced_resistance[0] / tree.pressure_drop_pa
    return Trunk(
        tree.proximal,
        tree.distal,
        tree.parent.astype(np.int64),
        tree.children.astype(np.int64),
        tree.relative_flow / float(tree.relative_flow[tips].mean()),
        float(radius4**0.25),
        0.0,
    )


def _of_network(network: VesselNetwork) -> Trunk:
    inlets, first = network.inlets(), network.vessel_nodes[:, 0]
    if len(inlets) != 1 or len(network.nodes) != network.vessel_count + 1:
        raise GrowthError(
            f"the trunk has {len(inlets)} inlets, {len(network.nodes)} nodes and "
            f"{network.vessel_count} vessels, and so isn't one tree; give one with a single inlet "
            "and no loops"
        )
    proximal: list[FloatArray] = []
    distal: list[FloatArray] = []
    parent: list[int] = []
    moved = 0.0
    open_nodes = [(int(inlets[0]), -1)]
    root = 0.0
    while open_nodes:
        node, above = open_nodes.pop()
        leaving = np.flatnonzero(first == node)
        if len(leaving) > 2 or (above < 0 and len(leaving) > 1):
            place = network.nodes[node]
            raise GrowthError(
                "the trunk parts into {} branches at ({:.4g}, {:.4g}, {:.4g}) mm; ".format(
                    len(leaving), *place
                )
                + "let the inlet begin with one vessel, and part it into two at a time"
            )
        for vessel in leaving[::-1]:
            line, radius = network.polyline(int(vessel))
            root = root or float(radius[0])
            kept, off = straighten_line(line, TOLERANCE * float(radius.mean()))
            moved = max(moved, off)
            last = above
            for begin, end in zip(line[kept[:-1]], line[kept[1:]], strict=True):
                proximal.append(begin)
                distal.append(end)
                parent.append(last)
                last = len(parent) - 1
            open_nodes.append((int(network.vessel_nodes[vessel, 1]), last))
    if len(parent) < network.vessel_count:
        raise GrowthError("the trunk has parts that its inlet doesn't reach; give one tree")
    up = np.array(parent, dtype=np.int64)
    flow = np.ones(len(up))
    return Trunk(np.array(proximal), np.array(distal), up, _children(up), flow, root, moved)


def _children(parent: IntArray) -> IntArray:
    children = np.full((len(parent), 2), -1, dtype=np.int64)
    for i, above in enumerate(parent.tolist()):
        if above >= 0:
            children[above, 0 if children[above, 0] < 0 else 1] = i
    return children


def straighten_line(line: FloatArray, tolerance_mm: float) -> tuple[IntArray, float]:
    """Points of a polyline that stay, and the furthest that the others were from the new line.

    Douglas and Peucker's algorithm: of the points between two that stay, the furthest from their
    straight stays if it is further than the tolerance.
    """
    keep = {0, len(line) - 1}
    spans = [(0, len(line) - 1)]
    moved = 0.0
    while spans:
        a, b = spans.pop()
        if b - a < 2:
            continue
        way = line[b] - line[a]
        size = float(way @ way)
        along = np.clip((line[a + 1 : b] - line[a]) @ way / max(size, 1e-300), 0.0, 1.0)
        off = np.linalg.norm(line[a + 1 : b] - line[a] - np.outer(along, way), axis=1)
        at = int(np.argmax(off))
        if off[at] <= tolerance_mm:
            moved = max(moved, float(off[at]))
            continue
        keep.add(a + 1 + at)
        spans += [(a, a + 1 + at), (a + 1 + at, b)]
    return np.array(sorted(keep), dtype=np.int64), moved
