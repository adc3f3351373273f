"""Text of an inspection's findings, proposal and outcome, for command line, page and report."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Final

from printctl.observe.records import Answer, LookRecord

DECIDED: Final = {
    "go_on": "gone on",
    "flow": "flow corrected",
    "mend": "mended",
    "pause": "paused",
    "stop": "stopped",
}
"""What was done after a look, by its decision."""
ASKED: Final = {
    "mend": "write again what is missing",
    "flow": "correct the flow of all that follows",
    "pause": "wait",
}
"""What the operator is asked to approve."""

_LEAST_SEEN: Final = 0.5
"""Of the way, for a look to tell something of it."""


def seen_words(look: LookRecord) -> str:
    """How much of the written way was seen, and how much ink there; empty where nothing was."""
    seen, ink = look.found.get("seen_share"), look.found.get("coverage")
    if seen is None:
        return ""
    return f"{seen:.0%} seen" + ("" if ink is None else f", {ink:.0%} of it with ink")


def proposal_words(look: LookRecord) -> str:
    """What is proposed to the operator; empty where a look asks for nothing."""
    if not look.asked:
        return ""
    words = ASKED[look.asked]
    if look.factor is None:
        return words
    return f"{words}, flow factor {look.factor:.2f}"


def outcome_words(look: LookRecord, answer: Answer | None) -> str:
    """What came of a look: its decision, or the operator's word where it asked for one."""
    if not look.asked:
        return DECIDED.get(look.decision, look.decision)
    if answer is None:
        return f"asks to {ASKED[look.asked]}"
    if answer == "approve":
        return f"{DECIDED.get(look.asked, look.asked)}, approved"
    return "gone on without" if answer == "go_on" else "stopped by the operator"


def total_words(looks: Sequence[LookRecord]) -> str:
    """What came of all looks at a print: how many did what, what is left, and what wasn't seen."""
    count = Counter(DECIDED.get(one.decision, one.decision) for one in looks)
    said = ", ".join(f"{number} {what}" for what, number in count.items())
    words = f"{len(looks)} look{'s' * (len(looks) != 1)}: {said}"
    if left_mm := math.fsum(one.found.get("left_mm", 0.0) for one in looks):
        words += f"; {left_mm:.2f} mm of gaps left as they are"
    seen = [one.found.get("seen_share") or 0.0 for one in looks]
    if dark := sum(share < _LEAST_SEEN for share in seen):
        words += f"; of {dark} less than {_LEAST_SEEN:.0%} was seen"
    return words
