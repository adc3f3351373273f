"""Stretches of a look that a person is asked about, and the reasons."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from printctl.observe.deciding.decision import Decision, DecisionKind, GapTest
from printctl.observe.deciding.evidence import Evidence
from printctl.observe.deciding.layers_seen import where
from registration.inspection.findings import ASKED_MM
from registration.inspection.options import IN_PART
from registration.inspection.values import Gap

_TAIL_MM: Final = 0.2
"""Least stretch that isn't told behind the last ink before a clog."""
_JOINED_MM: Final = 0.3
"""Between a gap and a stretch that joins it."""
_JOINED: Final = 3.0
"""Times the gaps' length, up to which what joins them is written with them."""
_NAMED: Final = 3
"""Stretches that are told by their places."""


def places_of(stretches: Sequence[Gap]) -> str:
    """Name the first stretches by their places, in words."""
    more = f" and {len(stretches) - _NAMED} more" * (len(stretches) > _NAMED)
    return ",".join(where([one]) for one in stretches[:_NAMED]) + more


def unchanged(evidence: Evidence) -> tuple[Gap, ...]:
    """Stretches that surely didn't change and aren't told otherwise, long enough to be asked of."""
    still = () if evidence.told is None else evidence.told.still
    return tuple(one for one in still if one.length_mm >= ASKED_MM)


def doubted(evidence: Evidence) -> tuple[Gap, ...]:
    """Stretches as long that look bare, though the picture changed there."""
    found = () if evidence.told is None else evidence.told.doubted
    return tuple(one for one in found if one.length_mm >= ASKED_MM)


def asked_with_beside(wanted: Decision, evidence: Evidence) -> Decision:
    """Ask for what is wanted; of a mend with what joins its gaps and isn't told."""
    asked = replace(wanted, kind=DecisionKind.PAUSE, ask=wanted.kind)
    if not (beside := _beside(wanted.gaps, evidence)):
        return asked
    way_mm = math.fsum(one.length_mm for one in beside)
    also = f"approve also writes {way_mm:.1f} mm beside it that isn't told{places_of(beside)}"
    return replace(asked, why=f"{wanted.why}; {also}", gaps=(*wanted.gaps, *beside))


def low_words(evidence: Evidence, width_percent: float) -> str:
    """Where ink on older ink stands lower than is tolerated of widths, in words; empty for nowhere.

    ``width_percent`` is what a line may be thinner by.
    """
    if not evidence.low:
        return ""
    low_mm = math.fsum(one.length_mm for one in evidence.low)
    longest = max(evidence.low, key=lambda one: one.length_mm)
    return (
        f"; along {low_mm:.1f} mm it stands more than {width_percent:g} % of a layer lower than "
        f"elsewhere{where((longest,))}: ink may be thin there"
    )


def thin_words(evidence: Evidence) -> str:
    """Where ink without a width may be thin, in words; empty for nowhere."""
    thin = () if evidence.told is None else evidence.told.thin
    if not thin:
        return ""
    way_mm = math.fsum(one.length_mm for one in thin)
    return (
        f"; along {way_mm:.1f} mm{places_of(thin)} the picture changed near the line's middle "
        "alone, and of others like it up to their edges: ink may be thin there"
    )


def _beside(gaps: tuple[Gap, ...], evidence: Evidence) -> tuple[Gap, ...]:
    """Stretches that aren't told or didn't change and join gaps, those far longer left out."""
    told = evidence.told
    most = _JOINED * math.fsum(one.length_mm for one in gaps)
    out = list[Gap]()
    for one in () if told is None else (*told.unseen, *told.still):
        joins = any(one.meets(gap, _JOINED_MM) for gap in gaps)
        known = any(one.meets(other) for other in (*gaps, *out))
        if joins and not known and _TAIL_MM <= one.length_mm <= most:
            out.append(one)
    return tuple(out)


def with_untold(gaps: tuple[Gap, ...], evidence: Evidence) -> tuple[Gap, ...]:
    """Gaps of a look at whose end no ink comes, with what isn't told behind the last of it."""
    behind = () if evidence.told is None else evidence.told.tail
    out = list(gaps)
    for one in (*behind, *unchanged(evidence)):
        if one.length_mm >= _TAIL_MM and not any(one.meets(other) for other in out):
            out.append(one)
    return tuple(out)


# Say why missing ink is asked about: the layer's place may explain it, or more of it is unseen.

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
