"""Layout helpers of the Printer page: cards, dialogs, buttons, number inputs, notes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from html import escape
from typing import Any, Final

from nicegui import run, ui

from firmware_profiles import ProfileError
from printctl.failures import message_and_code
from printctl.machine.station import StationState, StationStatus

Refresh = Callable[[StationStatus], None]
"""Shows a status in a card."""

IN_WORDS: Final = {
    StationState.CONNECTING: "connecting: opening the port, asking who is there",
    StationState.READY: "ready: connected, checked, standing by",
    StationState.BUSY: "busy: doing what it was asked to",
    StationState.PRINTING: "printing: see the Job page; by hand only what a print allows",
    StationState.HALTING: "halting: a halt was sent, the printer hasn't confirmed it yet",
    StationState.HALTED: "halted: the firmware stopped itself or was stopped; reset it, reconnect",
    StationState.LOST: "lost: the port went away or nothing answers; check the cable, reconnect",
    StationState.CLOSED: "not connected",
}


@contextmanager
def card(title: str) -> Iterator[None]:
    """A card with a title, a region of its own for those who hear the page."""
    with ui.card().classes("w-full p-4 gap-3").props(f'role=region aria-label="{escape(title)}"'):
        heading(title)
        yield


@contextmanager
def dialog(title: str, wide: bool = False, beside: bool = False) -> Iterator[ui.dialog]:
    """A dialog with a title, by which it is also announced.

    One that is to stand ``beside`` the page leaves the page in reach: the tip must be moved.
    """
    seamless = " seamless position=bottom" if beside else ""
    with (
        ui.dialog().props(f'aria-label="{escape(title)}"{seamless}') as made,
        ui.card().classes("w-full gap-3" + (" max-w-3xl" if wide else "")),
    ):
        subheading(title)
        yield made


def heading(title: str) -> None:
    """A card's title."""
    ui.html(escape(title), tag="h2", sanitize=False).classes("text-lg font-semibold m-0")


def subheading(title: str) -> None:
    """A title inside a card or dialog."""
    ui.html(escape(title), tag="h3", sanitize=False).classes("text-base font-semibold m-0")


def button(text: str, work: Callable[..., Any], **values: Any) -> ui.button:
    """A button for gloves."""
    return ui.button(text, on_click=work, **values).props("no-caps").classes("min-h-[48px]")


def quiet_button(text: str, work: Callable[..., Any]) -> ui.button:
    """The same, for what isn't the first thing to do."""
    made = ui.button(text, on_click=work, color=None).props("no-caps outline")
    return made.classes("min-h-[48px]")


def note(text: str = "") -> ui.label:
    """A line of small print."""
    return ui.label(text).classes("text-sm pc-muted")


def live(text: str = "") -> ui.label:
    """A line that is read out when it changes."""
    return ui.label(text).props("role=status aria-live=polite").classes("text-sm")


def number(
    label: str, value: float | None, low: float, high: float, step: float, suffix: str
) -> ui.number:
    """A number with its unit and its limits."""
    made = ui.number(label, value=value, min=low, max=high, step=step, suffix=suffix)
    return made.classes("pc-number").props("outlined")


async def run_or_explain(work: Callable[..., Any], *args: Any) -> str:
    """Do it in a thread; give what was refused in words, to be shown where the hand is."""
    try:
        await run.io_bound(work, *args)
    except Exception as exc:
        known = message_and_code(exc)
        if known is None and not isinstance(exc, ProfileError):
            raise
        return f"Refused: {known[0] if known else exc}"
    return ""


def mm(value: float | None) -> str:
    """A place as it is shown."""
    return "–" if value is None else f"{value:.2f}"
