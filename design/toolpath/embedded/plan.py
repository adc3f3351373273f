"""From a network to embedded filaments: cut, order, write."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from design.network import VesselNetwork
from design.toolpath.embedded.filament import frustum_ul
from design.toolpath.embedded.heads import EmbeddedHeads
from design.toolpath.embedded.options import EmbeddedOptions
from design.toolpath.embedded.order import order_pieces
from design.toolpath.embedded.pieces import Piece, cut
from design.toolpath.embedded.report import Crossing, EmbeddedReport
from design.toolpath.embedded.shaft import Conflicts, Needle, find_conflicts
from design.toolpath.embedded.write import FilamentWriter
from design.toolpath.toolpath import MoveKind, Toolpath


@dataclass(frozen=True)
class EmbeddedPlan:
    """A toolpath and its numbers."""

    toolpath: Toolpath
    report: EmbeddedReport


def embedded_toolpath(network: VesselNetwork, options: EmbeddedOptions) -> Toolpath:
    """Write ``network`` along its centrelines; see `plan_embedded`."""
    return plan_embedded(network, options).toolpath


def plan_embedded(network: VesselNetwork, options: EmbeddedOptions | EmbeddedHeads) -> EmbeddedPlan:
    """Plan the writing of ``network`` from the bottom up and say what couldn't be avoided.

    Q = π d² v / 4; the speed is the highest that speed and flow limits allow. The shaft passes
    through nothing written before, except where the report names a crossing. Pieces are cut at
    turning points of their height and nowhere else: a cycle of pieces that each must come before
    the next is broken where it does the least harm, not split. Of several heads
    (`EmbeddedHeads`) each writes its own vessels, with as few changes as the order allows; the
    widest of their shafts is kept clear of what is written.

    Raises
    ------
    ToolpathError
        When a vessel is too thin for the needle or too thick for flow and speed.
    """
    heads = EmbeddedHeads.one(options, network) if isinstance(options, EmbeddedOptions) else options
    heads.check(network)
    pieces = cut(network)
    needle = Needle(heads.shaft_mm, heads.overlap_radii)
    several = None
    if len(heads.options) > 1:
        several = np.array([heads.of(piece.vessel) for piece in pieces], dtype=np.int64)
    ordered = order_pieces(pieces, find_conflicts(pieces, needle), several)
    writer = FilamentWriter(ordered[0], heads)
    paths = [writer.write(piece) for piece in ordered]
    # Once more on what is really written: directions and overlaps are known only now.
    crossings = _crossings(ordered, find_conflicts(ordered, needle, paths))
    toolpath = writer.builder.build()
    return EmbeddedPlan(toolpath, _report(toolpath, ordered, writer, crossings))


def _crossings(ordered: list[Piece], conflicts: Conflicts) -> tuple[Crossing, ...]:
    """What is broken by writing pieces in the order in which they stand."""
    found = [
        Crossing(ordered[k].vessel, ordered[k].vessel, float(conflicts.own_mm[k]))
        for k in np.flatnonzero(conflicts.own_mm)
    ]
    found += [
        Crossing(
            ordered[conflicts.first[k]].vessel,
            ordered[conflicts.second[k]].vessel,
            float(conflicts.harm_mm[k]),
        )
        for k in np.flatnonzero(conflicts.first > conflicts.second)
    ]
    return tuple(sorted(found, key=lambda c: (-c.length_mm, c.vessel, c.through)))


def _report(
    toolpath: Toolpath,
    ordered: list[Piece],
    writer: FilamentWriter,
    crossings: tuple[Crossing, ...],
) -> EmbeddedReport:
    length, speed = toolpath.lengths, toolpath.speed_mm_s
    write, travel = toolpath.kind == MoveKind.WRITE, toolpath.kind == MoveKind.TRAVEL
    return EmbeddedReport(
        pieces=len(ordered),
        passes=writer.passes,
        crossings=crossings,
        joints=writer.joints,
        overlapped=writer.overlapped,
        continued=writer.continued,
        design_ul=float(sum(frustum_ul(p.points, p.radius).sum() for p in ordered)),
        overlap_ul=writer.overlap_ul,
        written_ul=toolpath.written_ul,
        written_mm=float(length[write].sum()),
        travel_mm=float(length[travel].sum()),
        write_s=float((length[write] / speed[write]).sum()),
        travel_s=float((length[travel] / speed[travel]).sum()),
        slowest_mm_s=float(speed[write].min()),
        fastest_mm_s=float(speed[write].max()),
    )
