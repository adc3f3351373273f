"""Console card of the Printer page: typed commands, replies, refusals."""

from __future__ import annotations

import time
from typing import Final

from nicegui import events, ui

from printctl.machine.station import StationStatus
from printctl.web.controls import Principal
from printctl.web.printer.console import Entry
from printctl.web.printer.layout import Refresh, button, card, live, note, run_or_explain
from printctl.web.printer.service import PrinterService

SHOWN: Final = 100
_ON_KEY: Final = (
    "(e) => { if (['ArrowUp','ArrowDown','Enter'].includes(e.key)) "
    "{ e.preventDefault(); emit(e.key); } }"
)


def add_console(service: PrinterService, who: Principal) -> Refresh:
    """A log, and a line to type into."""
    recalled = _Recalled()
    shown = [0]
    with card("Console"):
        note(
            "What would break the link's count or position is refused; Arrow Up brings back what "
            "you typed."
        )
        log = (
            ui.element("div")
            .classes("pc-log")
            .props('role=log aria-label="Console: commands and replies" tabindex=0')
        )
        with ui.row().classes("w-full no-wrap items-center gap-2"):
            line = ui.input("Command", placeholder="M115").classes("grow")
            line.props('outlined autocomplete=off spellcheck=false input-class="font-mono"')
            send = button("Send", lambda: go())
        reply_line = live()

    async def go() -> None:
        text = str(line.value or "").strip()
        if not text:
            return
        recalled.add(text)
        line.set_value("")
        # What the console refuses stands in its log; the rest is said below the line.
        reply_line.set_text(await run_or_explain(service.console.send, who, text))

    async def key(event: events.GenericEventArguments) -> None:
        if event.args == "Enter":
            await go()
        else:
            line.set_value(recalled.step(-1 if event.args == "ArrowUp" else 1))

    line.on("keydown", key, js_handler=_ON_KEY)

    def refresh(status: StationStatus) -> None:
        send.set_enabled(status.open)
        fresh = service.console.entries(shown[0])[-SHOWN:]
        if not fresh:
            return
        with log:
            for entry in fresh:
                _show(entry)
        for old in list(log.default_slot.children)[:-SHOWN]:
            old.delete()
        shown[0] = fresh[-1].number
        ui.run_javascript(f"const l=getHtmlElement({log.id}); if (l) l.scrollTop=l.scrollHeight;")

    return refresh


class _Recalled:
    """What this browser typed, and where the arrows stand in it."""

    def __init__(self) -> None:
        self._lines: list[str] = []
        self._at = 0

    def add(self, text: str) -> None:
        """Remember a line."""
        if self._lines[-1:] != [text]:
            self._lines.append(text)
        self._at = len(self._lines)

    def step(self, by: int) -> str:
        """Go back or forward; empty past the last."""
        self._at = min(len(self._lines), max(0, self._at + by))
        return self._lines[self._at] if self._at < len(self._lines) else ""


def _show(entry: Entry) -> None:
    with ui.element("div"):
        at = time.strftime("%H:%M:%S", time.localtime(entry.at_s))
        ui.label(f"{at} {entry.who} > {entry.text}").classes("pc-typed")
        for reply in entry.replies:
            ui.label(reply)
        if entry.refused:
            ui.label(f"refused: {entry.refused}").classes("pc-refused")
