"""Small parts of the job's page, and numbers as it shows them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from html import escape
from typing import Any

from nicegui import run, ui

from firmware_profiles import ProfileError
from printctl.cli.failures import message_and_code


@contextmanager
def card(title: str) -> Iterator[None]:
    """A card with a title, a region of its own for those who hear the page."""
    with ui.card().classes("w-full p-4 gap-3").props(f'role=region aria-label="{escape(title)}"'):
        ui.html(escape(title), tag="h2", sanitize=False)
        yield


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


async def tried(work: Callable[..., Any], *args: Any, **values: Any) -> tuple[Any, str]:
    """Do it in a thread; give what came of it, or what was refused in words."""
    try:
        return await run.io_bound(lambda: work(*args, **values)), ""
    except Exception as exc:
        known = message_and_code(exc)
        if known is None and not isinstance(exc, ProfileError):
            raise
        return None, known[0] if known else str(exc)


def span(seconds: float | None) -> str:
    """A time as it is shown: ``1 h 04 min``, ``3 min 20 s``."""
    if seconds is None:
        return "–"
    whole = round(max(seconds, 0.0))
    hours, minutes, rest = whole // 3600, whole // 60 % 60, whole % 60
    if hours:
        return f"{hours} h {minutes:02d} min"
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"


def clock(at: float) -> str:
    """A wall-clock time as it is shown, of the server's place."""
    return time.strftime("%H:%M", time.localtime(at))


def when(at: float) -> str:
    """Day and time as they are shown."""
    return time.strftime("%Y-%m-%d %H:%M", time.localtime(at))


def size(count: int) -> str:
    """A file's size as it is shown."""
    return f"{count / 1e6:.1f} MB" if count >= 1e6 else f"{count / 1e3:.1f} kB"


def number(value: float | None) -> str:
    """A check's number as it is shown."""
    return "–" if value is None else f"{value:.4g}"
