"""Start card of the Job page: operator's record, checklist and final confirmation."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Final

from nicegui import ui

from printctl.web.controls import Principal
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
from printctl.web.job.record import PrintRecord
from printctl.web.job.service import JobService
from printctl.web.job.set_up_form import Said
from printctl.web.job.steps_after import checklist
from printctl.web.shell.dialogs import dialog_named

_LINES: Final = (
    ("operator", "Operator's name"),
    ("ink_lot", "Lot of the ink"),
    ("bath_lot", "Lot and age of the bath"),
    ("needle_lot", "Lot of the needle"),
    ("cells", "Cells (line or donor)"),
)
_NUMBERS: Final = (
    ("passage", "Passage", "", 0, 1000),
    ("density_per_ml", "Cells per mL of ink", "/mL", 0, 1e12),
    ("viability_percent", "Viability when mixed", "%", 0, 100),
    ("viability_min", "Time the cells have", "min", 0.1, 100_000),
)


def add_start(
    service: JobService,
    who: Principal,
    job: str,
    record: PrintRecord,
    set_up: Said,
    folds: Folds,
) -> Callable[[bool], None]:
    """The form, the points and the button; told whether a print goes on."""
    with folds.card("Before the start"):
        saved = live().classes("text-sm job-quiet")

        async def save(**values: Any) -> None:
            _, problem = await run_or_explain(service.write_down, who, job, values)
            saved.set_text(problem or f"Written down at {time.strftime('%H:%M:%S')}")

        _form(record, save)
        _mixing(record, save)
        ticked = _points(record, save)
        problem = live().classes("job-problem").mark("start problem")

        async def ask() -> None:
            machine, text = await run_or_explain(service.machine)
            problem.set_text(text)
            if machine is None:
                problem.set_text(text or "No printer is connected; connect it on the page Printer.")
                return
            question.set_text(f"{machine.words} will move now and write {job.partition('~')[2]}.")
            words.set_text(machine.words)
            dialog.open()

        start = button("Start print …", ask)
        with (
            dialog_named("Start the print?").props("persistent") as dialog,
            ui.card().classes("gap-3"),
        ):
            ui.label("Start the print?").classes("text-lg font-semibold")
            question = ui.label()
            words = ui.label().classes("hidden")
            small("The checks are made once more before the first byte is sent.")

            async def go() -> None:
                dialog.close()
                problem.set_text("Starting: checked once more, then sent …")
                _, text = await run_or_explain(
                    lambda: service.start(who, job, set_up(), words.text)
                )
                problem.set_text(text)

            with ui.row().classes("gap-2"):
                button("Yes, start it", go)
                quiet_button("No", dialog.close)

    def refresh(going_on: bool) -> None:
        start.set_enabled(not going_on)
        for one in ticked:
            one.set_enabled(not going_on)

    return refresh


def _form(record: PrintRecord, save: Callable[..., Any]) -> None:
    with ui.element("div").classes("job-form"):
        for key, name in _LINES:
            field = ui.input(name, value=getattr(record, key)).props("outlined maxlength=200")
            field.on("change", lambda _, key=key, field=field: save(**{key: field.value or ""}))
        for key, name, unit, low, high in _NUMBERS:
            box = ui.number(name, value=getattr(record, key), min=low, max=high, suffix=unit)
            box.props("outlined").on(
                "change", lambda _, key=key, box=box: save(**{key: _whole(key, box.value)})
            )
    notes = ui.textarea("Notes on sterility", value=record.sterility).props("outlined autogrow")
    notes.classes("w-full").on("change", lambda _: save(sterility=notes.value or ""))


def _whole(key: str, value: float | None) -> float | int | None:
    return int(value) if key == "passage" and value is not None else value


def _mixing(record: PrintRecord, save: Callable[..., Any]) -> None:
    """When cells and ink were mixed: now, or so many minutes ago."""

    async def mixed() -> None:
        at = time.time() - 60.0 * float(ago.value or 0.0)
        await save(mixed_at=at)
        told.set_text(_mixed(at))

    with ui.row().classes("items-center gap-2"):
        ago = ui.number("Cells were mixed … ago", value=0, min=0, max=10_000, suffix="min")
        ago.props("outlined").classes("min-w-[210px]")
        quiet_button("Start the clock of the cells", mixed)
        told = small(_mixed(record.mixed_at))


def _mixed(at: float | None) -> str:
    return "" if at is None else f"Mixed at {date_text(at)}"


def _points(record: PrintRecord, save: Callable[..., Any]) -> list[ui.checkbox]:
    """The list of docs/first_print.md, to be ticked."""
    subheading("Looked at, point by point")
    boxes: dict[str, ui.checkbox] = {}

    async def tick() -> None:
        await save(ticked={key: bool(box.value) for key, box in boxes.items()})

    for point in checklist()["before"]:
        box = ui.checkbox(point["text"], value=record.ticked.get(point["id"], False))
        boxes[point["id"]] = box.on_value_change(tick).classes("job-point")
    return list(boxes.values())
