"""Layout helpers of the History page: cards, headings, tables, download buttons."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from nicegui import ui

# Texts of the History page: state names and formatted durations.

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


STYLE = Path(__file__).with_name("history.css")


@contextmanager
def card(title: str, wide: bool = False) -> Iterator[None]:
    """A part of the page under a heading of its own."""
    made = ui.element("section").classes("ph-card" + (" ph-wide" if wide else ""))
    made.props["aria-label"] = title
    with made:
        heading(title)
        yield


def heading(words: str) -> None:
    """A heading of plain text."""
    with ui.element("h2").classes("ph-name"):
        plain_text(words)


def plain_text(words: str) -> None:
    """Text, whatever stands in it."""
    ui.label(words).style("display:inline")


def facts(rows: Sequence[tuple[str, str]]) -> None:
    """Names and values, those without a value left out."""
    with ui.element("dl").classes("ph-facts"):
        for name, value in rows:
            if value:
                with ui.element("dt"):
                    ui.label(name)
                with ui.element("dd"):
                    ui.label(value)


def cell(words: str, name: str = "", classes: str = "") -> None:
    """A cell of a table; ``name`` stands before it where the table has no head for want of room."""
    made = ui.element("td").classes(classes)
    if name:
        made.props["data-name"] = name
    with made:
        ui.label(words).style("display:inline")


def head(names: Sequence[str]) -> None:
    """A table's head."""
    with ui.element("thead"), ui.element("tr"):
        for name in names:
            with ui.element("th").props("scope=col"):
                ui.label(name)


def download(words: str, way: str) -> ui.element:
    """A button that fetches a file from the API."""
    made = ui.button(words).props("outline no-caps").style("min-height:44px")
    made.props["href"] = way
    made.props["download"] = ""
    return made
