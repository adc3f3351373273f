"""Format a print's state, time, layer, vessel and ink as text for page and command line."""

from __future__ import annotations

import time
from typing import Final

from printctl.machine.prints.progress import Progress
from printctl.machine.records.states import LinkState, Status


def alarm_words(count: int, last: str) -> str:
    """Return how many alarms there are and what the last one says."""
    if count == 1:
        return f"1 alarm: {last}"
    return f"{count} alarms, the last: {last}"


def progress_words(status: Status, done: Progress | None) -> str:
    """Return how much is made: a share of the time where that is known, else lines at least.

    Lines are no share: a header's cost nothing, and what the printer holds isn't made yet.
    """
    if done is None and status.lines_done and not status.lines_executed and status.ended:
        return (
            f"{status.lines_done} of {status.lines_total} lines acknowledged, how many of them "
            "were made isn't sure"
        )
    if done is None:
        return f"at least {status.lines_executed} of {status.lines_total} lines made"
    return f"{100 * done.share:.1f} % made"


def print_words(status: Status, done: Progress | None) -> dict[str, str]:
    """Return what is known of time, layer, vessel and ink; empty texts for what isn't."""
    if done is None:
        return dict.fromkeys(("time", "layer", "vessel", "ink"), "")
    verb = "was" if status.ended else "is"
    layers = "Pass" if done.passes else "Layer"
    return {
        "time": _time_words(status, done),
        "layer": _part(layers, done.layer, done.layers, done.layers_done, verb),
        "vessel": _part("Vessel", done.vessel, done.vessels, done.vessels_done, verb),
        "ink": _ink_words(done),
    }


_RAISED: Final = {
    LinkState.PAUSED: "raised from ",
    LinkState.LOOKING: "raised from ",
    LinkState.RESUMING: "raised from ",
    LinkState.STOPPING: "raised from about ",
    LinkState.STOPPED: "raised from about ",
    LinkState.FAILED: "raised from about ",
}
"""States in which the tip is above where the job has led it: about, where moves may be unmade."""


def tip_words(
    status: Status, done: Progress | None, stood_mm: tuple[float, float, float] | None
) -> str:
    """Return where the tip is; empty where that is unknown.

    ``stood_mm``, (x, y, z), is what the printer said where its moves were dropped: the end's
    place, not the executed line.
    """
    place = None if done is None else done.tip_mm
    if status.ended and stood_mm is not None:
        place = stood_mm
    if place is None or not status.position_known:
        return ""
    text = " ".join(f"{axis}{mm:.2f}" for axis, mm in zip("XYZ", place, strict=True))
    raised = _RAISED.get(status.state, "")
    return (raised.replace(" about", "") if stood_mm else raised) + text


def _time_words(status: Status, done: Progress) -> str:
    taken = f"Printing for {span(done.active_s)}"
    if status.ended:
        return f"{taken} (the dry run said {span(done.predicted_s)})"
    error = done.remaining_error_s
    about = " (by the dry run alone)" if error is None else f" ± {span(error)}"
    ends_at = time.strftime("%H:%M", time.localtime(done.ends_at))
    return f"{taken}, {span(done.remaining_s)} left{about}, ends at {ends_at}"


def _ink_words(done: Progress) -> str:
    text = f"Ink: {done.ink_ul:.2f} of {done.ink_total_ul:.2f} µL written"
    left = done.ink_left_ul
    return text if left is None else f"{text}, {left:.1f} µL left in the syringe"


def _part(name: str, now: int, count: int, whole: int, verb: str) -> str:
    if not count:
        return ""
    if whole == count:
        return f"{name}{'es' if name.endswith('s') else 's'}: all {count} whole"
    return f"{name} {now} of {count} {verb} being written, {whole} whole"


def span(seconds: float) -> str:
    """Return a time as it is shown: ``1 h 04 min``, ``3 min 20 s``."""
    whole = round(max(seconds, 0.0))
    hours, minutes, rest = whole // 3600, whole // 60 % 60, whole % 60
    if hours:
        return f"{hours} h {minutes:02d} min"
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"
