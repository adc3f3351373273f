"""The card of the print: what it does, how far it is, and what may be done to it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui import run, ui

from printctl.web.controls import Principal
from printctl.web.job.parts import button, card, live, quiet_button, small, tried
from printctl.web.job.print_words import ENDED_STATES, lines, state_words, told_of
from printctl.web.job.service import JobService
from printctl.web.shell.dialogs import dialog_named

_LINES = 5


class PrintCard:
    """State, bars and buttons of one job's print.

    Parameters
    ----------
    service : JobService
    who : Principal
    job : str
    """

    def __init__(self, service: JobService, who: Principal, job: str) -> None:
        self._service, self._who, self._job = service, who, job
        with card("Print"):
            self._state = live().classes("text-xl font-semibold").mark("print state")
            self._message = small()
            self._bar = ui.linear_progress(0.0, show_value=False, size="18px").props(
                'instant-feedback aria-label="Share of the print\'s time"'
            )
            self._lines = [ui.label().classes("tabular-nums") for _ in range(_LINES)]
            self._cells = ui.label().props("role=status").classes("job-warn")
            self._problem = live().classes("job-problem")
            self._add_buttons()
            self._add_syringe()
        self._ask = _sure(lambda: self._do(service.hands.cancel, job))
        ui.timer(10.0, self._clock_of_cells)

    def _add_buttons(self) -> None:
        hands, who, job = self._service.hands, self._who, self._job

        def pause(text: str, after: str, make: Callable[..., ui.button]) -> ui.button:
            return make(text, lambda: self._do(hands.pause, who, job, after))

        with ui.row().classes("gap-2") as self._row:
            self._pauses = [
                pause("Pause now", "now", button),
                pause("Pause after layer", "layer", quiet_button),
            ]
            self._vessel = pause("Pause after vessel", "vessel", quiet_button)
            self._resume = button("Resume", lambda: self._do(hands.resume, who, job))
            self._reload = quiet_button("Change syringe", lambda: self._do(hands.reload, who, job))
            self._here = quiet_button("I am here", lambda: self._do(hands.alive, who, job))
            self._cancel = quiet_button("Cancel print", lambda: self._ask.open())

    def _add_syringe(self) -> None:
        """What is asked after a change of syringe."""
        hands, who, job = self._service.hands, self._who, self._job
        with ui.column().classes("w-full gap-2") as self._syringe:
            ui.label("A syringe is being changed. What was put in?").classes("font-semibold")
            used = ui.number("Plunger travel used up", value=0.0, min=0, max=1000, suffix="mm")
            used.props("outlined")

            async def with_this() -> None:
                await self._do(hands.resume, who, job, plunger_mm=float(used.value or 0.0))

            with ui.row().classes("gap-2"):
                button("Resume with this syringe", with_this)
                quiet_button(
                    "Resume, syringe unchanged",
                    lambda: self._do(hands.resume, who, job, unchanged=True),
                )

    def show(self, told: dict[str, Any] | None) -> None:
        """Show what was heard of last; None where nothing was ever printed."""
        self._bar.set_visibility(told is not None)
        self._bar.set_value(round(float(told_of(told, "share") or 0.0), 3))
        self._state.set_text(state_words(told))
        self._message.set_text("" if told is None else str(told["message"]))
        for label, text in zip(self._lines, lines(told), strict=True):
            label.set_text(text)
            label.set_visibility(bool(text))
        self._offer(told)

    def _offer(self, told: dict[str, Any] | None) -> None:
        """Show the buttons of what can be done now."""
        now = "" if told is None else str(told["state"])
        wants = str(told["waits_for"]) if told else ""
        held, changing = now == "paused", now == "paused" and wants.startswith("syringe")
        goes_on = bool(now) and now not in ENDED_STATES
        self._row.set_visibility(goes_on)
        for one in self._pauses:
            one.set_visibility(now in ("printing", "connecting", "checking"))
        self._vessel.set_visibility(now == "printing" and bool(told_of(told, "vessels")))
        self._resume.set_visibility((held and not changing) or (now == "printing" and bool(wants)))
        self._resume.set_text("Resume" if held else "Don't pause after all")
        self._syringe.set_visibility(changing)
        self._reload.set_visibility(now in ("printing", "paused") and not changing)
        self._here.set_visibility(told is not None and told["deadman_left_s"] is not None)
        self._cancel.set_visibility(goes_on and now != "stopping")

    async def _do(self, work: Callable[..., Any], *args: Any, **values: Any) -> None:
        _, said = await tried(work, *args, **values)
        self._problem.set_text(said)

    async def _clock_of_cells(self) -> None:
        found, _ = await tried(self._service.viability, self._job)
        self._cells.set_text("" if found is None else found.words)
        self._cells.set_visibility(found is not None and found.minutes is not None)
        self._cells.classes(remove="job-late")
        if found is not None and found.state in ("late", "close"):
            self._cells.classes(add="job-late")


async def heard(service: JobService, job: str) -> dict[str, Any] | None:
    """The job's print as it was heard of last."""
    found = await run.io_bound(service.heard, job)
    return None if found is None else found.to_dict()


def _sure(work: Callable[[], Any]) -> ui.dialog:
    """Ask before a print is ended."""
    with dialog_named("Cancel the print?") as dialog, ui.card().classes("gap-3"):
        ui.label("Cancel the print?").classes("text-lg font-semibold")
        ui.label(
            "The move in flight ends, the plunger is relieved, the needle goes straight up. "
            "The print can't be gone on with."
        )

        async def yes() -> None:
            dialog.close()
            await work()

        with ui.row().classes("gap-2"):
            button("Yes, cancel it", yes)
            quiet_button("No, go on", dialog.close)
    return dialog
