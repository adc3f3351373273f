"""Homing dialog of the Printer page: confirm that the needle is taken off, then home axes."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui

from printctl.web.controls import Principal
from printctl.web.printer.layout import button, dialog, live, note, quiet_button
from printctl.web.printer.service import PrinterService
from printctl.web.shell.run_or_notify import run_or_notify

_RULE = (
    "Homing drives an axis to its switch, through whatever is in the way. With a needle above a "
    "dish it is refused: raise Z and take the needle off first. X and Y home at the height where "
    "the tip is now."
)


def home_dialog(service: PrinterService, who: Principal) -> Callable[[], None]:
    """Make the dialog; give what opens it."""
    with dialog("Home") as opened:
        note(_RULE)
        axes = {axis: ui.checkbox(f"{axis.upper()} axis", value=True) for axis in "xyz"}
        off = ui.checkbox("The needle is taken off")
        going = live()
        with ui.row().classes("gap-2"):
            button("Home these axes", lambda: home())
            quiet_button("Close", opened.close)

    async def home() -> None:
        chosen = [axis for axis, box in axes.items() if box.value]
        if not chosen:
            going.set_text("choose an axis")
            return
        going.set_text("homing …")
        done = await run_or_notify(service.hands.home, who, chosen, needle_off=bool(off.value))
        going.set_text("")
        if done is not None:
            opened.close()

    def show() -> None:
        off.set_value(False)
        going.set_text("")
        opened.open()

    return show
