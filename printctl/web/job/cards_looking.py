"""Cards of the camera and of looks."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Final
from urllib.parse import quote

from nicegui import ui

from printctl.machine.link.states import LinkState
from printctl.observe.records import Answer
from printctl.web.api import API
from printctl.web.controls import Principal
from printctl.web.job.camera.timelapse import TimeLapseState
from printctl.web.job.layout import (
    Folds,
    button,
    card,
    live,
    quiet_button,
    run_or_explain,
    size,
    small,
)
from printctl.web.job.looks import LookTold
from printctl.web.job.service import JobService

_LOOK_AGAIN_S: Final = 1.0
_LAPSE_AGAIN_S: Final = 3.0


async def add_camera(service: JobService, job: str, folds: Folds) -> None:
    """Shown where there is a camera, or a time-lapse from when there was one."""
    lapse, _ = await run_or_explain(_timelapse, service, job)
    if service.watching.camera is None and (lapse is None or not lapse.frames):
        return
    with folds.card("Camera"):
        if service.watching.camera is not None:
            _picture(service)
        _lapse(service, job, lapse)


def _picture(service: JobService) -> None:
    picture = ui.element("img").classes("job-camera").props('alt="The print, seen by the camera"')
    problem = live().classes("job-problem")
    taken = small()
    shown = 0

    def refresh() -> None:
        nonlocal shown
        seen = service.watching.seen()
        there = seen.state == "there" and seen.still is not None
        picture.set_visibility(there)
        problem.set_text(seen.message)
        if there and seen.still is not None and seen.still.number != shown:
            shown = seen.still.number
            picture.props["src"] = f"{API}/camera/still?number={shown}"
            picture.update()
            at = time.strftime("%H:%M:%S", time.localtime(seen.still.at))
            taken.set_text(f"Taken at {at}; a new picture about every second")
        taken.set_visibility(there)

    refresh()
    ui.timer(_LOOK_AGAIN_S, refresh)


def _lapse(service: JobService, job: str, first: TimeLapseState | None) -> None:
    lapse_line = small()
    place = f"{API}/prints/{quote(job, safe='~')}/timelapse/film"
    film = ui.element("img").classes("job-camera")
    film.props('alt="Time-lapse of the print" loading=lazy')
    down = ui.link("Download the time-lapse (WebP)", place).classes("job-way")
    down.props["download"] = f"{job.partition('~')[2].removesuffix('.gcode')}_timelapse.webp"

    def show(lapse: TimeLapseState | None) -> None:
        lapse_line.set_text(_words(lapse))
        there = lapse is not None and lapse.film
        for one in (film, down):
            one.set_visibility(there)
        if there and lapse is not None and film.props.get("src") != (src := _of(place, lapse)):
            film.props["src"] = src
            film.update()

    async def look() -> None:
        lapse, _ = await run_or_explain(_timelapse, service, job)
        show(lapse)

    show(first)
    ui.timer(_LAPSE_AGAIN_S, look)


def _timelapse(service: JobService, job: str) -> TimeLapseState:
    return service.watching.timelapse(job, service.heard(job))


def _of(place: str, lapse: TimeLapseState) -> str:
    return f"{place}?frames={lapse.frames}&bytes={lapse.bytes}"


def _words(lapse: TimeLapseState | None) -> str:
    if lapse is None or not lapse.frames:
        return "Time-lapse: a picture is kept at the end of each layer or vessel of a print."
    kept = f"Time-lapse: {lapse.frames} pictures, {size(lapse.bytes)}"
    making = "; the film is being made" if lapse.making else ""
    return f"{kept}{making}{'; ' + lapse.message if lapse.message else ''}."


# Looks card of the Job page: pictures of print inspections, proposed action, operator's answer.

_LAST: Final = 12
_LARGE_PX: Final = 1280
_SMALL_PX: Final = 240
_AGAIN_S: Final = 0.5


class LooksCard:
    """The look that holds the print, two buttons where it asks, and a strip of the last looks.

    Hidden for a print that nobody observes.

    Parameters
    ----------
    service : JobService
    who : Principal
    job : str
    cancel : function
        Asks whether the print is to be ended.
    """

    def __init__(
        self, service: JobService, who: Principal, job: str, cancel: Callable[[], None]
    ) -> None:
        self._service, self._who, self._job = service, who, job
        self._told: dict[str, Any] | None = None
        self._shown: tuple[object, ...] | None = None
        self._asking = 0
        with ui.element("div").classes("w-full") as self._all, card("Looks", "job-looks gap-2"):
            self._head = live().classes("text-lg font-semibold")
            self._why = ui.label()
            self._seen = small()
            self._proposed = live().classes("job-warn")
            with ui.row().classes("gap-2") as self._buttons:
                button("Approve", lambda: self._answer("approve"))
                quiet_button("Go on without", lambda: self._answer("go_on"))
                quiet_button("Cancel print", cancel)
            self._problem = live().classes("job-problem")
            self._picture = ui.element("img").classes("job-look")
            self._strip = ui.element("ul").classes("job-strip").props('aria-label="Last looks"')
        self._all.set_visibility(False)
        ui.timer(_AGAIN_S, self._refresh)

    def show(self, state: dict[str, Any] | None) -> None:
        """Take notice of what was heard of the print last; read what it changes soon."""
        self._told = state

    async def _refresh(self) -> None:
        """Read the looks again where the print's state says that there is something new."""
        state = self._told
        if state is None or (key := _key(state)) == self._shown:
            return
        looks, problem = await run_or_explain(self._service.looks.looks, self._job)
        self._problem.set_text(problem)
        self._shown = key
        self._all.set_visibility(
            bool(looks) or bool(problem) or state["state"] == LinkState.LOOKING
        )
        self._show_held(state, looks or [])
        self._show_strip(looks or [])

    async def _answer(self, word: Answer) -> None:
        answered, problem = await run_or_explain(
            self._service.looks.answer, self._who, self._job, self._asking, word
        )
        if answered is not None:
            self._shown = None
            await self._refresh()
        self._problem.set_text(problem)

    # --- the look that holds the print -----------------------------------------------------------

    def _show_held(self, state: dict[str, Any], looks: list[LookTold]) -> None:
        number = state["look"]["number"] if state["look"] else 0
        held = state["state"] in (LinkState.LOOKING, LinkState.PAUSED)
        look = next((one for one in looks if held and one.record.number == number), None)
        self._head.set_text(_head(state, look))
        self._head.set_visibility(bool(self._head.text))
        self._asking = number
        self._show_picture(look)
        self._why.set_text("" if look is None else _sentence(look.record.why))
        self._seen.set_text("" if look is None else look.to_dict()["seen"])
        self._proposed.set_text(_proposed(look) if state["state"] == LinkState.PAUSED else "")
        for one in (self._why, self._seen, self._proposed):
            one.set_visibility(bool(one.text))
        self._buttons.set_visibility(look is not None and look.waits)

    def _show_picture(self, look: LookTold | None) -> None:
        there = look is not None and look.pictured > 0
        self._picture.set_visibility(there)
        if look is not None and there:
            number = look.record.number
            self._picture.props["src"] = self._place(look, _LARGE_PX)
            self._picture.props["alt"] = f"Look {number}: what was expected and what was found"
            self._picture.update()

    def _place(self, look: LookTold, width_px: int) -> str:
        job = quote(self._job, safe="~")
        query = f"width={width_px}&at={look.pictured:.3f}"
        return f"{API}/prints/{job}/looks/{look.record.number}/picture?{query}"

    # --- the strip -------------------------------------------------------------------------------

    def _show_strip(self, looks: list[LookTold]) -> None:
        self._strip.clear()
        with self._strip:
            for one in reversed(looks[-_LAST:]):
                with ui.element("li"):
                    self._one_of_strip(one)

    def _one_of_strip(self, one: LookTold) -> None:
        look, name = one.to_dict(), f"Look {one.record.number}"
        if one.pictured > 0:
            whole = self._place(one, 4096)
            with ui.link(target=whole, new_tab=True).props(f'aria-label="{name}, whole picture"'):
                picture = ui.element("img").props('alt="" loading=lazy')
                picture.props["src"] = self._place(one, _SMALL_PX)
        ui.label(f"{one.record.number}: {look['outcome']}").classes("text-sm")
        small(look["seen"] or "nothing seen")


def _key(state: dict[str, Any]) -> tuple[object, ...]:
    """What of a print's state tells that there is a new look, or another decision on it."""
    look = state["look"] or {}
    return state["print_id"], state["state"], look.get("number"), look.get("decision")


def _head(state: dict[str, Any], told_look: LookTold | None) -> str:
    look = state["look"]
    if told_look is not None:
        return f"Look {told_look.record.number} at the {told_look.record.mark}"
    if look is None or state["state"] != LinkState.LOOKING:
        return ""
    return f"Look {look['number']} at the {look['mark']}: a picture is taken and judged"


def _proposed(look: LookTold | None) -> str:
    """What is proposed, or what comes of the answer."""
    if look is None:
        return ""
    if look.waits:
        return f"Proposed: {look.to_dict()['proposed']}. The print waits for your word."
    if look.answer == "approve":
        return (
            "Approved. If the print is still paused in a minute, it can't be done from here: "
            "resume without it, or cancel, in the card Print."
        )
    if look.answer is not None:
        return "Answered; the print goes on in a moment."
    return "Nothing is proposed: see to the cause, then resume or cancel in the card Print."


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]
