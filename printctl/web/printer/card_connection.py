"""Connection card of the Printer page: connect and disconnect a printer."""

from __future__ import annotations

from nicegui import run, ui

from firmware_profiles import Printer
from printctl.machine.station import StationState, StationStatus
from printctl.web.controls import Principal
from printctl.web.printer.layout import IN_WORDS, Refresh, button, card, live, note, quiet_button
from printctl.web.printer.ports import SIMULATED, FoundPort, summary, unmeasured
from printctl.web.printer.service import PrinterService
from printctl.web.shell.run_or_notify import run_or_notify

_BAUDS = {"": "the profile's", "auto": "auto: try each"}
PLAIN = "generic_marlin"
_AGAIN = (StationState.HALTED, StationState.LOST)


def add_connection(service: PrinterService, who: Principal) -> Refresh:
    """Ports, profile, connect, and how the connection stands."""
    with card("Connection"):
        state = live().classes("font-medium")
        detail = note()
        with ui.column().classes("w-full gap-3") as choices:
            names = service.store.printers()
            profile = ui.select(names, label="Printer profile", value=_first(names))
            about, doubt = note(), note()
            with ui.row().classes("w-full items-center no-wrap gap-2"):
                port = ui.select(_ports([]), label="Port", value=SIMULATED).classes("grow")
                look = quiet_button("Look again", lambda: find())
            baud = ui.select(_BAUDS, label="Baud rate", value="")
            for choice in (profile, baud):
                choice.classes("w-full")
        with ui.row().classes("gap-2"):
            go = button("Connect", lambda: connect())
            leave = quiet_button("Disconnect", lambda: run_or_notify(service.disconnect, who))
            again = button("Reconnect", lambda: run_or_notify(service.reconnect, who))

    async def find() -> None:
        ports = await run.io_bound(service.ports) or []
        port.set_options(_ports(ports))
        fitting = [one for one in ports if profile.value in one.profiles]
        if len(fitting) == 1:
            port.set_value(fitting[0].device)

    async def connect() -> None:
        go.disable()
        state.set_text("connecting; a board that resets takes some seconds")
        rate = int(baud.value) if str(baud.value).isdecimal() else baud.value or None
        await run_or_notify(service.connect, who, profile.value, port.value, rate)
        go.enable()

    def describe() -> None:
        printer = service.store.load(Printer, profile.value)
        about.set_text(summary(printer))
        doubt.set_text(unmeasured(printer))
        rates = {str(rate): f"{rate} Bd" for rate in (printer.baud, *printer.bauds)}
        baud.set_options({**_BAUDS, **rates}, value="")

    def refresh(status: StationStatus) -> None:
        state.set_text(IN_WORDS[status.state])
        detail.set_text(_detail(service, status))
        choices.set_visibility(not status.open)
        go.set_visibility(not status.open)
        leave.set_visibility(status.open)
        again.set_visibility(status.state in _AGAIN)

    look.tooltip("List this machine's serial ports; none is opened")
    profile.on_value_change(describe)
    describe()
    ui.timer(0.1, find, once=True)
    return refresh


def _first(names: list[str]) -> str:
    return PLAIN if PLAIN in names else names[0]


def _ports(ports: list[FoundPort]) -> dict[str, str]:
    listed = {
        SIMULATED: "Simulated printer",
        "auto": "auto: the one with the profile's USB id",
    }
    for one in ports:
        fits = f" · {', '.join(one.profiles)}" if one.profiles else " · no profile matches"
        usb = f" · {one.usb_id}" if one.usb_id else " · not USB"
        listed[one.device] = f"{one.device}{usb}{fits}"
    return listed


def _detail(service: PrinterService, status: StationStatus) -> str:
    parts = []
    if status.open:
        parts.append(f"{service.store.name(status.profile)} at {status.port}")
        parts.append(status.firmware)
    errors = service.core.events.latest.get("print", {}).get("line_errors")
    if status.state is StationState.PRINTING and errors is not None:
        parts.append(f"{errors} line errors, each sent again")
    return " · ".join(filter(None, [*parts, status.message]))
