"""A print as it is held at a look: its ink, what a look is about, and gaps on its paths."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import BoolArray
from printctl.machine.job.marks import MarkKind, Marks
from printctl.observe.deciding.evidence import MapCheck, Thin, UnseenPath
from printctl.observe.expected import ExpectedInk
from printctl.observe.look_values import Look
from printctl.observe.mending import HeldPrint
from printctl.observe.mending.gap import Gap as MendGap
from printctl.observe.mends_again import LayerInk, mended_of
from printctl.observe.scan_place import ScanSize
from registration.inspection import Appearance, Gap, LayerFindings, Lumen, Stations, Unseen


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
    mends_alone : bool
        Whether nothing but mends was written since the last look: they alone are judged, among the
        ink that it was about.
    turned : str or None
        How the last picture would fit the layer clearly better.
    map : MapCheck
        What is known of the rows and columns of its height maps.
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
    mends_alone: bool = False
    turned: str | None = None
    map: MapCheck = field(default_factory=MapCheck)
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


def unseen_stretches(
    at: HeldLook, each: Sequence[LayerFindings], least_mm: float
) -> tuple[UnseenPath, ...]:
    """Return the stretches, so long at least, of which no picture sees half."""
    stations = each[0].stations
    unseen = [
        one
        for one in _stretches(stations, ~stations.seen & (stations.why != Unseen.COVERED))
        if one.length_mm >= least_mm and not any(other.stations.tell(one) for other in each[1:])
    ]
    return tuple(_named(at, one.stroke, one) for one in unseen)


def _stretches(stations: Stations, use: BoolArray) -> list[Gap]:
    """Unbroken stretches of stations."""
    found = list[Gap]()
    for stroke in np.unique(stations.stroke[use]):
        rows = np.flatnonzero(use & (stations.stroke == stroke))
        for own in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1):
            middle, half = stations.along_mm[own], 0.5 * stations.length_mm[own]
            low, high = float(middle[0] - half[0]), float(middle[-1] + half[-1])
            begin, end = ((float(x), float(y)) for x, y in stations.at_mm[own[[0, -1]]])
            found.append(Gap(int(stroke), low, high, begin, end, 0.0, 1.0))
    return found


def _named(at: HeldLook, stroke: int, part: Gap) -> UnseenPath:
    """Return a part of a path, or of a mend in it, with the name of the vessel that it writes."""
    mended = mended_of(stroke, at.layer.mended)
    number = mended.path if mended else stroke
    path = at.ink.paths[number]
    mark = at.marks.next(MarkKind.VESSEL, int(path.command[-1]))
    name = f"vessel {mark.number}" if mark and mark.number >= 0 else f"path {number}"
    if mended:
        name = f"the mend in {name}"
        off = mended.begin_mm
        part = replace(part, stroke=number, from_mm=off + part.from_mm, to_mm=off + part.to_mm)
    return UnseenPath(name, part, path.length_mm)


def learned_appearance(
    known: Appearance | None, findings: LayerFindings, least_seen: float
) -> Appearance | None:
    """Return what ink looks like; a look that saw less than ``least_seen`` tells it only at first.

    Where hardly any ink lies, what was learned is how older ink and bath differ.
    """
    if known is not None and findings.seen_share < least_seen:
        return known
    return findings.appearance or known
