"""Drop needle shaft rules between strands that form one wide vessel; report them as one vessel.

Of vessels written as one filament each all this changes nothing.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from design.toolpath.embedded.bundles import Bundles
from design.toolpath.embedded.elements import Elements
from design.toolpath.embedded.joined import JoinedPasses, WeakJoint
from design.toolpath.embedded.needle import JOINT, Needle
from design.toolpath.embedded.report import EmbeddedReport
from design.toolpath.embedded.rules import Rules, barring_each_other, owners, select_rules
from design.toolpath.embedded.touches import arcs_of
from kernels.arrays import FloatArray, IntArray

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

    def told(self, report: EmbeddedReport) -> EmbeddedReport:
        """The report in the design's vessels; crossings are told so already."""
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
