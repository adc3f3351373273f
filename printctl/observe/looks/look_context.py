"""Values of a look at a held print: context, judgement, mend, unseen stretches."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from kernels.arrays import BoolArray
from printctl.inspection import Gap, LayerFindings, Lumen, Unseen
from printctl.machine.job.marks import Mark, MarkKind, Marks
from printctl.observe.deciding import Evidence
from printctl.observe.deciding.evidence import MapCheck, UnseenPath
from printctl.observe.looks.expected_ink import ExpectedInk, LayerInk, MendedStretch, is_mended
from printctl.observe.looks.height_maps import ScanSize
from printctl.observe.looks.look_evidence import seen_in
from printctl.observe.mending import HeldPrint


@dataclass(frozen=True)
class Look:
    """Look for which the link holds the print.

    Attributes
    ----------
    number : int
    done : int
        Command lines of the growing job that were taken.
    job_line : int
        Command lines of the job's file among them.
    before : int
        ``done`` of the look before.
    mark : str
    until_s : float, s of the monotonic clock
        By when its pictures are wanted, so that it is decided within the link's limit.
    """

    number: int
    done: int
    job_line: int
    before: int
    mark: str
    until_s: float = math.inf

    @property
    def within_vessel(self) -> bool:
        """Whether more of the vessel follows."""
        return self.mark.startswith(str(Mark(0, MarkKind.PART)))


@dataclass(frozen=True)
class LookJudgement:
    """Judgement of a look's pictures.

    Attributes
    ----------
    evidence : Evidence
    found : dict
        Figures for the record.
    flow : float
        Factor in force, as the job's inserts have it.
    learned : dict
        State of `InspectionState`, for the records.
    """

    evidence: Evidence
    found: dict[str, Any]
    flow: float = 1.0
    learned: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class MendLines:
    """G-code lines that mend a look's gaps and thin lines.

    Attributes
    ----------
    lines : tuple of str
        None where nothing can be mended.
    left : str
        What isn't mended by them, and why; empty for nothing.
    left_mm : float, mm
    mended : tuple of dict
        Gaps that they write again (`MendedStretch`) with both ends, mm; inspected once more.
    given_up : bool
        Whether a gap was written so often in vain that the operator alone has it written again.
    """

    lines: tuple[str, ...] = ()
    left: str = ""
    left_mm: float = 0.0
    mended: tuple[dict[str, Any], ...] = ()
    given_up: bool = False


@dataclass
class LookContext:
    """Held print, expected ink and findings of one look, shared by its pictures and its mend.

    Attributes
    ----------
    look : Look
        With ``before`` where the ink begins that is judged.
    held_print : HeldPrint
    flow : float
        Factor in force.
    ink : ExpectedInk
    layer : LayerInk
        Ink that the look is about.
    lumens : tuple of Lumen
    marks : Marks
        Of the grown job.
    slab_mm : (float, float), mm
        Middle and thickness of the layer; of all filaments in a bath.
    mended : tuple of MendedStretch
        Gaps that the last look had written again, if nothing else was written since: they alone are
        judged, among the ink that it was about.
    found : dict
        Findings of the pictures judged so far.
    turned : str or None
        How the last picture would fit the layer clearly better.
    map : MapCheck
        What is known of the rows and columns of its height maps.
    size : ScanSize or None
        Of the last volume.
    """

    look: Look
    held_print: HeldPrint
    flow: float
    ink: ExpectedInk
    layer: LayerInk
    lumens: tuple[Lumen, ...]
    marks: Marks
    slab_mm: tuple[float, float] = (0.0, 1.0)
    mended: tuple[MendedStretch, ...] = ()
    found: dict[Path, LayerFindings] = field(default_factory=dict)
    turned: str | None = None
    map: MapCheck = field(default_factory=MapCheck)
    size: ScanSize | None = None

    @property
    def since(self) -> BoolArray:
        """Mask of the layer's lines written since the look before, (n,)."""
        return np.asarray(self.ink.command[self.layer.row] >= self.look.before)


def unseen_stretches(
    context: LookContext, each: Sequence[LayerFindings], least_mm: float
) -> tuple[UnseenPath, ...]:
    """Return the stretches, ``least_mm`` or longer, that weren't seen.

    A look at mends alone returns those in the mends only: the last look has reported the rest.
    """
    stations, unseen = each[0].stations, list[UnseenPath]()
    all_seen = seen_in([one.stations for one in each])
    covered = np.logical_and.reduce([one.stations.why == Unseen.COVERED for one in each])
    use = ~all_seen & ~covered
    for stroke in np.unique(stations.stroke[use]).tolist():
        rows = np.flatnonzero(use & (stations.stroke == stroke))
        for own in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1):
            middle, half = stations.along_mm[own], 0.5 * stations.length_mm[own]
            low, high = float(middle[0] - half[0]), float(middle[-1] + half[-1])
            begin, end = ((float(x), float(y)) for x, y in stations.at_mm[own[[0, -1]]])
            gap = Gap(stroke, low, high, begin, end, 0.0, 1.0)
            about = not context.mended or is_mended(gap, context.mended)
            if gap.length_mm >= least_mm and about:
                unseen.append(_named(context, gap))
    return tuple(unseen)


def _named(context: LookContext, part: Gap) -> UnseenPath:
    """Return a part of a path with the name of the vessel that it writes."""
    path = context.ink.paths[part.stroke]
    mark = context.marks.next(MarkKind.VESSEL, int(path.command[-1]))
    name = f"vessel {mark.number}" if mark and mark.number >= 0 else f"path {part.stroke}"
    return UnseenPath("the mend in " * bool(context.mended) + name, part, path.length_mm)
