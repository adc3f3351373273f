"""Plan a mend of a held print's gaps, and return it if it passes the check."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from printctl.observe.mending.check import MendCheck, check_mend
from printctl.observe.mending.gap import Gap, NotMended, check_gaps, merged
from printctl.observe.mending.held_print import HeldPrint, written_paths
from printctl.observe.mending.insert import InsertWriter, run_insert
from printctl.observe.mending.laid_ink import laid_ink
from printctl.observe.mending.mend import Mend, MendOptions, Patch
from printctl.observe.mending.stretches import (
    Site,
    Spans,
    cut_out,
    first_crossing,
    patches_of,
    wipe_way,
)
from printctl.observe.mending.voids import Voids, open_voids

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


# Plan a mend, dry-run it, and return it only if it passes the check.


def checked_mend(
    held: HeldPrint,
    gaps: Sequence[Gap],
    voids: Voids | None = None,
) -> tuple[Mend, MendCheck | None]:
    """Return a mend that may be inserted, and its check; no check where nothing is mended.

    A mend that fails its check has no lines: all of its patches are left, with the reason.

    Parameters
    ----------
    held, gaps, voids
        As for `plan_mend`.

    Raises
    ------
    MendError
        As `plan_mend`.
    """
    mend = plan_mend(held, gaps, voids)
    if not mend.lines:
        return mend, None
    check = check_mend(held, mend.lines, gaps, voids)
    if check.passed:
        return mend, check
    why = f"the check of its insert failed ({failures(check)}); mend by hand, and report this"
    own = [NotMended(one.path.number, one.gap.from_mm, one.gap.to_mm, why) for one in mend.patches]
    refused = replace(
        mend, lines=(), patches=(), spans=(), left=(*mend.left, *own), volume_ul=0.0, duration_s=0.0
    )
    return refused, check


def failures(check: MendCheck) -> str:
    """Return what an insert fails its check by, in words."""
    said = [
        f"{check.lumens_entered} pieces of ink in lumens" if check.lumens_entered else "",
        f"{check.ink_crossed} moves through written ink" if check.ink_crossed else "",
        "" if check.returns else f"it ends {check.off_mm:.4f} mm off, or at another feed",
        *check.refused,
        *check.beyond_limits,
    ]
    return "; ".join(one for one in said if one)
