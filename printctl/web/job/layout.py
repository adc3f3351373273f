"""Layout helpers of the Job page: cards, buttons, live text; number, size and date formats."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from html import escape
from typing import Any

from nicegui import run, ui

from firmware_profiles import ProfileError
from printctl.failures import message_and_code


@contextmanager
def card(title: str, classes: str = "gap-3") -> Iterator[None]:
    """A card with a title, a region of its own for those who hear the page."""
    made = ui.card().classes(f"w-full p-4 {classes}")
    with made.props(f'role=region aria-label="{escape(title)}"'):
        ui.html(escape(title), tag="h2", sanitize=False)
        yield


class Folds:
    """Cards that fold away while a print goes on, so that its facts stand on the first screen."""

    def __init__(self) -> None:
        self._all: list[ui.element] = []
        self._folded = False

    @contextmanager
    def card(self, title: str) -> Iterator[None]:
        """A card whose title opens and closes it."""
        region = ui.card().classes("w-full p-4 job-fold")
        region.props(f'role=region aria-label="{escape(title)}"')
        with region, ui.element("details").props("open") as details:
            self._all.append(details)
            with ui.element("summary"):
                ui.html(escape(title), tag="h2", sanitize=False)
            with ui.element("div").classes("job-folded"):
                yield

    def set(self, folded: bool) -> None:
        """Close or open all of them when a print begins or ends; a user may do so in between."""
        if folded is self._folded:
            return
        self._folded = folded
        for one in self._all:
            one.props(remove="open") if folded else one.props("open")


def subheading(title: str) -> None:
    """A title inside a card."""
    ui.html(escape(title), tag="h3", sanitize=False).classes("text-base font-semibold m-0 pt-2")


def button(text: str, work: Callable[..., Any]) -> ui.button:
    """A button for gloves."""
    return ui.button(text, on_click=work).props("no-caps").classes("min-h-[48px]")


def quiet_button(text: str, work: Callable[..., Any]) -> ui.button:
    """The same, for what isn't the first thing to do."""
    made = ui.button(text, on_click=work, color=None).props("no-caps outline")
    return made.classes("min-h-[48px]")


def live(text: str = "") -> ui.label:
    """A line that is read out when it changes."""
    return ui.label(text).props("role=status aria-live=polite")


def small(text: str = "") -> ui.label:
    """A line of small print."""
    return ui.label(text).classes("text-sm job-quiet")


async def run_or_explain(work: Callable[..., Any], *args: Any, **values: Any) -> tuple[Any, str]:
    """Do it in a thread; give what came of it, or what was refused in words."""
    try:
        return await run.io_bound(lambda: work(*args, **values)), ""
    except Exception as exc:
        known = message_and_code(exc)
        if known is None and not isinstance(exc, ProfileError):
            raise
        return None, known[0] if known else str(exc)


def date_text(at: float) -> str:
    """Day and time as they are shown."""
    return time.strftime("%Y-%m-%d %H:%M", time.localtime(at))


def size(count: int) -> str:
    """A file's size as it is shown."""
    return f"{count / 1e6:.1f} MB" if count >= 1e6 else f"{count / 1e3:.1f} kB"


def number(value: float | None) -> str:
    """A check's number as it is shown."""
    return "–" if value is None else f"{value:.4g}"
