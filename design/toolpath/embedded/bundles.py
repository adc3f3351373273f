"""Divide vessels wider than one filament into parallel strands that merge into one lumen.

A strand is a vessel of its own to the planner. Strands of a bundle lie on a hexagonal lattice
around the axis, so near to each other that they overlap by 0.3 of their radius: more than the
quarter from which two filaments count as one body (`rules.TOUCHING`), so no shaft among them is a
crossing. Together they hold the vessel's volume.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.errors import ToolpathError
from design.network import VesselNetwork
from design.solids.tube import unit_rings
from design.toolpath.embedded.elements import Elements
from design.toolpath.embedded.needle import JOINT, Needle
from design.toolpath.embedded.report import EmbeddedReport, JoinedPasses, WeakJoint
from design.toolpath.embedded.rules import Rules, barring_each_other, owners, select_rules
from design.toolpath.embedded.touches import arcs_of
from design.toolpath.gcode import Gcode
from kernels.arrays import FloatArray, IntArray

STRANDS = (1, 7, 19, 37)
"""Whole rings of a hexagonal lattice, with one strand on the axis that keeps the joints."""
SPACING: Final = 1.7
"""Between neighbours, in radii of a strand."""


@dataclass(frozen=True)
class Bundles:
    """Network whose thick vessels are divided into strands.

    Attributes
    ----------
    network : VesselNetwork
        The design's vessels first, each on its own axis and as thin as its strands; then the
        strands around them, each between two nodes of its own.
    owner : (n,) int64
        The design's vessel of each.
    """

    network: VesselNetwork
    owner: IntArray

    @property
    def is_plain(self) -> bool:
        """Whether every vessel is one filament."""
        return len(np.unique(self.owner)) == len(self.owner)

    @staticmethod
    def plain(network: VesselNetwork) -> Bundles:
        """Every vessel one filament."""
        return Bundles(network, np.arange(network.vessel_count))

    def design(self) -> VesselNetwork:
        """The design's vessels, each as wide as its lumen."""
        if self.is_plain:
            return self.network
        count, strands = int(self.owner.max()) + 1, np.bincount(self.owner)
        last, whole = int(self.network.offset[count]), self.network
        wide = whole.radius[:last] * np.sqrt(np.repeat(strands, np.diff(whole.offset[: count + 1])))
        ends = whole.vessel_nodes[:count]
        return VesselNetwork(
            nodes=whole.nodes[: int(ends.max()) + 1],
            vessel_nodes=ends,
            kind=whole.kind[:count],
            tree=whole.tree[:count],
            offset=whole.offset[: count + 1],
            points=whole.points[:last],
            radius=wide,
        )

    def widest_radius(self) -> FloatArray:
        """Of the design's vessel of each strand, (n,), mm."""
        count = np.bincount(self.owner)[self.owner]
        thick = np.maximum.reduceat(self.network.radius, self.network.offset[:-1])
        return np.asarray(thick[self.owner] * np.sqrt(count))

    def of_design(self, parts: Iterable[Gcode], beside: dict[str, Any]) -> Iterator[Gcode]:
        """G-code whose lines and marks name the design's vessels.

        When the last part is through, ``beside`` has each line's ``strand``.
        """
        strands = []
        for part in parts:
            strands.append(part.line_source)
            known = part.line_source >= 0
            source = np.where(known, self.owner[part.line_source], part.line_source)
            yield replace(part, data=self._marks(part.data), line_source=source)
        beside["strand"] = np.concatenate(strands).astype(np.int32)

    def _marks(self, data: bytes) -> bytes:
        def mark(match: re.Match[bytes]) -> bytes:
            return b"%s_END:%d" % (match[1], self.owner[int(match[2])])

        return re.sub(rb"(PASS|PART)_END:(\d+)", mark, data)


def bundled(network: VesselNetwork, widest_mm: FloatArray) -> Bundles:
    """Strands for vessels wider than one filament; the network itself where there are none.

    Parameters
    ----------
    network : VesselNetwork
    widest_mm : (v,) float64, mm
        Widest filament for each vessel.

    Raises
    ------
    ToolpathError
        For a vessel that asks for more strands than are laid.
    """
    own = np.arange(network.vessel_count)
    wide = 2 * np.maximum.reduceat(network.radius, network.offset[:-1])
    strands = _strands(wide, widest_mm)
    if np.all(strands == 1):
        return Bundles(network, own)
    thin = network.radius / np.sqrt(np.repeat(strands, np.diff(network.offset)))
    lines = [(points, radius) for points, radius in replace(network, radius=thin).polylines()]
    owner = own.tolist()
    for vessel in np.flatnonzero(strands > 1).tolist():
        around = _around(*lines[vessel], int(strands[vessel]))
        lines += around
        owner += [vessel] * len(around)
    return Bundles(_with_lines(network, lines, np.array(owner)), np.array(owner))


def _strands(wide: FloatArray, widest_mm: FloatArray) -> IntArray:
    needed = (wide / widest_mm) ** 2 * (1 - 1e-9)
    place = np.searchsorted(STRANDS, needed)
    if np.any(place == len(STRANDS)):
        vessel = int(np.argmax(needed))
        most = np.sqrt(STRANDS[-1]) * widest_mm[vessel]
        raise ToolpathError(
            f"vessel {vessel}: diameter {wide[vessel]:.3f} mm is more than the {most:.3f} mm of "
            f"{STRANDS[-1]} filaments of {widest_mm[vessel]:.3f} mm side by side "
            "(widest_filament_mm); use a wider needle, or print it in layers (method: fresh)"
        )
    return np.array(STRANDS)[place]


def _around(
    points: FloatArray, radius: FloatArray, strands: int
) -> list[tuple[FloatArray, FloatArray]]:
    """Lines beside an axis, and their radii."""
    direction = np.diff(points, axis=0)
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    frame = unit_rings(direction, 4)[:, :2]  # a quarter turn apart
    beside = []
    for place in _lattice(strands)[1:]:
        line = points + SPACING * radius[:, None] * np.einsum("i,kij->kj", place, frame)
        kept = _forward(line, direction)
        beside.append((line[kept], radius[kept]))
    return beside


def _lattice(strands: int) -> FloatArray:
    """Places of a hexagonal lattice of spacing 1, (n, 2), the middle first."""
    rings = STRANDS.index(strands)
    span = range(-rings, rings + 1)
    cells = [(i, j) for i in span for j in span if abs(i + j) <= rings]
    places = np.array([(i + j / 2, j * np.sqrt(3) / 2) for i, j in cells])
    return places[np.argsort(np.round(np.linalg.norm(places, axis=1), 6), kind="stable")]


def _forward(line: FloatArray, direction: FloatArray) -> IntArray:
    """Points that lead on; those inside a bend narrower than the bundle would lead back."""
    kept = [0]
    for k in range(1, len(line) - 1):
        if (line[k] - line[kept[-1]]) @ direction[k - 1] > 0:
            kept.append(k)
    while len(kept) > 1 and (line[-1] - line[kept[-1]]) @ direction[-1] <= 0:
        kept.pop()
    return np.array([*kept, len(line) - 1])


def _with_lines(
    network: VesselNetwork, lines: list[tuple[FloatArray, FloatArray]], owner: IntArray
) -> VesselNetwork:
    more = lines[network.vessel_count :]
    ends = np.array([line[[0, -1]] for line, _ in more]).reshape(-1, 3)
    pairs = len(network.nodes) + np.arange(len(ends)).reshape(-1, 2)
    return VesselNetwork(
        nodes=np.concatenate([network.nodes, ends]),
        vessel_nodes=np.concatenate([network.vessel_nodes, pairs]),
        kind=network.kind[owner],
        tree=network.tree[owner],
        offset=np.cumsum([0, *(len(radius) for _, radius in lines)]),
        points=np.concatenate([line for line, _ in lines]),
        radius=np.concatenate([radius for _, radius in lines]),
    )


# Of vessels written as one filament each all this changes nothing.
Mask = NDArray[np.bool_]


class LumenGroups:
    """Groups of strands that form one lumen.

    Parameters
    ----------
    bundles : Bundles
    elements : Elements
        Of its network.
    needle : Needle
    """

    def __init__(self, bundles: Bundles, elements: Elements, needle: Needle) -> None:
        self._bundles, self._elements = bundles, elements
        self._owner = bundles.owner
        self._nodes = bundles.network.vessel_nodes[bundles.owner]
        self._bundled = np.bincount(bundles.owner)[bundles.owner] > 1
        radius = bundles.widest_radius()
        # Without the overlap: where a strand goes on by it, what follows is so much further off.
        self._reach: FloatArray = JOINT * (needle.joint_mm + radius)
        length = np.add.reduceat(elements.length, elements.first[:-1])
        # To the far end of each, from either end of its strand: those stand square to the nodes.
        back = length[elements.vessel] - elements.arc
        self._ways = np.column_stack([elements.arc + elements.length, back])

    def without(self, rules: Rules) -> Rules:
        """The rules, but those among strands that bar each other in a lumen, or in a joint.

        Of two strands one over the other the lower still goes first.
        """
        if self._bundles.is_plain:
            return rules
        first, after = owners(rules), rules.after
        within = self._beside(first, after) & barring_each_other(rules)
        return select_rules(rules, ~(within | self._joined(first, after)))

    @property
    def lumen_mm(self) -> FloatArray:
        """Widest radius of each of the design's vessels that is a bundle, mm; 0 of the others."""
        count = int(self._owner.max()) + 1
        return np.where(self._bundled, self._bundles.widest_radius(), 0.0)[:count]

    def of_design(
        self, vessel: IntArray, along: FloatArray, radius: FloatArray
    ) -> tuple[IntArray, FloatArray, FloatArray]:
        """What strands lay, (w,) and (w, 2), by the design's vessels and the ways along these."""
        if self._bundles.is_plain:
            return vessel, along, radius
        length = arcs_of(self._bundles.network)[1]
        share = length[self._owner] / length
        return self._owner[vessel], along * share[vessel][:, None], radius

    def closed(self, joined: JoinedPasses) -> JoinedPasses:
        """Without joints that bundles close all the same: the strands beside them go on."""
        if self._bundles.is_plain:
            return joined
        return replace(joined, open=[one for one in joined.open if not self._inside(one)])

    def report_of_design(self, report: EmbeddedReport) -> EmbeddedReport:
        """The report in the design's vessels; crossings name them already."""
        if self._bundles.is_plain:
            return report
        owner = self._owner.tolist()

        def weak(one: WeakJoint) -> WeakJoint:
            bar = owner[one.barred_by] if one.barred_by >= 0 else -1
            return replace(one, vessel=owner[one.vessel], other=owner[one.other], barred_by=bar)

        return replace(
            report,
            vessels=int(self._owner.max()) + 1,
            shortened=tuple(map(weak, report.shortened)),
            open=tuple(map(weak, report.open)),
        )

    def _beside(self, first: IntArray, second: IntArray) -> Mask:
        """Whether both are of one bundle, and within a joint's reach along it."""
        vessel = self._elements.vessel
        one, other = vessel[first], vessel[second]
        same = (self._owner[one] == self._owner[other]) & self._bundled[one]
        ends, begins = self._ways[:, 0], self._elements.arc
        along = np.maximum(ends[first] - begins[second], ends[second] - begins[first])
        return same & (along <= self._reach[one])

    def _joined(self, first: IntArray, second: IntArray) -> Mask:
        """Whether both lie within a joint's reach of a node of both their design's vessels."""
        vessel = self._elements.vessel
        one, other = vessel[first], vessel[second]
        reach = np.maximum(self._reach[one], self._reach[other])
        joined = np.zeros(len(first), dtype=np.bool_)
        for a in (0, 1):
            for b in (0, 1):
                near = (self._ways[first, a] <= reach) & (self._ways[second, b] <= reach)
                joined |= near & (self._nodes[one, a] == self._nodes[other, b])
        return joined & (self._bundled[one] | self._bundled[other])

    def _inside(self, one: WeakJoint) -> bool:
        """Whether a joint is one among strands: of one bundle, or of two that meet."""
        a, b = one.vessel, one.other
        if self._owner[a] == self._owner[b]:
            return bool(self._bundled[a])
        both = bool(self._bundled[a] and self._bundled[b])
        return both and bool(set(self._nodes[a].tolist()) & set(self._nodes[b].tolist()))
