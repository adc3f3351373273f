"""Touch-off card of the Printer page: find the dish's floor and the bath's surface."""

from __future__ import annotations

from nicegui import ui

from printctl.machine.station import StationState, StationStatus
from printctl.web.controls import Principal
from printctl.web.printer import touch_off as t
from printctl.web.printer.layout import Refresh, button, card, live, note, number, quiet_button
from printctl.web.printer.service import PrinterService
from printctl.web.shell.run_or_notify import run_or_notify

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
