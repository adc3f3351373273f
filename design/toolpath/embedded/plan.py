"""Plan embedded writing of a network: order its vessels, close joints, return the toolpath."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np

from design.errors import ToolpathError
from design.network import VesselNetwork
from design.toolpath.embedded.bundles import Bundles, LumenGroups
from design.toolpath.embedded.elements import (
    Elements,
    Squares,
    elements_of,
    longest_mm,
    squares_of,
)
from design.toolpath.embedded.left_out import Omissions
from design.toolpath.embedded.needle import EmbeddedHeads, Needle
from design.toolpath.embedded.options import EmbeddedOptions
from design.toolpath.embedded.order.joints import Joiner
from design.toolpath.embedded.order.pass_order import order_passes
from design.toolpath.embedded.order.schedule import Pass
from design.toolpath.embedded.report import (
    Crossing,
    EmbeddedReport,
    JoinedPasses,
    Merged,
    WeakJoint,
)
from design.toolpath.embedded.rules import (
    Meetings,
    Rules,
    along_elements,
    find_meetings,
    find_rules,
)
from design.toolpath.embedded.shaft_contacts import (
    TOUCH_MM,
    Entry,
    WrittenMoves,
    exempt_lengths,
    find_shaft_contacts,
)
from design.toolpath.embedded.touches import Touches, touches
from design.toolpath.embedded.write import FilamentWriter, add_recovery_dwells
from design.toolpath.toolpath import MoveKind, Toolpath
from kernels.arrays import IntArray


@dataclass(frozen=True)
class _Written:
    """A path with its joints and its writer, and where its shaft meets ink or passes it closely."""

    toolpath: Toolpath
    joined: JoinedPasses
    writer: FilamentWriter
    crossings: tuple[Crossing, ...]
    grazes: tuple[Crossing, ...]


@dataclass(frozen=True)
class EmbeddedPlan:
    """Toolpath of an embedded plan, with its report."""

    toolpath: Toolpath
    report: EmbeddedReport


@dataclass(frozen=True)
class Scene:
    """A network and a needle made ready for planning."""

    design: VesselNetwork
    elements: Elements
    squares: Squares
    meetings: Meetings
    collisions: Touches
    needle: Needle
    lumens: LumenGroups

    @staticmethod
    def of(bundles: Bundles, heads: EmbeddedHeads) -> Scene:
        """Cut the vessels, and find where they meet."""
        network = bundles.network
        needle = Needle(
            *heads.bare_mm, heads.tip_mm, heads.shaft_mm, heads.cone_mm, heads.overlap_radii
        )
        elements = elements_of(network, longest_mm(network, heads.tip_mm))
        squares = squares_of(elements, needle.shaft_mm)
        lumens = LumenGroups(bundles, elements, needle)
        design = bundles.design()
        collisions = touches(design, needle)
        length = np.add.reduceat(elements.length, elements.first[:-1])
        touching = along_elements(collisions, elements)
        meetings = find_meetings(network.vessel_nodes, length, touching)
        return Scene(design, elements, squares, meetings, collisions, needle, lumens)

    def written(
        self,
        passes: list[Pass],
        joined: JoinedPasses,
        heads: EmbeddedHeads,
    ) -> _Written:
        """The path of ordered passes, and what its shaft meets."""
        joined = self.lumens.closed(joined)
        looks = frozenset[int]()
        if heads.look_within:
            looks = look_places(passes, self.elements, self.needle)
        writer = FilamentWriter(self.elements, passes[0], heads, looks)
        writer.write_all(passes, joined)
        recovery_s = max(one.recovery_s for one in heads.options)
        toolpath = add_recovery_dwells(writer.builder.build(), recovery_s, heads.shaft_mm)
        laid = WrittenMoves(*self.lumens.of_design(*writer.laid()))
        spared = exempt_lengths(self.design, self.collisions, self.lumens.lumen_mm)
        look = max(one.clearance_mm for one in heads.options)
        entries = find_shaft_contacts(toolpath, laid, spared, heads.needles(), look)
        deep = [one for one in entries if one.depth_mm > TOUCH_MM]
        near = [one for one in entries if one.depth_mm <= TOUCH_MM]
        crossings, grazes = _by_vessels(deep, toolpath), _by_vessels(near, toolpath)
        return _Written(toolpath, joined, writer, crossings, grazes)


def plan_embedded(
    written: VesselNetwork | Bundles, options: EmbeddedOptions | EmbeddedHeads
) -> EmbeddedPlan:
    """Plan the writing of a network and say what couldn't be avoided.

    Vessels are cut into short elements; of two of which one stands in the shaft's way while the
    other is written the order is fixed (`rules`), and passes are laid through them (`schedule`) so
    that the needle is lifted seldom. Passes go through nodes where they can, and are cut where
    vessels wait for each other. Ends that meet ink are carried on into it (`joints`).

    Q = π d² v / 4; the speed is the highest that speed and flow limits allow. Of several heads
    (`EmbeddedHeads`) each writes its own vessels; the widest of their shafts is kept clear.

    Of `Bundles` the path's sources and the heads' vessels are strands; the report tells of the
    design's vessels.

    Raises
    ------
    ToolpathError
        When a vessel is too thin for the needle or too thick for flow and speed, or when a joint
        can't be closed and `EmbeddedOptions.open_joints` doesn't allow that.
    """
    bundles = Bundles.plain(written) if isinstance(written, VesselNetwork) else written
    network = bundles.network
    heads = EmbeddedHeads.one(options, network) if isinstance(options, EmbeddedOptions) else options
    heads.check(network)
    scene = Scene.of(bundles, heads)
    all_rules = find_rules(scene.elements, scene.squares, scene.meetings, scene.needle)
    rules = scene.lumens.without(all_rules)
    joiner = Joiner(scene.elements, scene.squares, scene.meetings, scene.needle, heads.leave_out)
    out = Omissions(scene.design, joiner, bundles.owner)
    if heads.leave_out:
        out.omit(out.conflicts(rules))
    passes, joined = order_passes(
        scene.elements, out.without(rules), heads.vessel_head, joiner, out.elements
    )
    while True:
        done = scene.written(passes, joined, heads)
        crossed = out.crossed((*done.crossings, *done.grazes))
        if not heads.leave_out or not crossed:
            break
        out.omit(crossed)
        passes, joined = out.put_back(out.trimmed(passes), crossed, rules, heads)
    if joined.open:
        joined = joiner.join(passes, explain=True)
    done = replace(done, joined=scene.lumens.closed(joined))
    _refuse_open(done.joined, heads)
    report = _report(done, scene, passes, out)
    return EmbeddedPlan(done.toolpath, scene.lumens.report_of_design(report))


def _refuse_open(joined: JoinedPasses, heads: EmbeddedHeads) -> None:
    allowed = min(options.open_joints for options in heads.options)
    if len(joined.open) > allowed:
        first = joined.open[0]
        x, y, z = first.place_mm
        raise ToolpathError(
            f"{len(joined.open)} of {joined.joints} joints can't be made to overlap (allowed: "
            f"{allowed}): the first is vessel {first.vessel} with vessel "
            f"{first.other} at ({x:.2f}, {y:.2f}, {z:.2f}) mm, where vessel {first.barred_by} is "
            f"in the shaft's way from either side{_room(first)}; use a thinner needle, move the "
            "vessels apart, or allow them (toolpath.open_joints in a recipe)"
        )


def _room(one: WeakJoint) -> str:
    if one.needle_mm == 0.0:
        return ""
    return (
        f" (a quarter of the overlap has room with a tip {one.needle_mm:.3f} mm wide outside, or "
        f"that vessel {one.apart_mm:.3f} mm further off sideways)"
    )


def _by_vessels(entries: list[Entry], toolpath: Toolpath) -> tuple[Crossing, ...]:
    """Entries by pairs of vessels, the deepest first."""
    pairs: dict[tuple[int, int], list[Entry]] = {}
    for one in entries:
        pairs.setdefault((one.vessel, one.through), []).append(one)
    crossings = []
    for pair, own in pairs.items():
        deepest = max(own, key=lambda one: one.depth_mm)
        x, y, z = toolpath.start[deepest.move].tolist()
        length = sum(one.length_mm for one in own)
        crossings.append(Crossing(*pair, length, deepest.depth_mm, (x, y, z)))
    return tuple(sorted(crossings, key=lambda c: (-c.depth_mm, c.vessel, c.through)))


def _merged(network: VesselNetwork, touches: Touches) -> tuple[Merged, ...]:
    """Pairs of vessels without a common node that overlap, the deepest first.

    Those that share one and leave it side by side are one body for longer than a joint reaches.
    """
    low, high = touches.vessel.min(axis=1), touches.vessel.max(axis=1)
    deepest: dict[tuple[int, int], float] = {}
    for a, b, overlap in zip(low.tolist(), high.tolist(), touches.overlap.tolist(), strict=True):
        deepest[a, b] = max(deepest.get((a, b), 0.0), overlap)
    ends = [set(pair) for pair in network.vessel_nodes.tolist()]
    merged = [Merged(a, b, overlap) for (a, b), overlap in deepest.items() if not ends[a] & ends[b]]
    return tuple(sorted(merged, key=lambda m: (-m.overlap_mm, m.vessel, m.other)))


def _report(done: _Written, scene: Scene, passes: list[Pass], out: Omissions) -> EmbeddedReport:
    toolpath, joined, elements = done.toolpath, done.joined, scene.elements
    length, speed = toolpath.lengths, toolpath.speed_mm_s
    write, travel = toolpath.kind == MoveKind.WRITE, toolpath.kind == MoveKind.TRAVEL
    r0, r1 = elements.radius.T
    volume = np.pi / 3 * elements.length * (r0**2 + r0 * r1 + r1**2)
    return EmbeddedReport(
        vessels=int(elements.vessel[-1]) + 1,
        passes=len(passes),
        crossings=done.crossings,
        grazes=done.grazes,
        merged=_merged(scene.design, scene.collisions),
        joints=joined.joints,
        overlapped=joined.overlapped,
        shortened=tuple(joined.shortened),
        continued=joined.through,
        open=tuple(joined.open),
        left_out=out.omitted_vessels(),
        cut_off=out.cut_off(),
        design_ul=float(volume[~out.elements].sum()),
        overlap_ul=done.writer.overlap_ul,
        written_ul=toolpath.written_ul,
        written_mm=float(length[write].sum()),
        travel_mm=float(length[travel].sum()),
        write_s=float((length[write] / speed[write]).sum()),
        travel_s=float((length[travel] / speed[travel]).sum()),
        waited_s=float(toolpath.duration_s[toolpath.kind == MoveKind.DWELL].sum()),
        slowest_mm_s=float(speed[write].min()),
        fastest_mm_s=float(speed[write].max()),
    )


MEND_OVERLAP_RADII: Final = 0.5
"""Reach of the joint that mends are judged by (`printctl.observe.mending`), in radii."""


def look_places(passes: Sequence[Pass], elements: Elements, needle: Needle) -> frozenset[int]:
    """Return the elements before which a print should be looked at; never a pass's first one.

    A needle that mends an element stands where it stood when that was written, and meets what the
    pass has written since: beyond some 54 degrees a pass bars the way to itself. A look is due
    before the first element that bars one written since the last look. So all that a look is the
    first to see can be reached in it.

    As in a mend, of which each pass is one path, the bare needle counts, and ink is spared by its
    way along the pass alone: nodes within it are no joints of their own.

    Parameters
    ----------
    passes : sequence of Pass
        In their order.
    elements : Elements
    needle : Needle
        With its clearance.
    """
    order = np.concatenate([one.elements() for one in passes])
    written = _as_written(passes, elements)
    mends = needle.bare()._replace(overlap_radii=MEND_OVERLAP_RADII)
    none = Touches(np.zeros((0, 2), np.int64), np.zeros((0, 2)), np.zeros(0), np.zeros(0))
    alone = np.arange(2 * len(passes)).reshape(-1, 2)  # no joints but those along a vessel
    meetings = find_meetings(alone, np.zeros(len(passes)), none)
    rules = find_rules(written, squares_of(written, mends.shaft_mm), meetings, mends)
    first = written.first.tolist()
    return frozenset(
        int(order[at]) for low, high in pairwise(first) for at in _in_pass(low, high, rules)
    )


def _as_written(passes: Sequence[Pass], elements: Elements) -> Elements:
    """Elements in the order and direction of writing, each pass a vessel of its own."""
    order = np.concatenate([one.elements() for one in passes])
    legs = [leg for one in passes for leg in one.legs]
    backwards = np.repeat([leg.step < 0 for leg in legs], [leg.size for leg in legs])[:, None]
    count = [sum(leg.size for leg in one.legs) for one in passes]
    first = np.concatenate([[0], np.cumsum(count)])
    number = np.repeat(np.arange(len(passes)), count)
    end, radius, length = elements.end[order], elements.radius[order], elements.length[order]
    way = np.cumsum(length) - length
    arc = way - way[first[:-1]][number]
    return Elements(
        elements.point,
        np.where(backwards, end[:, ::-1], end),
        np.where(backwards, radius[:, ::-1], radius),
        length,
        arc,
        np.column_stack([arc, arc + length]),
        number,
        first,
    )


def _in_pass(low: int, high: int, rules: Rules) -> list[int]:
    """Those of a pass whose elements are ``low`` to ``high - 1``."""
    barred = np.full(high - low, -1, dtype=np.int64)  # the last one before that each bars
    for element in range(low, high):
        later: IntArray = rules.after[rules.begin[element] : rules.begin[element + 1]]
        barred[later[(later > element) & (later < high)] - low] = element
    looked, places = low, list[int]()
    for element in range(low + 1, high):
        if barred[element - low] >= looked:
            looked = element
            places.append(element)
    return places
