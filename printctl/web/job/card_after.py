"""After-print card of the Job page: steps, warming, flushing, notes, photos."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any
from urllib.parse import quote

from nicegui import events, ui

from printctl.web.api import API
from printctl.web.controls import Principal
from printctl.web.job.aftercare import MOST_BYTES, checklist
from printctl.web.job.layout import (
    Folds,
    button,
    date_text,
    live,
    quiet_button,
    run_or_explain,
    small,
    subheading,
)
from printctl.web.job.service import JobService
from printctl.web.shell.frame import upload


async def add_after(service: JobService, who: Principal, job: str, folds: Folds) -> None:
    """Steps to tick, with what they need; notes and photos."""
    with folds.card("After the print"):
        problem = live().classes("job-problem")

        async def do(work: Callable[..., Any], *args: Any) -> Any:
            result, text = await run_or_explain(work, *args)
            problem.set_text(text)
            return result

        await _steps(service, who, job, do)
        await _melt_out(service, who, job, do)
        await _flush(service, job, do)
        await _notes(service, who, job, do)
        await _photos(service, who, job, do)


async def _steps(service: JobService, who: Principal, job: str, do: Any) -> None:
    steps: list[dict[str, Any]] = await do(service.after.steps, job) or []
    for step in steps:
        with ui.column().classes("gap-0"):
            box = ui.checkbox(step["text"], value=step["done"]).classes("job-point")
            ticked = small(_ticked(step))

        async def tick(
            _: Any, box: ui.checkbox = box, ticked: ui.label = ticked, step: str = step["id"]
        ) -> None:
            after = await do(service.after.tick, who, job, step, bool(box.value))
            for one in after or []:
                if one["id"] == step:
                    ticked.set_text(_ticked(one))

        box.on_value_change(tick)


def _ticked(step: dict[str, Any]) -> str:
    return f"{date_text(step['at'])}, {step['who']}" if step["done"] and step["at"] else ""


async def _melt_out(service: JobService, who: Principal, job: str, do: Any) -> None:
    subheading("Melt-out: warm the bath slowly")
    bath = await do(service.after.bath, job)
    melts = bath.melt_out_c if bath is not None and bath.melt_out_c else 37.0
    with ui.row().classes("items-center gap-2"):
        heater = ui.select(["bed", "nozzle", "chamber"], label="Heater", value="bed")
        target = ui.number("Target", value=melts, min=0, max=60, suffix="°C").props("outlined")
        rate = ui.number(
            "Rate", value=checklist()["melt_out"]["rate_c_min"], min=0.1, max=20, suffix="°C/min"
        ).props("outlined")
    heater.props("outlined").classes("min-w-[120px]")
    heat_line = live()

    async def warm() -> None:
        if target.value is not None and rate.value:
            await do(
                service.after.melt_out, who, heater.value, float(target.value), float(rate.value)
            )
            await look()

    async def look() -> None:
        melting = await do(service.after.melting) if service.after.warming else None
        heat_line.set_text("" if melting is None else _ramp(melting))

    with ui.row().classes("gap-2"):
        button("Warm", warm)
        quiet_button("Hold here", lambda: do(service.after.stop_melting))
    ui.timer(2.0, look)


def _ramp(heater: dict[str, Any]) -> str:
    def c(value: float | None) -> str:
        return "–" if value is None else f"{value:.1f} °C"

    return (
        f"{heater['heater']}: {c(heater['now_c'])} now, set to {c(heater['set_c'])}, up to "
        f"{c(heater['target_c'])} at {heater['rate_c_min']:g} °C/min; {heater['message']}"
    )


async def _flush(service: JobService, job: str, do: Any) -> None:
    subheading("Flush: how hard the channels bear it")
    allowed = ui.number(
        "Allowed wall shear",
        value=checklist()["flush"]["wall_shear_pa"],
        min=0.01,
        max=1000,
        suffix="Pa",
    ).props("outlined")
    flush_line = live()

    async def reckon() -> None:
        flushed = await do(service.after.flush, job, float(allowed.value or 0.0) or None)
        flush_line.set_text(
            "No flow was solved for this job: keep the pressure low and look at the outlet."
            if flushed is None
            else f"At most {flushed.pressure_pa:.3g} Pa between inlet and outlet: vessel "
            f"{flushed.vessel} then has {flushed.wall_shear_pa:g} Pa at its wall (at its "
            "mean radius; its narrow end has more)."
        )

    allowed.on_value_change(reckon)
    await reckon()


async def _notes(service: JobService, who: Principal, job: str, do: Any) -> None:
    subheading("Notes")
    notes_column = ui.column().classes("w-full gap-1")
    text = ui.textarea("Note").props("outlined autogrow maxlength=10000").classes("w-full")

    def show(notes: list[dict[str, Any]]) -> None:
        notes_column.clear()
        with notes_column:
            for one in notes:
                small(f"{date_text(one['at'])}, {one['who']}")
                ui.label(one["text"]).classes("whitespace-pre-wrap break-words")

    async def add() -> None:
        kept = await do(service.after.note, who, job, text.value or "")
        if kept is not None:
            text.set_value("")
            show(kept)

    quiet_button("Add note", add)
    show(await do(service.after.notes, job) or [])


async def _photos(service: JobService, who: Principal, job: str, do: Any) -> None:
    subheading("Photos")
    shown = ui.row().classes("gap-2")

    def show(photos: list[dict[str, Any]]) -> None:
        shown.clear()
        with shown:
            for one in photos:
                place = f"{API}/prints/{quote(job, safe='~')}/photos/{quote(one['name'])}"
                taken = f"Photo of {date_text(one['at'])}, {one['who']}"
                ui.image(place).props(f'alt="{date_text(one["at"])}"').classes("w-40").tooltip(
                    taken
                )

    async def take(event: events.UploadEventArguments) -> None:
        kept = await do(service.after.add_photo, who, job, await event.file.read())
        if kept is not None:
            show(kept)

    upload("Add photos", take, "image/*", multiple=True, max_file_size=MOST_BYTES)
    show(await do(service.after.photos, job) or [])
