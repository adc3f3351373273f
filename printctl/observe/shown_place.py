"""Judge a layer at the place where its ink shows; within tolerance where that isn't sure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from printctl.observe.deciding.evidence import SURE
from printctl.observe.judging import shift_of
from registration.inspection import LayerFindings, SeeingOptions

_SHOWN: Final = 0.5
"""Of a layer's way, with ink at its shifted place, for that to be its place."""
_ALL: Final = 0.8
"""The same, for none of its ink to be missing."""
_WHOLE: Final = 0.95
_ENDS_SEEN: Final = 0.5
_MORE: Final = 0.5
"""Of the tolerance: so much more ink, mm, at a moved place says that it lies there."""


def seen_where_ink_shows(
    see: Callable[[SeeingOptions], LayerFindings],
    options: SeeingOptions,
    tolerated_mm: float,
    lone: bool = False,
) -> LayerFindings:
    """Return what is seen; at a place beyond tolerance only where the ink itself shows it.

    Where most of a layer is missing, its lines fit older ones beside them as well as their own
    place, and gaps would be told of bath where none should be written. What lies within tolerance
    would show in the bath between older lines, if it lay there. A lone line whose end is missing
    fits best moved along itself: a move that isn't sure excuses no missing ink. Ink as long as it
    should be, more of whose ends show at the moved place, lies there: a gap makes it shorter, a
    move along itself doesn't; where the end that such a move leads with isn't seen, nothing tells
    them apart. Where no older line lies there (``lone``), nearly all of the ink shows at a moved
    place, and less than half within tolerance, none is missing: it lies aside. Such a place is
    looked for twice as far as others.
    """
    findings = see(options)
    moved_mm, u_mm = shift_of(findings)
    unsure = moved_mm > tolerated_mm >= moved_mm - SURE * u_mm
    slid = moved_mm > tolerated_mm and _across_mm(findings) <= tolerated_mm
    unsure = unsure or slid
    if not unsure and findings.coverage >= _SHOWN:
        return findings
    within = see(replace(options, shift_mm=tolerated_mm))
    whole = unsure and findings.coverage > _WHOLE and not findings.gaps
    whole = whole and not (slid and _leads_unseen(findings, moved_mm))
    if whole and _more_at_ends_mm(findings, within, 2 * moved_mm) > _MORE * tolerated_mm:
        return replace(findings, aside=True)
    if lone and not within.coverage >= _SHOWN:
        for one in (findings, see(replace(options, shift_mm=2 * options.shift_mm))):
            if one.seen_share * one.coverage > _ALL and shift_of(one)[0] > tolerated_mm:
                return replace(one, aside=True)
    return within


def _across_mm(findings: LayerFindings) -> float:
    """How far a layer seems moved across its lines, mm, root mean square."""
    by = np.array([findings.shift.dx_mm, findings.shift.dy_mm])
    normal = findings.stations.normal
    return float(np.sqrt(np.mean((normal @ by) ** 2))) if len(normal) else 0.0


def _leads_unseen(findings: LayerFindings, moved_mm: float) -> bool:
    """Whether too little is seen of the ends that would lie beyond their place, moved so.

    An end that is missing looks like a move to the other one, whose ink may lie in older ink.
    """
    stations, by = findings.stations, np.array([findings.shift.dx_mm, findings.shift.dy_mm])
    ahead = stations.at_mm @ by / moved_mm
    leads = np.zeros(len(ahead), dtype=np.bool_)
    for stroke in np.unique(stations.stroke):
        own = stations.stroke == stroke
        leads |= own & (ahead > ahead[own].max() - moved_mm)
    length = stations.length_mm
    return float(length[leads & stations.seen].sum()) < _ALL * float(length[leads].sum())


def _more_at_ends_mm(moved: LayerFindings, within: LayerFindings, reach_mm: float) -> float:
    """Way with ink so near to strokes' ends at a moved place over that within tolerance, mm.

    Of a stroke in the mean. Strokes of whose ends either sees less than half tell nothing.
    """
    more_mm, strokes = 0.0, np.unique(moved.stations.stroke)
    for stroke in strokes:
        (ink, seen), (ink_within, seen_within) = (
            _at_ends(one, stroke, reach_mm) for one in (moved, within)
        )
        if min(seen, seen_within) >= _ENDS_SEEN:
            more_mm += ink - ink_within
    return more_mm / len(strokes)


def _at_ends(findings: LayerFindings, stroke: int, reach_mm: float) -> tuple[float, float]:
    """Way with ink near a stroke's ends, mm, and the share of it that is seen."""
    stations = findings.stations
    own = stations.stroke == stroke
    along, length, seen = stations.along_mm[own], stations.length_mm[own], stations.seen[own]
    if not len(along):
        return 0.0, 0.0
    near = (along < along.min() + reach_mm) | (along > along.max() - reach_mm)
    ink = (length * stations.present[own])[near & seen].sum()
    return float(ink), float(length[near & seen].sum() / length[near].sum())
