"""Choose vessels to leave unwritten because the needle would enter ink in any order."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from itertools import groupby
from typing import Final, NamedTuple

import numpy as np

from design.errors import ToolpathError
from design.network import VesselNetwork
from design.toolpath.embedded.elements import Elements
from design.toolpath.embedded.needle import EmbeddedHeads, Needle
from design.toolpath.embedded.order.joints import Joiner
from design.toolpath.embedded.order.pass_order import placed
from design.toolpath.embedded.order.schedule import Leg, Pass
from design.toolpath.embedded.report import Crossing, JoinedPasses, OmittedVessel
from design.toolpath.embedded.rules import Rules, either_way, owners, select_rules, with_more
from design.toolpath.embedded.shaft_contacts import CERTAIN_MM, entries_mm
from kernels.arrays import FloatArray, IntArray

HALVINGS: Final = 7
"""Of the range of needles in which the widest that fits is looked for: to 1 %."""


class Conflict(NamedTuple):
    """Two vessels between which the needle can't be kept out of ink."""

    vessel: int  # of the design
    other: int
    strand: int  # as they are written
    other_strand: int
    place_mm: tuple[float, float, float]  # where it is worst
    apart_mm: float  # by which they are too near there


def choose_omitted(
    conflicts: Iterable[Conflict], network: VesselNetwork, out: set[int]
) -> dict[int, Conflict]:
    """Vessels of which each conflict has one, with the worst of each; some are ``out`` already.

    Greedy: the one that settles most conflicts for the length that is left out and cut off from
    its supply (Chvatal 1979, Math. Oper. Res. 4, 233); those that turn out needless are written.
    """
    of: dict[int, list[Conflict]] = defaultdict(list)
    for one in conflicts:
        for vessel in {one.vessel, one.other}:
            of[vessel].append(one)
    supply, length = Supply(network), network.lengths()
    lost = {v: float(length[[v, *supply.cut_off({v})]].sum()) for v in of}
    lost |= {v: float(length[v]) for v in supply.cut_off(out) if v in of}
    open_ = {id(one) for own in of.values() for one in own}
    omitted: list[int] = []
    while open_:
        gain = {v: sum(id(c) in open_ for c in own) / lost[v] for v, own in of.items()}
        omitted.append(max(gain, key=lambda v: (gain[v], -v)))
        open_ -= {id(one) for one in of[omitted[-1]]}
        # What has lost its supply anyway costs no more than itself.
        lost |= {v: float(length[v]) for v in supply.cut_off(out | set(omitted)) if v in of}
    needed = set(omitted)
    for vessel in sorted(omitted, key=lambda v: -lost[v]):
        if all(({c.vessel, c.other} - {vessel}) & needed for c in of[vessel]):
            needed.discard(vessel)
    return {v: max(of[v], key=lambda c: c.apart_mm) for v in sorted(needed)}


class Supply:
    """Designed flow of a network, from vessel to vessel.

    Parameters
    ----------
    network : VesselNetwork
    """

    def __init__(self, network: VesselNetwork) -> None:
        tail, head = network.vessel_nodes.T
        self._head = head.tolist()
        self._feeds = np.bincount(head, minlength=len(network.nodes)).tolist()
        self._leads: dict[int, list[int]] = defaultdict(list)
        for number, node in enumerate(tail.tolist()):
            self._leads[node].append(number)

    def cut_off(self, out: set[int]) -> list[int]:
        """Vessels to which no flow leads once some are ``out``, those not counted."""
        cut: set[int] = set()
        lost: dict[int, int] = defaultdict(int)
        queue = list(out)
        while queue:
            node = self._head[queue.pop()]
            lost[node] += 1
            if lost[node] == self._feeds[node]:
                dry = [one for one in self._leads[node] if one not in out and one not in cut]
                cut.update(dry)
                queue += dry
        return sorted(cut)


class Omissions:
    """Which vessels aren't written, and why; none at first.

    Parameters
    ----------
    design : VesselNetwork
    joiner : Joiner
    owner : (s,) int64
        The design's vessel of each that is written.

    Attributes
    ----------
    elements : (n,) bool
        Elements that aren't written.
    """

    def __init__(self, design: VesselNetwork, joiner: Joiner, owner: IntArray) -> None:
        self.elements = np.zeros(len(joiner.elements.end), dtype=np.bool_)
        self._design, self._joiner, self._owner = design, joiner, owner
        self._cut, self._meetings, self._needle = joiner.elements, joiner.meetings, joiner.needle
        self._why: dict[int, Conflict] = {}
        self._tried: set[int] = set()

    def conflicts(self, rules: Rules) -> list[Conflict]:
        """Pairs of vessels with elements that the bare needle enters in either order."""
        first, after = either_way(rules)
        deep = self._depth_mm(first, after, self._needle.bare())
        worst: dict[tuple[int, int], Conflict] = {}
        order = np.argsort(-deep, kind="stable")
        for k in order[deep[order] > CERTAIN_MM].tolist():
            one, other = (int(self._cut.vessel[each[k]]) for each in (first, after))
            pair = int(self._owner[one]), int(self._owner[other])
            if (min(pair), max(pair)) not in worst:
                x, y, z = self._cut.point[self._cut.end[first[k]]].mean(axis=0).tolist()
                worst[min(pair), max(pair)] = Conflict(*pair, one, other, (x, y, z), float(deep[k]))
        return list(worst.values())

    def crossed(self, crossings: Iterable[Crossing]) -> list[Conflict]:
        """Those of a path whose needle still enters ink, or may once the path is rounded."""
        return [
            Conflict(one.vessel, one.through, -1, -1, one.place_mm, one.depth_mm)
            for one in crossings
            if one.depth_mm > CERTAIN_MM
        ]

    def omit(self, conflicts: Iterable[Conflict]) -> None:
        """Leave out one vessel of each conflict."""
        self._why |= choose_omitted(conflicts, self._design, set(self._why))
        self.elements = np.isin(self._owner[self._cut.vessel], list(self._why))
        if self.elements.all():
            raise ToolpathError(
                "no vessel can be written without the needle passing through ink; use a thinner "
                "needle, or move the vessels apart"
            )

    def without(self, rules: Rules) -> Rules:
        """The rules among elements that are written."""
        return select_rules(rules, ~(self.elements[owners(rules)] | self.elements[rules.after]))

    def trimmed(self, passes: list[Pass]) -> list[Pass]:
        """Passes without what isn't written, in their order."""
        parts = (groupby(one.legs, lambda leg: bool(self.elements[leg.element])) for one in passes)
        return [Pass(tuple(legs)) for own in parts for gone, legs in own if not gone]

    def put_back(
        self, passes: list[Pass], crossed: list[Conflict], rules: Rules, heads: EmbeddedHeads
    ) -> tuple[list[Pass], JoinedPasses]:
        """Passes with the vessels for which their order has a place after all, and how they join.

        Each is tried once. Of those that ``crossed`` the first goes before the other.
        """
        cut, left = self._cut, dict(self._why)
        # Of two that bar each other in any order both must be out.
        free = (v for v, c in left.items() if c.strand < 0 or {c.vessel, c.other} <= left.keys())
        tried = set(free) - self._tried
        self._tried |= tried
        first, after = owners(rules), rules.after
        named = np.isin(self._owner[cut.vessel], list(tried))
        rows = named[first] | named[after]
        parts = cut, self._meetings, self._needle.bare()
        rows[rows] = entries_mm(first[rows], after[rows], *parts) > CERTAIN_MM
        known, more = select_rules(rules, rows), passes
        for one in crossed:
            known = with_more(known, *_near_pairs(one.vessel, one.other, cut, self._needle))
        length = self._design.lengths()
        for vessel in sorted(tried, key=lambda v: (-length[v], v)):
            whole: list[Pass] | None = more
            for strand in np.flatnonzero(self._owner == vessel).tolist():
                low, high = cut.first[strand : strand + 2].tolist()
                new = Pass((Leg(low, 1, high - low),))
                whole = whole and placed(whole, new, cut, known, heads.vessel_head)
            if whole:
                more = whole
                del left[vessel]
        joined = self._joiner.join(more)
        if len(joined.open) > min(one.open_joints for one in heads.options):
            return passes, self._joiner.join(passes)
        self._why, self.elements = left, np.isin(self._owner[cut.vessel], list(left))
        return more, joined

    def omitted_vessels(self) -> tuple[OmittedVessel, ...]:
        """All that isn't written, with what would have to change."""
        return tuple(self._omitted_vessel(vessel, why) for vessel, why in sorted(self._why.items()))

    def cut_off(self) -> tuple[int, ...]:
        """Written vessels to which no flow leads."""
        return tuple(Supply(self._design).cut_off(set(self._why)))

    def _omitted_vessel(self, vessel: int, why: Conflict) -> OmittedVessel:
        other = why.other if why.vessel == vessel else why.vessel
        return OmittedVessel(vessel, other, why.place_mm, why.apart_mm, self._widest(why))

    def _depth_mm(self, first: IntArray, after: IntArray, needle: Needle) -> FloatArray:
        """Depth to which the needle enters one of each two elements in the better order, (k,)."""
        parts = self._cut, self._meetings, needle
        return np.minimum(entries_mm(first, after, *parts), entries_mm(after, first, *parts))

    def _widest(self, why: Conflict) -> float:
        """Outer diameter of the widest tip found with which two don't bar each other, mm."""
        if why.strand < 0:
            return 0.0
        needle = self._needle.bare()
        pairs = _near_pairs(why.strand, why.other_strand, self._cut, needle)
        low, high = 0.0, needle.tip_mm
        for _ in range(HALVINGS):
            radius = (low + high) / 2
            barred = (self._depth_mm(*pairs, needle.thinner(radius)) > CERTAIN_MM).any()
            low, high = (low, radius) if barred else (radius, high)
        return 2 * low


def _near_pairs(v: int, w: int, elements: Elements, needle: Needle) -> tuple[IntArray, IntArray]:
    """Elements of two vessels that the needle may touch together, each pair once."""
    one, other = (np.arange(elements.first[k], elements.first[k + 1]) for k in (v, w))
    both = np.concatenate([one, other])
    room = needle.shaft_mm + elements.radius[both].max() + elements.length[both].max()
    middle = elements.point[elements.end].mean(axis=1)[:, :2]
    away = np.linalg.norm(middle[one][:, None] - middle[other], axis=2)
    i, j = np.nonzero(away < room)
    once = one[i] < other[j] if v == w else np.ones(len(i), dtype=np.bool_)
    return one[i[once]], other[j[once]]
