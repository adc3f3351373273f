"""Dialog of the Printer page that declares the tip's position to the printer."""

from __future__ import annotations

from collections.abc import Callable

from printctl.web.controls import Principal
from printctl.web.printer.layout import button, dialog, note, number, quiet_button
from printctl.web.printer.service import PrinterService
from printctl.web.shell.run_or_notify import run_or_notify

_RULE = (
    "Nothing moves. The printer calls the place where its tip stands now by these numbers, and "
    "trusts them: measure, don't guess. What was touched off moves along. Needed after a needle "
    "was put on, for no axis homes with one above a dish."
)


def place_dialog(service: PrinterService, who: Principal) -> Callable[[], None]:
    """Make the dialog; give what opens it."""
    with dialog("Where the tip is") as opened:
        note(_RULE)
        fields = [number(axis, None, -1000, 1000, 0.01, "mm") for axis in "XYZ"]
        button("The tip stands there", lambda: say())
        quiet_button("Cancel", opened.close)

    async def say() -> None:
        x, y, z = (None if field.value is None else float(field.value) for field in fields)
        if await run_or_notify(service.hands.set_position, who, x, y, z) is not None:
            opened.close()

    def show() -> None:
        place = service.status.position_mm or (None, None, None)
        for field, value in zip(fields, place, strict=True):
            field.set_value(None if value is None else round(value, 3))
        opened.open()

    return show
