"""Preflight card of the Job page: the form of the print set-up, and its checks."""

from __future__ import annotations

from typing import Any, Final

from nicegui import ui

from printctl.machine.printing.print_words import span
from printctl.web.controls import Principal
from printctl.web.job.card_tip import add_tip
from printctl.web.job.layout import Folds, button, live, number, run_or_explain, small, subheading
from printctl.web.job.machine import Machine
from printctl.web.job.service import JobService
from printctl.web.job.set_up import JobSetUp
from printctl.web.job.set_up_form import Said, SetUpForm

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
