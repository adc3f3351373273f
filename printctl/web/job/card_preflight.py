"""The card of the set-up and its checks."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from nicegui import ui

from firmware_profiles import Bath, Dish, Ink, Needle, Printer, Syringe
from firmware_profiles.load import shipped
from printctl.web.job.machine import Machine
from printctl.web.job.parts import button, card, live, number, small, span, subheading, tried
from printctl.web.job.service import JobService
from printctl.web.job.set_up import JobSetUp

Said = Callable[[], JobSetUp]
_THINGS: Final = (
    ("printer", "Printer", Printer),
    ("needle", "Needle", Needle),
    ("syringe", "Syringe", Syringe),
    ("ink", "Ink", Ink),
    ("bath", "Bath", Bath),
    ("dish", "Dish", Dish),
)
_WORDS: Final = {"passed": "Passed", "failed": "Failed", "warning": "Warning"}


def add_preflight(service: JobService, job: str, first: JobSetUp, machine: Machine | None) -> Said:
    """The form of the set-up, a button, and a table of the checks; gives what the form says."""
    with card("Set-up and preflight"):
        if machine is None:
            small("No printer is connected; the job can be checked, but not started.")
        with ui.element("div").classes("job-form"):
            fields = {key: _choice(name, kind, getattr(first, key)) for key, name, kind in _THINGS}
            depth = ui.number("Bath depth", value=first.bath_depth_mm, min=0.1, suffix="mm").props(
                "outlined"
            )
            start = [
                ui.number(f"Start {axis}", value=value, step=0.1, suffix="mm", precision=3)
                for axis, value in zip("XYZ", first.start_mm, strict=True)
            ]
            for one in start:
                one.props("outlined")
            deadman = ui.number(
                "Pause unless confirmed within", value=first.care.deadman_min, min=0, suffix="min"
            )
            prime = ui.number(
                "Extra ink after a pause", value=first.care.prime_ul, min=0, suffix="µL"
            )
            for one in (deadman, prime):
                one.props("outlined")
        reload = ui.checkbox(
            "Pause for a new syringe where one doesn't last", value=first.care.reload
        )
        stops = ui.checkbox(
            "Stop instead of pausing when nobody confirms", value=first.care.deadman_stops
        )
        accept = ui.checkbox(
            "Print although the needle's shaft passes through written vessels (goes into the "
            "journal)",
            value=first.accept_crossings,
        )
        verdict = live().classes("font-semibold").mark("verdict")
        problem = live().classes("job-problem")
        table = ui.element("div").classes("w-full")

        def said() -> JobSetUp:
            care = first.care.model_dump() | {
                "deadman_min": float(deadman.value or 0.0),
                "deadman_stops": bool(stops.value and deadman.value),
                "prime_ul": float(prime.value or 0.0),
                "reload": bool(reload.value),
            }
            given = {key: str(field.value or "") for key, field in fields.items()}
            dish = bool(given["dish"])
            return JobSetUp.model_validate(
                first.model_dump()
                | given
                | {
                    "care": care,
                    "bath_depth_mm": float(depth.value) if depth.value and dish else None,
                    "dish_centre_mm": first.dish_centre_mm if dish else None,
                    "start_mm": tuple(float(one.value or 0.0) for one in start),
                    "accept_crossings": bool(accept.value),
                }
            )

        async def look() -> None:
            problem.set_text("")
            verdict.set_text("Checking: the whole job is run through the planner …")
            check.disable()
            found, text = await tried(lambda: service.preflight(job, said()))
            check.enable()
            problem.set_text(text)
            verdict.set_text("" if found is None else _verdict(found))
            table.clear()
            if found is not None:
                with table:
                    _rows(found)

        check = button("Check", look)
    return said


def _choice(name: str, kind: Any, value: str) -> ui.select:
    names = shipped(kind)
    options = {one: one for one in names} | ({value: value} if value else {}) | {"": "none named"}
    return ui.select(options, label=name, value=value, with_input=False).props("outlined")


def _verdict(found: dict[str, Any]) -> str:
    failed = sum(one["result"] == "failed" for one in found["checks"])
    warned = sum(one["result"] == "warning" for one in found["checks"])
    first = "All checks passed" if not failed else f"{failed} failed: no start"
    warning = f", {warned} warnings to read" if warned else ""
    ink = f"{found['ink_ul']:.1f} µL of ink"
    changes = len(found["reload_at"])
    more = f", {changes} changes of syringe" if changes else ""
    return f"{first}{warning}. {span(found['duration_s'])}, {ink}{more}."


def _rows(found: dict[str, Any]) -> None:
    """What failed first, then warnings, then what passed, folded up."""
    of = {word: [c for c in found["checks"] if c["result"] == word] for word in _WORDS}
    for text in found["accepted"]:
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
