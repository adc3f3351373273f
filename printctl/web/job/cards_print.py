"""Cards of a running print, and of one that wasn't finished; list of jobs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final
from urllib.parse import quote

from nicegui import events, run, ui

from printctl.machine.link.states import LinkState
from printctl.machine.printing.print_words import clock, span
from printctl.machine.station.status import OPEN
from printctl.web.controls import Principal
from printctl.web.job.jobs import ENDINGS, JobEntry
from printctl.web.job.layout import (
    Folds,
    button,
    card,
    date_text,
    live,
    quiet_button,
    run_or_explain,
    size,
    small,
)
from printctl.web.job.service import JobService
from printctl.web.shell.frame import add_unusable_names, dialog_named, upload


async def add_jobs(service: JobService, chosen: str, folds: Folds) -> None:
    """A list, each a link to its own page, and a place to drop a file."""
    with folds.card("Jobs"):
        problem_line = live().classes("job-problem")

        async def take(event: events.UploadEventArguments) -> None:
            entry, problem = await keep(service, event)
            problem_line.set_text(problem)
            if entry is not None:
                ui.navigate.to(way(entry.id))

        upload("Upload G-code", take, ",".join(ENDINGS), max_files=1)
        jobs = await run.io_bound(service.jobs) or []
        if not jobs:
            small("No job yet: upload a G-code file, or run a recipe on the page Design.")
        with ui.element("ul").classes("job-list"):
            for one in jobs:
                _row(one, chosen)
        await add_unusable_names(service.core.workspace, "jobs/*.gcode", "runs/*")


async def keep(
    service: JobService, event: events.UploadEventArguments
) -> tuple[JobEntry | None, str]:
    """Keep what a browser sent; never whole in memory."""
    with TemporaryDirectory(dir=service.core.workspace.private) as folder:
        came = Path(folder) / "upload"
        await event.file.save(came)

        def work() -> JobEntry:
            with came.open("rb") as handle:
                return service.upload(event.file.name, handle)

        return await run_or_explain(work)


def way(job: str) -> str:
    """The page of a job."""
    return f"/job?job={quote(job, safe='~')}"


def _row(one: JobEntry, chosen: str) -> None:
    with ui.element("li"):
        link = ui.link(target=way(one.id)).classes("job-row")
        if one.id == chosen:
            link.props('aria-current="true"')
        with link:
            ui.label(one.name).classes("font-semibold break-all")
            small(_facts(one))
            small(f"{date_text(one.changed)} · {size(one.size)} · SHA-256 {one.sha256[:12]}…")


def _facts(one: JobEntry) -> str:
    kind = "from a run" if one.id.startswith("run~") else "uploaded"
    known: list[Any] = [kind]
    if one.layers:
        known.append(f"{one.layers} layer{'s' if one.layers > 1 else ''}")
    if one.duration_s is not None:
        known.append(span(one.duration_s))
    if one.ink_ul is not None:
        known.append(f"{one.ink_ul:.1f} µL of ink")
    return " · ".join(known if len(known) > 1 else [*known, "not checked yet"])


# Recovery choices on the Job page for an interrupted print: resume, recover, give up.

Do = Callable[..., Any]
_GO_ON = (
    "Look first: the printer must have kept its power, and nobody may have moved the needle. The "
    "printer is asked for its last line; where that or its position doesn't agree, nothing moves."
)
_GIVE_UP = (
    "The end is written into the print's record. It can't be gone on with afterwards; the printer "
    "may be connected again. Nothing is sent to the printer."
)


class UnfinishedPane:
    """Buttons with a question each; two clicks lead to each of them.

    Parameters
    ----------
    service : JobService
    who : Principal
    job : str
    do : coroutine function
        Calls a function in a thread, and shows what it refuses.
    """

    def __init__(self, service: JobService, who: Principal, job: str, do: Do) -> None:
        self.service, self.who, self.job, self.do = service, who, job, do
        hands = service.hands
        goes = _question("Go on with the print?", _GO_ON, "Yes, go on", self._ask(hands.go_on))
        ends = _question(
            "Give the print up?", _GIVE_UP, "Yes, give it up", self._ask(hands.give_up)
        )
        self._rest = _Rest(self)
        with ui.column().classes("w-full gap-2") as self._box:
            with ui.row().classes("gap-2"):
                self._buttons = {
                    "go_on": button("Go on …", goes.open),
                    "recover": quiet_button("Recover …", self._rest.open),
                    "give_up": quiet_button("Give up …", ends.open),
                }
            self._why = small()

    def show(self, state: dict[str, Any] | None) -> None:
        """Show what is possible, and why the rest isn't."""
        can = {} if state is None else {one["action"]: one for one in state["actions"]}
        offered = [name for name in self._buttons if name in can and can[name]["possible"]]
        self._box.set_visibility(bool(offered) and state is not None and state["ended"])
        for name, made in self._buttons.items():
            made.set_visibility(name in offered)
        if offered:
            self._rest.needs_line = can["recover"]["needs"] == "from_line"
            self._rest.reason = can["recover"]["reason"]
            self._why.set_text("" if "go_on" in offered else f"No Go on: {can['go_on']['reason']}.")

    def _ask(self, work: Callable[..., Any]) -> Callable[[], Any]:
        return lambda: self.do(work, self.who, self.job)


class _Rest:
    """The question of a recovery: what to do by hand, where to begin."""

    def __init__(self, of: UnfinishedPane) -> None:
        self._of, self.needs_line, self.reason = of, False, ""
        with (
            dialog_named("Recover the rest of the print?") as self._dialog,
            ui.card().classes("gap-3 job-dialog"),
        ):
            ui.label("Recover the rest of the print?").classes("text-lg font-semibold")
            small("The rest becomes a job of its own, which is checked and started like any other.")
            self._steps = ui.element("ol").classes("job-steps")
            self._said = ui.label().classes("job-warn")
            self._line = ui.number("Line of the job's file to begin with", min=1, precision=0)
            self._line.props("outlined").classes("w-full")
            with ui.row().classes("gap-2"):
                button("Write the rest as a job", self._write)
                quiet_button("Not now", self._dialog.close)

    async def open(self) -> None:
        """Show what the plan says."""
        self._said.set_text(self.reason)
        self._said.set_visibility(bool(self.reason))
        self._steps.clear()
        if not self.needs_line:
            plan = await self._of.do(self._of.service.hands.recovery, self._of.job)
            with self._steps:
                for text in plan.steps if plan is not None else ():
                    with ui.element("li"):
                        ui.label(text)
        self._dialog.open()

    async def _write(self) -> None:
        line = int(self._line.value) if self._line.value else None
        of = self._of
        self._dialog.close()
        rest = await of.do(of.service.hands.recover, of.who, of.job, line)
        if rest is not None:
            ui.navigate.to(way(rest["job"]))


def _question(title: str, text: str, yes: str, work: Callable[[], Any]) -> ui.dialog:
    """A dialog that asks once more."""
    with dialog_named(title) as dialog, ui.card().classes("gap-3 job-dialog"):
        ui.label(title).classes("text-lg font-semibold")
        ui.label(text)

        async def go() -> None:
            dialog.close()
            await work()

        with ui.row().classes("gap-2"):
            button(yes, go)
            quiet_button("No", dialog.close)
    return dialog


# Facts of a print in words for the Job page: time left, layer, ink, temperatures, tip, alarms.

FACTS: Final = {
    "time": "Time left",
    "layer": "Layer",
    "ink": "Ink",
    "heat": "Temperatures",
    "tip": "Tip",
    "alarms": "Alarms",
}
"""Key and name of each, in the order shown."""
_UNKNOWN: Final = "not known"
_RAISED: Final = {
    LinkState.PAUSED: "raised from ",
    LinkState.LOOKING: "raised from ",
    LinkState.RESUMING: "raised from ",
    LinkState.STOPPING: "raised from about ",
    LinkState.STOPPED: "raised from about ",
    LinkState.FAILED: "raised from about ",
}
"""States in which the needle is no longer where the job's lines have brought it."""


def facts(state: dict[str, Any], station: dict[str, Any] | None) -> dict[str, str]:
    """Return each fact in words.

    Parameters
    ----------
    state : dict
        The print, as `PrintTruth.to_dict` gives it.
    station : dict or None
        The printer, as its station tells it.
    """
    done = state["progress"]
    return {
        "time": _time(state, done),
        "layer": _layer(state, done),
        "ink": _ink(done),
        "heat": _heat(station),
        "tip": _tip(state, done),
        "alarms": _alarms(state),
    }


def _time(state: dict[str, Any], done: dict[str, Any] | None) -> str:
    left = state["time_left_s"]
    if left is None:
        return "not printing" if state["ended"] else _UNKNOWN
    error = done["remaining_error_s"] if done else None
    about = "" if error is None else f" ± {span(error)}"
    return f"{span(left)}{about}" + (f", until {clock(done['ends_at'])}" if done else "")


def _layer(state: dict[str, Any], done: dict[str, Any] | None) -> str:
    if done is None:
        return f"{state['lines_executed']} of {state['lines_total']} commands made"
    passes = " (passes)" if done["passes"] else ""
    text = f"{done['layer']} of {done['layers']}, {done['layers_done']} whole{passes}"
    if done["vessels"]:
        text += f"; vessel {done['vessel']} of {done['vessels']}"
    return text


def _ink(done: dict[str, Any] | None) -> str:
    if done is None:
        return _UNKNOWN
    left = done["ink_left_ul"]
    text = f"{done['ink_ul']:.1f} of {done['ink_total_ul']:.1f} µL written"
    return text if left is None else f"{text}, {left:.0f} µL left"


def _heat(station: dict[str, Any] | None) -> str:
    live = station is not None and station["state"] in OPEN
    temperatures = station["temperatures"] if station is not None and live else ()
    return ", ".join(map(_one, temperatures)) or _UNKNOWN


def _one(heater: dict[str, Any]) -> str:
    target = heater["target_c"]
    return f"{heater['name']} {heater['now_c']:.1f}" + (f" → {target:g} °C" if target else " °C")


def _tip(state: dict[str, Any], done: dict[str, Any] | None) -> str:
    if done is None or not state["position_known"]:
        return _UNKNOWN
    place = " ".join(f"{axis}{mm:.2f}" for axis, mm in zip("XYZ", done["tip_mm"], strict=True))
    return _RAISED.get(LinkState(state["state"]), "") + place


def _alarms(state: dict[str, Any]) -> str:
    count, again = state["alarms"], state["line_errors"]
    text = f"{count}: {state['last_alarm']}".removesuffix(": ") if count else "none"
    return f"{text}; {again} lines sent again" if again else text


# Print card of the Job page: state, progress and commands of the running print.

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
