"""Say why missing ink is asked about: the layer's place may explain it, or more of it is unseen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from printctl.observe.deciding.decision import Decision, DecisionKind
from printctl.observe.deciding.evidence import Evidence
from printctl.observe.deciding.gap_test import GapTest
from registration.inspection.options import IN_PART
from registration.inspection.values import Gap

_LIKE_AMOUNT: Final = 0.5
"""Of what seems to be missing, from which on ink beside the lines says that they lie elsewhere."""


def doubts(
    evidence: Evidence, believed: Sequence[Gap], test: GapTest
) -> tuple[list[str], tuple[Gap, ...]]:
    """Return reasons to ask, and what may lack ink besides the gaps that count.

    Parameters
    ----------
    evidence : Evidence
    believed : sequence of Gap
        Of it, those that count.
    test : GapTest
    """
    missing, beside = _way(believed), evidence.beside_mm
    reasons = list[str]()
    if evidence.map.unsized and (believed or evidence.thin):
        reasons.append(
            "nothing tells whether the map is whole: there is none before it, observe.frame names "
            "no size, and the ink at its ends doesn't show it; behind lost rows ink shows aside, "
            "as if it were missing"
        )
    if believed and beside > _LIKE_AMOUNT * missing:
        reasons.append(
            f"{missing:.1f} mm seem to be missing, and {beside:.1f} mm of a line lie where none "
            "should: layer, dish or map may be moved, turned or cut"
        )
    if moved := [one for one in evidence.unplaced if test.significant(one, evidence.places)]:
        reasons.append(
            f"{_way(moved):.2f} mm are missing if the layer lies {evidence.shift_mm:.2f} mm beside "
            "its place, and not if it lies where it should; nothing tells which"
        )
    strokes = {one.stroke for one in believed}
    once = tuple(
        one
        for one in evidence.half_seen
        if one.stroke not in strokes
        and one.length_mm >= test.least_mm
        and test.significant(one, evidence.places)
    )
    if once:
        reasons.append(f"{_way(once):.2f} mm seem to be missing; a second picture hardly sees them")
    next_to = [
        one for one in evidence.hidden if any(one.gap.meets(gap, test.least_mm) for gap in believed)
    ]
    if next_to:
        words = ", ".join(one.words for one in next_to)
        reasons.append(f"next to {_many(believed)}, {words} can't be told")
    return reasons, (*once, *(one.gap for one in next_to))


def of_whole_map(wanted: Decision, evidence: Evidence) -> Decision:
    """Ask about what a map shows that isn't whole: moved, missing and no ink look alike."""
    lacks, goes_on = evidence.map.lacks, (DecisionKind.GO_ON, DecisionKind.FLOW)
    if not lacks or evidence.turned is not None or wanted.kind in goes_on:
        return wanted
    why = (
        f"the map {lacks}; what lies behind lost ones shows aside, as if ink were missing or "
        f"the layer moved: look anew, or look before it is mended ({wanted.why})"
    )
    ask = DecisionKind.MEND if wanted.gaps or wanted.thin else None
    return replace(wanted, kind=DecisionKind.PAUSE, why=why, ask=ask, factor=None)


def cause_of_turn(turned: str) -> str:
    """What to check where a picture fits its layer better turned or moved, as that says."""
    if turned.endswith(IN_PART):
        return "the map lacks rows or columns, or motors lost steps within the layer: look anew"
    if turned.startswith("moved"):
        return "motors have lost steps, or dish or device have moved: check both, then the frame"
    return "check the device's axes and observe.frame"


def unconfirmed_words(evidence: Evidence, test: GapTest) -> str:
    """What one picture shows as missing and the other doesn't, in words."""
    gaps = [gap for gap in evidence.gaps if test.significant(gap, evidence.places)]
    if not gaps:
        return ""
    return f"; {_many(gaps)}, in one of two pictures alone: not believed"


def _many(gaps: Sequence[Gap]) -> str:
    many = "1 gap" if len(gaps) == 1 else f"{len(gaps)} gaps"
    return f"{many}, {_way(gaps):.2f} mm in all"


def _way(gaps: Sequence[Gap]) -> float:
    return math.fsum(one.length_mm for one in gaps)
