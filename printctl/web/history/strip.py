"""Timeline strip of a print's states on the History page, drawn to scale with a legend."""

from __future__ import annotations

from typing import Final

from nicegui import ui

from printctl.history.timeline import TimeLine
from printctl.web.history.wording import duration

COLOURS: Final = {
    "connecting": "#8a94a3",
    "checking": "#5c6675",
    "printing": "#2f7d4f",
    "pausing": "#c48a00",
    "paused": "#c48a00",
    "looking": "#7a5bb5",
    "resuming": "#5b8def",
    "stopping": "#b3261e",
}
_OTHER: Final = "#8a94a3"


def strip(line: TimeLine) -> None:
    """Draw it."""
    whole = sum(one.end_s - one.start_s for one in line.stretches)
    if whole <= 0:
        return
    sums: dict[str, float] = {}
    for one in line.stretches:
        sums[one.state] = sums.get(one.state, 0.0) + one.end_s - one.start_s
    times = ", ".join(f"{state} {duration(s) or '0 s'}" for state, s in sums.items())
    drawn = ui.element("div").classes("ph-strip").props("role=img")
    drawn.props["aria-label"] = f"Times in each state: {times}"
    with drawn:
        for one in line.stretches:
            share = (one.end_s - one.start_s) / whole
            colour = COLOURS.get(one.state, _OTHER)
            ui.element("div").style(f"flex:{share:.6f} 1 0;background:{colour}")
    with ui.element("div").classes("ph-row").style("margin:8px 0"):
        for state, seconds in sums.items():
            with ui.element("span").classes("ph-row").style("gap:6px"):
                mark = ui.element("span").classes("ph-mark")
                mark.style(f"background:{COLOURS.get(state, _OTHER)}")
                ui.label(f"{state} {duration(seconds) or '0 s'}")
