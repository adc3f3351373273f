"""Plan a mend: order patches of the gaps, drop blocked ones, write them as one insert."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from printctl.observe.mending.gap import Gap, NotMended, check_gaps, merged
from printctl.observe.mending.held_print import HeldPrint
from printctl.observe.mending.insert_lines import InsertWriter
from printctl.observe.mending.insert_run import run_insert
from printctl.observe.mending.laid_ink import laid_ink
from printctl.observe.mending.mend import Mend
from printctl.observe.mending.open_voids import open_voids
from printctl.observe.mending.options import MendOptions
from printctl.observe.mending.patch import Patch
from printctl.observe.mending.stretches import Site, patches_of
from printctl.observe.mending.voids import Voids
from printctl.observe.mending.whole_way import Spans, cut_out, first_crossing
from printctl.observe.mending.wipe import wipe_way
from printctl.observe.mending.written_paths import written_paths

_SAME_DEPTH_MM: Final = 0.05
"""Patches that lie no deeper than this are ordered by their travel."""


def plan_mend(
    held: HeldPrint,
    gaps: Sequence[Gap],
    voids: Voids | None = None,
    options: MendOptions | None = None,
) -> Mend:
    """Plan the insert that mends gaps of a held print.

    Each patch is the job's own path of the missing stretch: its height, corners, speed and
    plunger over way, with an overlap on sound ink at both ends. What can't be mended is in
    `Mend.left`, with the reason.

    Parameters
    ----------
    held : HeldPrint
    gaps : sequence of Gap
    voids : Voids, optional
        What the design keeps open.
    options : MendOptions, optional

    Raises
    ------
    MendError
        For gaps that aren't on written paths.
    """
    options = options or MendOptions()
    paths = written_paths(held)
    check_gaps(gaps, paths)
    joined = merged(gaps, paths, options.merge_widths)
    ink = laid_ink(paths, gaps)  # what lies between joined gaps is in the needle's way
    around = np.vstack([np.zeros((0, 3)), *(paths[gap.path].points for gap in joined)])
    wide = float(ink.width_mm.max(initial=0.0))
    kept_open = open_voids(voids or Voids.none(), held, around, wide)
    site = Site(held, paths, ink, kept_open, options, gaps)
    patches: list[Patch] = []
    left: list[NotMended] = []
    for gap in joined:
        own, not_mended = patches_of(gap, site)
        patches += own
        left += not_mended
    return _written(ordered(patches, held), left, site)


def ordered(patches: Sequence[Patch], held: HeldPrint) -> list[Patch]:
    """Return patches in their order: nearest next; in a bath the deepest first."""
    rest, in_order, at = list(patches), [], held.at_mm
    while rest:
        near = rest
        if held.style == "embedded":
            deepest = min(one.lowest_mm for one in rest)
            near = [one for one in rest if one.lowest_mm <= deepest + _SAME_DEPTH_MM]
        begins = [one.moves()[0][0] for one in near]
        chosen = near[int(np.argmin([np.linalg.norm(p - at) for p in begins]))]
        in_order.append(chosen)
        at = chosen.moves()[0][-1]
        rest.remove(chosen)
    return in_order


def _written(patches: list[Patch], left: list[NotMended], site: Site) -> Mend:
    """The insert of patches whose whole way is free; others are left out."""
    while patches:
        lines, spans = _lines(patches, site)
        crossing = None if site.layered else first_crossing(lines, patches, spans, site)
        if crossing is None:
            return _mend(lines, patches, spans, left, site)
        wrong = crossing.patch
        pieces, not_mended = cut_out(patches[wrong], crossing, site.options)
        left += [not_mended] if not_mended.length_mm > 0 else []
        patches = patches[:wrong] + pieces + patches[wrong + 1 :]
    return Mend((), (), (), tuple(left), 0.0, 0.0)


def _lines(patches: Sequence[Patch], site: Site) -> tuple[list[bytes], Spans]:
    held, options = site.held, site.options
    layer = max((float(one.path.height_mm.max()) for one in patches), default=0.0)
    top = max(
        site.ink.top_mm(layered=site.layered),
        float(held.at_mm[2]),
        *(float(one.path.points[:, 2].max()) for one in patches),
    )
    high = min(top + options.travel_lift_mm(layer, layered=site.layered), held.printer.z_mm.high)
    writer = InsertWriter(held, high)
    writer.begin()
    if options.purge is not None:
        writer.purge(options.purge, max(held.top_mm, high))
    spans = []
    for one in patches:
        spans.append(writer.patch(one, wipe_way(one, patches, site)))
    writer.end()
    return writer.lines, spans


def _mend(
    lines: list[bytes], patches: list[Patch], spans: Spans, left: list[NotMended], site: Site
) -> Mend:
    held, purge = site.held, site.options.purge
    volume = sum(float(one.moves()[1].sum()) for one in patches) * held.ul_per_e
    volume += 0.0 if purge is None else purge.volume_ul
    lasts = run_insert(held, lines).duration_s
    return Mend(tuple(lines), tuple(patches), tuple(spans), tuple(left), volume, lasts)
