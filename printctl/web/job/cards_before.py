"""Cards before a print: set-up, tip, check, start."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Final

from nicegui import ui

from firmware_profiles import Bath, Dish, Facts, Ink, Needle, Printer, Syringe
from printctl.machine.printing.print_words import span
from printctl.web.controls import Principal
from printctl.web.job.aftercare import checklist
from printctl.web.job.layout import (
    Folds,
    button,
    date_text,
    live,
    number,
    quiet_button,
    run_or_explain,
    small,
    subheading,
)
from printctl.web.job.machine import AGREES_MM, Machine
from printctl.web.job.record import PrintRecord
from printctl.web.job.service import JobService
from printctl.web.job.set_up import JobSetUp
from printctl.web.job.set_ups import Place
from printctl.web.profile_store import ProfileStore
from printctl.web.shell.frame import dialog_named

Said = Callable[[], JobSetUp]
_THINGS: Final[tuple[tuple[str, str, type[Facts]], ...]] = (
    ("printer", "Printer", Printer),
    ("needle", "Needle", Needle),
    ("syringe", "Syringe", Syringe),
    ("ink", "Ink", Ink),
    ("bath", "Bath", Bath),
    ("dish", "Dish", Dish),
)


class SetUpForm:
    """Machine, what is mounted on it, where the job starts; then how the print is watched over.

    Parameters
    ----------
    store : ProfileStore
        Profiles that can be chosen.
    first : JobSetUp
        What the form says at first.
    declared : (x, y, z) or None, mm
        Where the job itself says that it starts, which the form can't change.
    """

    def __init__(self, store: ProfileStore, first: JobSetUp, declared: Place | None) -> None:
        self._first = first
        with ui.element("div").classes("job-form"):
            self._profiles = {
                key: _choice(store, name, kind, getattr(first, key)) for key, name, kind in _THINGS
            }
            self._depth = _number("Bath depth", first.bath_depth_mm, "mm", least=0.1)
            self._start = [
                _number(f"Start {axis}", mm, "mm", step=0.1)
                for axis, mm in zip("XYZ", first.start_mm, strict=True)
            ]
            care = first.care
            self._deadman = _number("Pause unless confirmed within", care.deadman_min, "min", 0.0)
            self._prime = _number("Extra ink after a pause", care.prime_ul, "µL", 0.0)
        if declared is not None:
            for field in self._start:
                field.disable()
            small("The job itself says where it starts; the tip must come there.")

    def add_answers(self) -> None:
        """What is answered by yes or no."""
        first = self._first
        self._reload = ui.checkbox(
            "Pause for a new syringe where one doesn't last", value=first.care.reload
        )
        self._stops = ui.checkbox(
            "Stop instead of pausing when nobody confirms", value=first.care.deadman_stops
        )
        self._accept = ui.checkbox(
            "Print although the needle's shaft passes through written vessels (goes into the "
            "journal)",
            value=first.accept_crossings,
        )

    def start(self) -> Place:
        """Where the job starts."""
        x, y, z = (float(one.value or 0.0) for one in self._start)
        return x, y, z

    def said(self) -> JobSetUp:
        """All that the form says now.

        Raises
        ------
        pydantic.ValidationError
        """
        first, depth = self._first, self._depth.value
        profiles = {key: str(field.value or "") for key, field in self._profiles.items()}
        dish = bool(profiles["dish"])
        care = first.care.model_dump() | {
            "deadman_min": float(self._deadman.value or 0.0),
            "deadman_stops": bool(self._stops.value and self._deadman.value),
            "prime_ul": float(self._prime.value or 0.0),
            "reload": bool(self._reload.value),
        }
        return JobSetUp.model_validate(
            first.model_dump()
            | profiles
            | {
                "care": care,
                "bath_depth_mm": float(depth) if depth and dish else None,
                "dish_centre_mm": first.dish_centre_mm if dish else None,
                "start_mm": self.start(),
                "accept_crossings": bool(self._accept.value),
            }
        )


def _choice(store: ProfileStore, name: str, kind: type[Facts], value: str) -> ui.select:
    options = store.choices(kind)
    if value and value not in options:
        options[value] = store.name(value)
    options[""] = "none named"
    return ui.select(options, label=name, value=value, with_input=False).props("outlined")


def _number(
    name: str,
    value: float | None,
    unit: str,
    least: float | None = None,
    step: float | None = None,
) -> ui.number:
    made = ui.number(name, value=value, min=least, step=step, suffix=unit, precision=3)
    return made.props("outlined")


# Tip line of the Job page: tip position against the job's start, with a button to move there.


def add_tip(
    service: JobService,
    who: Principal,
    job: str,
    machine: Machine,
    start: Callable[[], Place],
    on_its_way: Callable[[bool], object],
) -> None:
    """A line that says where the tip stands, and the button beside it.

    ``on_its_way`` is told when the tip sets out, and when it has arrived or was refused.
    """
    with ui.row().classes("items-center gap-2 w-full"):
        tip_line = live().classes("text-sm")
        tip_line.set_text(standing(machine, start()))

        async def go() -> None:
            tip_line.set_text("The tip is on its way: up, over, down …")
            move.disable()
            on_its_way(True)
            tip, problem = await run_or_explain(service.to_start, who, job, start())
            move.enable()
            on_its_way(False)
            tip_line.set_text(problem or standing(tip, start()))

        move = quiet_button("Move the tip to the start", go)


def standing(machine: Machine, start: Place) -> str:
    """Where the tip stands, in words."""
    if machine.tip_mm is None:
        return "Nobody knows where the tip stands; see the page Printer."
    if max(abs(a - b) for a, b in zip(machine.tip_mm, start, strict=True)) <= AGREES_MM:
        return "The tip stands at the start."
    there = ", ".join(f"{axis} {mm:.2f}" for axis, mm in zip("XYZ", machine.tip_mm, strict=True))
    return f"The tip stands at {there} mm, not at the start."


# Preflight card of the Job page: the form of the print set-up, and its checks.

_WORDS: Final = {"passed": "Passed", "failed": "Failed", "warning": "Warning"}


def add_preflight(
    service: JobService,
    who: Principal,
    job: str,
    first: JobSetUp,
    machine: Machine | None,
    folds: Folds,
) -> Said:
    """The form of the set-up, a button, and a table of the checks; gives what the form says."""
    with folds.card("Set-up and preflight"):
        if machine is None:
            small("No printer is connected; the job can be checked, but not started.")
        form = SetUpForm(service.store, first, service.declared(job))
        if machine is not None:
            # A check while the tip moves would find it away from the start.
            add_tip(service, who, job, machine, form.start, lambda on: check.set_enabled(not on))
        form.add_answers()
        verdict = live().classes("font-semibold").mark("verdict")
        problem = live().classes("job-problem")
        table = ui.element("div").classes("w-full")

        async def look() -> None:
            problem.set_text("")
            verdict.set_text("Checking: the whole job is run through the planner …")
            check.disable()
            preflight, text = await run_or_explain(lambda: service.preflight(job, form.said()))
            check.enable()
            problem.set_text(text)
            verdict.set_text("" if preflight is None else _verdict(preflight))
            table.clear()
            if preflight is not None:
                with table:
                    _rows(preflight)

        check = button("Check", look)
    return form.said


def _verdict(preflight: dict[str, Any]) -> str:
    failed = sum(one["result"] == "failed" for one in preflight["checks"])
    warned = sum(one["result"] == "warning" for one in preflight["checks"])
    first = "All checks passed" if not failed else f"{failed} failed: no start"
    warning = f", {warned} warnings to read" if warned else ""
    ink = f"{preflight['ink_ul']:.1f} µL of ink"
    changes = len(preflight["reload_at"])
    more = f", {changes} changes of syringe" if changes else ""
    return f"{first}{warning}. {span(preflight['duration_s'])}, {ink}{more}."


def _rows(preflight: dict[str, Any]) -> None:
    """What failed first, then warnings, then what passed, folded up."""
    of = {word: [c for c in preflight["checks"] if c["result"] == word] for word in _WORDS}
    for text in preflight["accepted"]:
        ui.label(f"Accepted, and kept in the journal: {text}").classes("job-warn")
    for word in ("failed", "warning"):
        if of[word]:
            subheading(f"{_WORDS[word]} ({len(of[word])})")
            for one in of[word]:
                _row(one)
    if of["passed"]:
        with ui.expansion(f"Passed ({len(of['passed'])})").classes("w-full"):
            for one in of["passed"]:
                _row(one)


def _row(one: dict[str, Any]) -> None:
    with ui.element("div").classes(f"job-check job-{one['result']}").mark(one["result"]):
        ui.label(_WORDS[one["result"]]).classes("job-word")
        with ui.element("div"):
            numbers = ""
            if one["value"] is not None or one["limit"] is not None:
                unit = one["unit"]
                numbers = f": {number(one['value'])} {unit}, limit {number(one['limit'])} {unit}"
            ui.label(f"{one['check']}{numbers}")
            where = f"{one['place']}: " if one["place"] else ""
            if one["result"] != "passed":
                small(f"{where}{one['remedy']}")
            elif one["place"]:
                small(one["place"])


# Start card of the Job page: operator's record, checklist and final confirmation.

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
