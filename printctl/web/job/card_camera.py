"""Camera card of the Job page: live picture and time-lapse."""

from __future__ import annotations

import time
from typing import Final
from urllib.parse import quote

from nicegui import ui

from printctl.web.api.answers import API
from printctl.web.job.camera.timelapse import TimeLapseState
from printctl.web.job.layout import Folds, live, run_or_explain, size, small
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
