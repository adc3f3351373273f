"""Text of an inspection's findings, proposal and outcome, for command line, page and report."""

from __future__ import annotations

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
