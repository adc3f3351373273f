"""Print card of the Job page: state, progress and commands of the running print."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from nicegui import run, ui

from printctl.machine.printing.print_words import span
from printctl.web.controls import Principal
from printctl.web.job.layout import button, card, live, quiet_button, run_or_explain, small
from printctl.web.job.print_facts import FACTS, facts
from printctl.web.job.print_unfinished import UnfinishedPane
from printctl.web.job.service import JobService
from printctl.web.shell.dialogs import dialog_named

_RESUME: Final = {"paused": "Resume", "looking": "Go on without the observer"}


class PrintCard:
    """State, facts and buttons of one job's print.

    Parameters
    ----------
    service : JobService
    who : Principal
    job : str
    """

    def __init__(self, service: JobService, who: Principal, job: str) -> None:
        self._service, self._who, self._job = service, who, job
        with card("Print", "job-print"):
            small(job.partition("~")[2]).classes("break-all")
            self._state = live().classes("text-xl font-semibold").mark("print state")
            self._bar = ui.linear_progress(0.0, show_value=False, size="12px").props(
                'instant-feedback aria-label="Share of the print made"'
            )
            self._message = small()
            self._waits = live().classes("job-warn")
            self._cells = ui.label().props("role=status").classes("job-warn")
            self._problem = live().classes("job-problem")
            self._add_buttons()
            self._unfinished = UnfinishedPane(service, who, job, self._do)
            self._add_syringe()
            self._add_facts()
        self._ask = _sure(lambda: self._do(service.hands.cancel, job))
        ui.timer(10.0, self._clock_of_cells)

    def _add_facts(self) -> None:
        """Time left, layer, ink, temperatures, tip and alarms, each where it is always found."""
        self._facts: dict[str, ui.label] = {}
        with ui.element("dl").classes("job-facts") as self._list:
            for key, name in FACTS.items():
                with ui.element("div").classes("job-fact"):
                    with ui.element("dt").classes("job-quiet"):
                        ui.label(name)
                    with ui.element("dd"):
                        self._facts[key] = ui.label().classes("tabular-nums").mark(f"fact {key}")

    def _add_buttons(self) -> None:
        hands, who, job = self._service.hands, self._who, self._job

        def pause(text: str, after: str, make: Callable[..., ui.button]) -> ui.button:
            return make(text, lambda: self._do(hands.pause, who, job, after))

        with ui.row().classes("gap-2 job-actions") as self._row:
            self._pauses = [pause("Pause now", "now", button)]
            self._resume = button("Resume", lambda: self._do(hands.resume, who, job))
            self._cancel = quiet_button("Cancel print", self.ask_cancel)
            self._pauses.append(pause("Pause after layer", "layer", quiet_button))
            self._vessel = pause("Pause after vessel", "vessel", quiet_button)
            self._reload = quiet_button("Change syringe", lambda: self._do(hands.reload, who, job))
            self._here = quiet_button("I am here", lambda: self._do(hands.alive, who, job))

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

    def show(self, state: dict[str, Any] | None, station: dict[str, Any] | None = None) -> None:
        """Show what was heard of last.

        Parameters
        ----------
        state : dict or None
            The print (`PrintReport.to_dict`); None where nothing was ever printed.
        station : dict or None
            The printer between prints, which tells temperatures.
        """
        for part in (self._bar, self._list, self._message):
            part.set_visibility(state is not None)
        self._state.set_text("Not printed yet" if state is None else state["words"]["state"])
        self._waits.set_text(_waits(state))
        self._waits.set_visibility(bool(_waits(state)))
        if state is not None:
            self._bar.set_value(round(float(state["share"]), 3))
            self._message.set_text(_sentence(str(state["message"])))
            for key, text in facts(state, station).items():
                self._facts[key].set_text(text)
        self._offer(state)
        self._unfinished.show(state)

    def _offer(self, state: dict[str, Any] | None) -> None:
        """Show the buttons of what can be done now."""
        for part in (self._row, self._syringe):
            part.set_visibility(False)
        if state is None or state["ended"]:
            return
        can = {one["action"]: one for one in state["actions"]}
        now, resume = str(state["state"]), can["resume"]
        changing = resume["possible"] and resume["needs"] == "syringe"
        self._row.set_visibility(True)
        for one in self._pauses:
            one.set_visibility(can["pause"]["possible"])
        self._vessel.set_visibility(now == "printing" and bool(state["words"]["vessel"]))
        self._resume.set_visibility(resume["possible"] and not changing)
        self._resume.set_text(_RESUME.get(now, "Don't pause after all"))
        self._syringe.set_visibility(changing)
        self._reload.set_visibility(now in ("printing", "paused", "looking") and not changing)
        self._here.set_visibility(state["deadman_left_s"] is not None)
        self._cancel.set_visibility(can["stop"]["possible"])

    def ask_cancel(self) -> None:
        """Ask whether the print is to be ended."""
        self._ask.open()

    async def _do(self, work: Callable[..., Any], *args: Any, **values: Any) -> Any:
        result, problem = await run_or_explain(work, *args, **values)
        self._problem.set_text(problem)
        return result

    async def _clock_of_cells(self) -> None:
        cells, _ = await run_or_explain(self._service.viability, self._job)
        self._cells.set_text("" if cells is None else cells.words)
        self._cells.set_visibility(cells is not None and cells.minutes is not None)
        self._cells.classes(remove="job-late")
        if cells is not None and cells.state in ("late", "close"):
            self._cells.classes(add="job-late")


async def last_report(service: JobService, job: str) -> dict[str, Any] | None:
    """The job's print as it was heard of last."""
    report = await run.io_bound(service.heard, job)
    return None if report is None else report.to_dict()


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]


def _waits(state: dict[str, Any] | None) -> str:
    """What a print waits for, and within what time somebody must confirm."""
    if state is None:
        return ""
    wants = f"Waits for: {state['waits_for']}." if state["waits_for"] else ""
    left = state["deadman_left_s"]
    if left is not None:
        wants = f"{wants} Somebody must confirm within {span(left)}."
    return wants.strip()


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
