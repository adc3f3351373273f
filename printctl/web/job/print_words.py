"""What is told of a print, in words."""

from __future__ import annotations

from typing import Any, Final

from printctl.link.states import ENDED
from printctl.web.job.parts import clock, span

ENDED_STATES: Final = {state.value for state in ENDED}


def told_of(told: dict[str, Any] | None, key: str) -> Any:
    """A value of the progress; None where it isn't known."""
    return told["progress"].get(key) if told and told.get("progress") else None


def state_words(told: dict[str, Any] | None) -> str:
    """State and share of the time."""
    if told is None:
        return "Not printed yet"
    words = str(told["state"]).replace("_", " ")
    share = told_of(told, "share")
    return words.capitalize() if share is None else f"{words.capitalize()} · {100 * share:.1f} %"


def lines(told: dict[str, Any] | None) -> tuple[str, str, str, str, str]:
    """Time, layer, vessel, ink and what is waited for, in words."""
    if told is None:
        return ("",) * 5
    done = told.get("progress")
    executed = f"{told['lines_executed']} of {told['lines_total']} commands executed"
    wants = f"Waits for: {told['waits_for']}" if told["waits_for"] else ""
    left = told["deadman_left_s"]
    if left is not None:
        wants = f"{wants}  Somebody must confirm within {span(left)}.".strip()
    if not done:
        return f"{executed}; time and layers aren't known yet", "", "", "", wants
    return (
        f"{_time(told, done)} · {executed}",
        _part("Pass" if done["passes"] else "Layer", done, "layer"),
        _part("Vessel", done, "vessel"),
        _ink(done),
        wants,
    )


def _time(told: dict[str, Any], done: dict[str, Any]) -> str:
    taken = f"Printing for {span(done['active_s'])}"
    if told["state"] in ENDED_STATES:
        return f"{taken} (the dry run said {span(done['predicted_s'])})"
    error = done["remaining_error_s"]
    about = " (by the dry run alone)" if error is None else f" ± {span(error)}"
    return f"{taken}, {span(done['remaining_s'])} left{about}, ends at {clock(done['ends_at'])}"


def _part(name: str, done: dict[str, Any], key: str) -> str:
    count = done[f"{key}s"]
    whole = done[f"{key}s_done"]
    if not count:
        return ""
    if whole == count:
        return f"{name}s: all {count} whole"
    return f"{name} {done[key]} of {count} is being written, {whole} whole"


def _ink(done: dict[str, Any]) -> str:
    text = f"Ink: {done['ink_ul']:.2f} of {done['ink_total_ul']:.2f} µL written"
    left = done["ink_left_ul"]
    return text if left is None else f"{text}, {left:.1f} µL left in the syringe"
