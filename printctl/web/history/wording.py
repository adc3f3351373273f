"""Texts of the History page: state names and formatted durations."""

from __future__ import annotations

from typing import Final

STATES: Final = {
    "done": "done",
    "stopped": "stopped",
    "failed": "failed",
    "killed": "killed",
    "position_unknown": "position unknown",
    "interrupted": "interrupted",
    "given_up": "given up",
    "running": "running",
}
SIGNS: Final = {"done": "✓", "running": "▶", "stopped": "■"}
"""Before a state's name; all others end badly."""

VERDICTS: Final = {
    "pass": "✓ Pass",
    "fail": "✕ Fail",
    "undecided": "? Undecided: neither pass nor fail is proven",
    "": "No verdict: no scan of this print was registered",
}


def state_words(state: str) -> str:
    """A state with its sign."""
    return f"{SIGNS.get(state, '✕')} {STATES.get(state, state)}"


def duration(seconds: float) -> str:
    """A time that something took."""
    if seconds <= 0:
        return ""
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {rest} s"
