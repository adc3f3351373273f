"""Change wizards of the Printer page: new syringe, new needle."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui

from firmware_profiles import Ink, Needle, Syringe
from printctl.machine.station import StationState, StationStatus
from printctl.web.controls import Principal
from printctl.web.printer import part_change as c
from printctl.web.printer.layout import (
    Refresh,
    button,
    card,
    dialog,
    live,
    note,
    number,
    quiet_button,
)
from printctl.web.printer.service import PrinterService
from printctl.web.shell.run_or_notify import run_or_notify


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
