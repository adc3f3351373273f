"""A print as it is held at a look: its ink, what a look is about, and gaps on its paths."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from printctl.link.marks import MarkKind, Marks
from printctl.observe.deciding.evidence import UnseenPath
from printctl.observe.deciding.thin import Thin
from printctl.observe.expected import ExpectedInk
from printctl.observe.mending import HeldPrint
from printctl.observe.mending.gap import Gap as MendGap
from printctl.observe.mends_again import LayerInk, Mended
from printctl.observe.observer import Look
from printctl.observe.scan_place import ScanSize
from registration.layer_images import Gap, LayerFindings, Lumen


@dataclass
class HeldLook:
    """Print as it is held at a look: what is worked out once for its pictures and its mend.

    Attributes
    ----------
    look : Look
    held : HeldPrint
    flow : float
        Factor in force.
    ink : ExpectedInk
    layer : LayerInk
        Ink that the look is about.
    lumens : tuple of Lumen
    since : (n,) bool
        Lines of the layer written since that look, older ones mended in between included.
    marks : Marks
        Of the grown job.
    found : dict
        Findings of the pictures judged so far.
    mended : tuple of Mended
        Gaps that are written again from here.
    turned : str or None
        How the last picture would fit the layer clearly better.
    size : ScanSize or None
        Of the last volume.
    """

    look: Look
    held: HeldPrint
    flow: float
    ink: ExpectedInk
    layer: LayerInk
    lumens: tuple[Lumen, ...]
    since: NDArray[np.bool_]
    marks: Marks
    found: dict[Path, LayerFindings] = field(default_factory=dict)
    mended: tuple[Mended, ...] = ()
    turned: str | None = None
    size: ScanSize | None = None


def slab(at: HeldLook) -> tuple[float, float]:
    """Middle and thickness of the layer that is looked at, mm; of all filaments in a bath."""
    ink, rows = at.ink, at.layer.row[at.layer.lines.fresh]
    if not len(rows):
        return 0.0, 1.0
    top = float(ink.end[rows, 2].max())
    if ink.style == "layered":
        thick = float(np.median(ink.height_mm[rows]))
        return top - thick / 2, thick
    z, half = np.stack([ink.start[rows, 2], ink.end[rows, 2]]), ink.height_mm[rows] / 2
    low, high = float((z - half).min()), float((z + half).max())
    return (low + high) / 2, high - low


def gaps_to_mend(
    gaps: tuple[Gap, ...], thin: tuple[Thin, ...], at: HeldLook, flow: float
) -> list[MendGap]:
    """Gaps on their paths, with what the flow was corrected by since they were to be written."""
    mend_gaps = list[MendGap]()
    each: list[Gap | Thin] = [*gaps, *thin]
    for one in each:
        before = float(at.ink.factor[at.ink.stroke == one.stroke][0])
        end = min(one.to_mm, at.ink.paths[one.stroke].length_mm)
        missing = one.missing if isinstance(one, Thin) else 1.0
        mend_gaps.append(
            MendGap(one.stroke, max(one.from_mm, 0.0), end, missing, flow=flow / before)
        )
    return mend_gaps


def unseen_paths(at: HeldLook, each: Sequence[LayerFindings]) -> tuple[UnseenPath, ...]:
    """Return what none of a look's pictures tells of the vessels in a bath, by their names.

    Parts that are no longer in every picture than tolerated aren't told of.
    """
    bare = set.intersection(*(set(one.bare) for one in each))
    unseen = each[0].unseen
    for other in each[1:]:
        unseen = tuple(part for one in unseen for part in _shared(one, other.unseen))
    out = [_named(at, stroke, None) for stroke in bare]
    out += [_named(at, one.stroke, one) for one in unseen if one.stroke not in bare]
    return tuple(sorted(out, key=lambda one: (one.gap.stroke, one.gap.from_mm)))


def _shared(one: Gap, others: Sequence[Gap]) -> list[Gap]:
    """What each of several stretches has in common with one."""
    parts = []
    for other in others:
        begin = max(one, other, key=lambda each: each.from_mm)
        end = min(one, other, key=lambda each: each.to_mm)
        if other.stroke == one.stroke and begin.from_mm < end.to_mm:
            start = replace(one, from_mm=begin.from_mm, start_mm=begin.start_mm)
            parts.append(replace(start, to_mm=end.to_mm, end_mm=end.end_mm))
    return parts


def _named(at: HeldLook, stroke: int, part: Gap | None) -> UnseenPath:
    """Return a path, or a part of one, with the name of the vessel that it writes."""
    path = at.ink.paths[stroke]
    mark = at.marks.next(MarkKind.VESSEL, int(path.command[-1]))
    name = f"vessel {mark.number}" if mark and mark.number >= 0 else f"path {stroke}"
    begin, end = ((float(one[0]), float(one[1])) for one in path.points[[0, -1]])
    whole = Gap(stroke, 0.0, path.length_mm, begin, end, 0.0, 1.0)
    return UnseenPath(name, part or whole, path.length_mm, bare=part is None)
