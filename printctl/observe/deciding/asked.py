"""Find and say which stretches of a look are asked about besides its sure gaps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from printctl.observe.deciding.decision import Decision, DecisionKind
from printctl.observe.deciding.evidence import Evidence
from printctl.observe.deciding.layers_seen import where
from registration.inspection.findings import ASKED_MM
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
