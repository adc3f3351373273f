"""The card of the print: what it does, how far it is, and what may be done to it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui import run, ui

from printctl.link.states import ENDED
from printctl.web.controls import Principal
from printctl.web.job.parts import button, card, clock, live, quiet_button, small, span, tried
from printctl.web.job.service import JobService
from printctl.web.shell.dialogs import dialog_named

Refresh = Callable[[dict[str, Any] | None], None]
_ENDED = {state.value for state in ENDED}


def add_print(service: JobService, who: Principal, job: str) -> Refresh:
    """State, bars and buttons."""
    hands = service.hands
    with card("Print"):
        state = live().classes("text-xl font-semibold").mark("print state")
        message = small()
        bar = ui.linear_progress(0.0, show_value=False, size="18px").props(
            'aria-label="Share of the print\'s time"'
        )
        lines = [ui.label().classes("tabular-nums") for _ in range(5)]
        cells = ui.label().props("role=status").classes("job-warn")
        problem = live().classes("job-problem")

        async def do(work: Callable[..., Any], *args: Any, **values: Any) -> None:
            _, said = await tried(work, *args, **values)
            problem.set_text(said)

        with ui.row().classes("gap-2") as row:
            pause = button("Pause now", lambda: do(hands.pause, who, job, "now"))
            layer = quiet_button("Pause after layer", lambda: do(hands.pause, who, job, "layer"))
            vessel = quiet_button("Pause after vessel", lambda: do(hands.pause, who, job, "vessel"))
            resume = button("Resume", lambda: do(hands.resume, who, job))
            reload = quiet_button("Change syringe", lambda: do(hands.reload, who, job))
            here = quiet_button("I am here", lambda: do(hands.alive, who, job))
            cancel = quiet_button("Cancel print", lambda: ask.open())
        with ui.column().classes("w-full gap-2") as syringe:
            ui.label("A syringe is being changed. What was put in?").classes("font-semibold")
            used = ui.number(
                "Plunger travel used up", value=0.0, min=0, max=1000, suffix="mm"
            ).props("outlined")
            with ui.row().classes("gap-2"):
                button(
                    "Resume with this syringe",
                    lambda: do(hands.resume, who, job, plunger_mm=float(used.value or 0.0)),
                )
                quiet_button(
                    "Resume, syringe unchanged",
                    lambda: do(hands.resume, who, job, unchanged=True),
                )
    ask = _sure(lambda: do(hands.cancel, job))

    def refresh(told: dict[str, Any] | None) -> None:
        now = "" if told is None else str(told["state"])
        live_now = bool(now) and now not in _ENDED
        row.set_visibility(live_now)
        bar.set_visibility(told is not None)
        state.set_text(_state(told))
        message.set_text("" if told is None else str(told["message"]))
        wants = str(told["waits_for"]) if told else ""
        held, changing = now == "paused", now == "paused" and wants.startswith("syringe")
        for one in (pause, layer, vessel):
            one.set_visibility(now in ("printing", "connecting", "checking"))
        vessel.set_visibility(now == "printing" and bool(_of(told, "vessels")))
        resume.set_visibility((held and not changing) or (now == "printing" and bool(wants)))
        resume.set_text("Resume" if held else "Don't pause after all")
        syringe.set_visibility(changing)
        reload.set_visibility(now in ("printing", "paused") and not changing)
        here.set_visibility(told is not None and told["deadman_left_s"] is not None)
        cancel.set_visibility(live_now and now != "stopping")
        bar.set_value(float(_of(told, "share") or 0.0))
        for label, text in zip(lines, _lines(told), strict=True):
            label.set_text(text)
            label.set_visibility(bool(text))

    async def clock_of_cells() -> None:
        found, _ = await tried(service.viability, job)
        cells.set_text("" if found is None else found.words)
        cells.set_visibility(found is not None and found.minutes is not None)
        cells.classes(remove="job-late")
        if found is not None and found.state in ("late", "close"):
            cells.classes(add="job-late")

    ui.timer(10.0, clock_of_cells)
    return refresh


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


def _of(told: dict[str, Any] | None, key: str) -> Any:
    return told["progress"].get(key) if told and told.get("progress") else None


def _state(told: dict[str, Any] | None) -> str:
    if told is None:
        return "Not printed yet"
    words = str(told["state"]).replace("_", " ")
    share = _of(told, "share")
    return words.capitalize() if share is None else f"{words.capitalize()} · {100 * share:.1f} %"


def _lines(told: dict[str, Any] | None) -> tuple[str, str, str, str, str]:
    """Time, layer, vessel, ink and what is waited for, in words."""
    if told is None:
        return ("",) * 5
    done = told.get("progress")
    lines = f"{told['lines_executed']} of {told['lines_total']} commands executed"
    wants = f"Waits for: {told['waits_for']}" if told["waits_for"] else ""
    left = told["deadman_left_s"]
    if left is not None:
        wants = f"{wants}  Somebody must confirm within {span(left)}.".strip()
    if not done:
        return f"{lines}; time and layers aren't known yet", "", "", "", wants
    return (
        f"{_time(told, done)} · {lines}",
        _part("Pass" if done["passes"] else "Layer", done, "layer"),
        _part("Vessel", done, "vessel"),
        _ink(done),
        wants,
    )


def _time(told: dict[str, Any], done: dict[str, Any]) -> str:
    taken = f"Printing for {span(done['active_s'])}"
    if told["state"] in _ENDED:
        return f"{taken} (the dry run said {span(done['predicted_s'])})"
    error = done["remaining_error_s"]
    about = " (by the dry run alone)" if error is None else f" ± {span(error)}"
    return f"{taken}, {span(done['remaining_s'])} left{about}, ends at {clock(done['ends_at'])}"


def _part(name: str, done: dict[str, Any], key: str) -> str:
    count = done[f"{key}s"]
    whole = done[f"{key}s_done"]
    if not count:
        return ""
    if whole == count:
        return f"{name}s: all {count} whole"
    return f"{name} {done[key]} of {count} is being written, {whole} whole"


def _ink(done: dict[str, Any]) -> str:
    text = f"Ink: {done['ink_ul']:.2f} of {done['ink_total_ul']:.2f} µL written"
    left = done["ink_left_ul"]
    return text if left is None else f"{text}, {left:.1f} µL left in the syringe"
