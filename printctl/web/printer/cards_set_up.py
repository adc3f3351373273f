"""Cards of connection, mounted parts, changing a part, touching off."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui import run, ui

from firmware_profiles import Bath, Dish, Facts, Ink, Needle, Printer, Syringe
from printctl.machine.station import StationState, StationStatus
from printctl.web.controls import Principal
from printctl.web.printer import part_change as c
from printctl.web.printer import part_change as t
from printctl.web.printer.layout import (
    IN_WORDS,
    Refresh,
    button,
    card,
    dialog,
    live,
    mm,
    note,
    number,
    quiet_button,
)
from printctl.web.printer.ports import SIMULATED, FoundPort, summary, unmeasured
from printctl.web.printer.service import PrinterService
from printctl.web.shell.frame import run_or_notify

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


# Mounted-parts card of the Printer page: declare needle, syringe, ink, dish and bath.

SORTS: dict[str, type[Facts]] = {
    "needle": Needle,
    "syringe": Syringe,
    "ink": Ink,
    "dish": Dish,
    "bath": Bath,
}


def add_mounted(service: PrinterService, who: Principal) -> Refresh:
    """What was said, and a dialog to say something else."""
    shown: dict[str, ui.label] = {}
    with card("What is mounted"):
        note("The soft limits, µL and temperatures go by this; nobody can check it but you.")
        with ui.element("dl").classes("pc-facts"):
            for sort in (*SORTS, "dish's middle"):
                with ui.element("dt"):
                    ui.label(sort.capitalize())
                with ui.element("dd"):
                    shown[sort] = ui.label("–")
        show = _dialog(service, who)
        change = quiet_button("Say what is mounted …", show)

    def refresh(status: StationStatus) -> None:
        change.set_enabled(status.open)
        for sort in SORTS:
            given = str(getattr(status.mounted, sort))
            shown[sort].set_text(service.store.name(given) if given else "not said")
        centre = status.mounted.dish_centre_mm
        shown["dish's middle"].set_text(
            "not said" if centre is None else f"X {mm(centre[0])}, Y {mm(centre[1])} mm"
        )

    return refresh


def _dialog(service: PrinterService, who: Principal) -> Any:
    choices: dict[str, ui.select] = {}
    with dialog("What is mounted") as opened:
        for sort, model in SORTS.items():
            names = {
                "": "nothing, or not known",
                **{n: n for n in service.store.names(model)},
            }
            choice = ui.select(names, label=sort.capitalize(), value="").classes("w-full")
            choices[sort] = choice
        with ui.row().classes("gap-2 items-center"):
            x = number("Dish's middle X", None, -1000, 1000, 0.1, "mm")
            y = number("Dish's middle Y", None, -1000, 1000, 0.1, "mm")
            quiet_button("Where the tip is", lambda: here())
        with ui.row().classes("gap-2"):
            button("That is mounted", lambda: say())
            quiet_button("Cancel", opened.close)

    def here() -> None:
        place = service.status.position_mm
        if place is not None:
            x.set_value(place[0])
            y.set_value(place[1])

    def said() -> dict[str, Any]:
        fields: dict[str, Any] = {}
        for sort, model in SORTS.items():
            name = str(choices[sort].value)
            fields[sort] = service.store.given(model, name) if name else ""
        if x.value is not None and y.value is not None:
            fields["dish_centre_mm"] = (float(x.value), float(y.value))
        now = service.status.mounted
        return {key: value for key, value in fields.items() if value != getattr(now, key)}

    async def say() -> None:
        if await run_or_notify(lambda: service.hands.mount(who, **said())) is not None:
            opened.close()

    def show() -> None:
        mounted = service.status.mounted
        for sort, choice in choices.items():
            given = str(getattr(mounted, sort))
            choice.set_value(service.store.name(given) if given else "")
        if mounted.dish_centre_mm is not None:
            x.set_value(mounted.dish_centre_mm[0])
            y.set_value(mounted.dish_centre_mm[1])
        opened.open()

    return show


# Change wizards of the Printer page: new syringe, new needle.


def add_changing(service: PrinterService, who: Principal) -> Refresh:
    """Two buttons, each with a wizard behind it."""
    with card("Change of needle or syringe"):
        note("Step by step, between prints. In a print's pause the Job page asks for a syringe.")
        syringe, needle = _syringe(service, who), _needle(service, who)
        with ui.row().classes("gap-2"):
            opens = [button("Change the syringe …", syringe), button("Change the needle …", needle)]

    def refresh(status: StationStatus) -> None:
        for one in opens:
            one.set_enabled(status.state is StationState.READY)

    return refresh


def _raise_step(service: PrinterService, who: Principal, stepper: ui.stepper) -> None:
    with ui.step("Raise the needle").props("done-color=positive"):
        note("Straight up, out of the bath and above the rim of the dish.")
        place_line = live()

        async def lift() -> None:
            status = await run_or_notify(service.hands.lift_out, who)
            if status is not None and status.position_mm is not None:
                place_line.set_text(f"the tip is at Z {status.position_mm[2]:.2f} mm")

        with ui.row().classes("gap-2"):
            button("Raise", lift)
            quiet_button("It is up: next", stepper.next)


def _syringe(service: PrinterService, who: Principal) -> Callable[[], None]:
    store = service.store
    with dialog("Change of syringe") as opened:
        with ui.stepper().props("vertical flat header-nav=false").classes("w-full p-0") as stepper:
            _raise_step(service, who, stepper)
            with ui.step("Put the syringe in"):
                names = store.names(Syringe)
                syringe = ui.select(names, label="Syringe", value=names[0]).classes("w-full")
                inks = {"": "not named", **{n: n for n in store.names(Ink)}}
                ink = ui.select(inks, label="Ink", value="").classes("w-full")
                filled = number("Filled with", 1000.0, 0.1, 100_000, 10, "µL")
                note("Bring the plunger drive down until it touches the syringe's plunger.")

                async def put_in() -> None:
                    given = (str(syringe.value), str(ink.value), float(filled.value or 0))
                    if await run_or_notify(service.changing.syringe, who, *given) is not None:
                        stepper.next()

                button("It is in, the plunger touched: zero", put_in)
            with ui.step("Push the bubbles out"):
                note(
                    f"Until ink without bubbles comes: {c.PURGE_STEP_UL:g} µL at a time, slowly, "
                    f"{c.PURGE_UL:g} µL in all."
                )
                pushed = live()

                async def purge(ul: float) -> None:
                    await run_or_notify(service.changing.purge, who, ul)
                    pushed.set_text(f"{service.changing.purged_ul:g} µL pushed out")

                with ui.row().classes("gap-2"):
                    button("Push 1 µL", lambda: purge(1.0))
                    button("Push 5 µL", lambda: purge(5.0))
                    quiet_button("It comes clean: next", stepper.next)
            with ui.step("Wipe the needle"):
                note("With a lint-free swab, downwards: its drop would go into the bath.")
                wiped = ui.checkbox("Wiped")
                done = button("Done", opened.close)
                done.bind_enabled_from(wiped, "value")
        quiet_button("Close", opened.close)

    def show() -> None:
        mounted = service.status.mounted
        if mounted.syringe:
            syringe.set_value(store.name(mounted.syringe))
        ink.set_value(store.name(mounted.ink) if mounted.ink else "")
        filled.set_value(store.load(Syringe, str(syringe.value)).volume_ul)
        pushed.set_text("")
        wiped.set_value(False)
        stepper.set_value("Raise the needle")
        opened.open()

    return show


def _needle(service: PrinterService, who: Principal) -> Callable[[], None]:
    store = service.store
    with dialog("Change of needle") as opened:
        with ui.stepper().props("vertical flat").classes("w-full p-0") as stepper:
            _raise_step(service, who, stepper)
            with ui.step("Put the needle in"):
                names = store.names(Needle)
                needle = ui.select(names, label="Needle", value=names[0]).classes("w-full")
                note("Tighten it: one that turns later stands elsewhere.")

                async def put_in() -> None:
                    if (
                        await run_or_notify(service.changing.needle, who, str(needle.value))
                        is not None
                    ):
                        stepper.next()

                button("It is in and tight", put_in)
            with ui.step("Touch off"):
                note(
                    "The floor's and the bath's height are forgotten: this needle's tip stands "
                    "elsewhere. Touch off the floor before the next print (card Needle offset and "
                    "bath level)."
                )
                button("To the touch-off", opened.close)
        quiet_button("Close", opened.close)

    def show() -> None:
        mounted = service.status.mounted
        if mounted.needle:
            needle.set_value(store.name(mounted.needle))
        stepper.set_value("Raise the needle")
        opened.open()

    return show


# Touch-off card of the Printer page: find the dish's floor and the bath's surface.

_HOW = {
    "floor": "Bring the tip down until the foil just begins to drag under it (without foil: until "
    "it just touches), then take the reading; go up, and do it again.",
    "bath": "Bring the tip down until it just dimples the bath's surface, then take the reading; "
    "go up, and do it again.",
}


def add_touching(service: PrinterService, who: Principal) -> Refresh:
    """Start, small steps, readings, and the height that they agree on."""
    guide = service.guide
    with card("Needle offset and bath level"):
        stands = live()
        with ui.column().classes("w-full gap-3") as before:
            note(
                "Tells the printer where the dish's floor is for the needle mounted, and how high "
                "the bath stands: three readings within 0.05 mm each."
            )
            foil = number("Foil under the tip", 0.0, 0, t.THICKEST_FOIL_MM, 0.01, "mm")
            with ui.row().classes("gap-2"):
                button("Touch off the floor", lambda: start("floor"))
                quiet_button("Find the bath's surface", lambda: start("bath"))
        with ui.column().classes("w-full gap-3") as during:
            how = note()
            with ui.element("div").classes("grid grid-cols-2 gap-2 w-full"):
                for step in t.STEPS_MM:
                    button(f"Down {step:g} mm", lambda step=step: jog(-step))
                    quiet_button(f"Up {step:g} mm", lambda step=step: jog(step))
            with ui.row().classes("gap-2"):
                button("Touched: take this reading", lambda: run_or_notify(guide.read, who))
                quiet_button(f"Up {t.LIFT_MM:g} mm", lambda: jog(t.LIFT_MM))
            readings, verdict = note(), live()
            with ui.row().classes("gap-2"):
                use = button("Use this height", lambda: run_or_notify(guide.use, who))
                quiet_button("Give up", lambda: run_or_notify(guide.give_up, who))

    async def start(surface: t.Surface) -> None:
        await run_or_notify(guide.start, who, surface, float(foil.value or 0))

    async def jog(mm: float) -> None:
        await run_or_notify(service.hands.jog, who, "z", mm)

    def refresh(status: StationStatus) -> None:
        now = guide.touching
        stands.set_text(_stands(status))
        before.set_visibility(now is None and status.state is StationState.READY)
        during.set_visibility(now is not None)
        if now is None:
            return
        how.set_text(_HOW[now.surface])
        listed = ", ".join(f"{z:.2f}" for z in now.readings_mm)
        readings.set_text(f"Readings: {listed} mm" if listed else "Readings: none yet")
        verdict.set_text(now.said())
        use.set_enabled(now.agrees)

    return refresh


def _stands(status: StationStatus) -> str:
    mounted = status.mounted
    if not mounted.needle:
        return "No needle is named; say first what is mounted."
    if status.mounted.touch_off_due:
        return f"Needle {_short(mounted.needle)}: to be touched off before the next print."
    floor = "not touched off" if mounted.floor_mm is None else f"Z {mounted.floor_mm:.2f} mm"
    level = "not known" if mounted.bath_level_mm is None else f"Z {mounted.bath_level_mm:.2f} mm"
    return f"Needle {_short(mounted.needle)}: floor {floor}, bath {level}."


def _short(given: str) -> str:
    return given.rsplit("/", 1)[-1].removesuffix(".yaml")
