"""One past print on the page: facts, notes, files, print again."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final
from urllib.parse import quote

from nicegui import ui

from printctl.history.repeat import RepeatPlan
from printctl.history.table import local_time, outcome
from printctl.history.timeline import TimeLine
from printctl.pipeline.evidence import PHOTOS
from printctl.web.api import API
from printctl.web.history.layout import (
    STYLE,
    VERDICTS,
    card,
    cell,
    download,
    duration,
    facts,
    head,
    heading,
    state_words,
)
from printctl.web.history.service import RUNNING, HistoryService, PastPrintDetails
from printctl.web.shell.frame import run_or_notify

# Notes card of the History page: an operator's lots, cells, steps and remarks on a print.

NAMES: Final = {
    "operator": "Operator",
    "ink_lot": "Lot of the ink",
    "bath_lot": "Lot of the bath",
    "needle_lot": "Lot of the needle",
    "cells": "Cells",
    "passage": "Passage",
    "density_per_ml": "Density, cells per mL",
    "viability_percent": "Viability when mixed, %",
    "mixed_at": "Mixed",
    "viability_min": "Time the cells have, min",
    "sterility": "Sterility",
    "ticked": "Checklist",
}
_LISTS: Final = {"steps": "Steps after the print", "notes": "Notes"}
_UNNAMED: Final = ("text", "note", "step", "name")
_MOST: Final = 500
_LONGEST: Final = 4000


def note_card(note: Mapping[str, Any]) -> None:
    """Show the record; nothing where nothing was noted."""
    rows = list(filled_values(note))
    lists = {name: note[key] for key, name in _LISTS.items() if isinstance(note.get(key), list)}
    if not rows and not any(lists.values()):
        return
    with card("What the operator noted"):
        facts(rows)
        for name, entries in lists.items():
            if entries:
                ui.label(name).classes("ph-bad")
                with ui.element("ul"):
                    for entry in entries[:_MOST]:
                        with ui.element("li"):
                            ui.label(format_entry(entry)).style("white-space:pre-wrap")


def filled_values(note: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Names and values; those that nobody filled in are left out."""
    values = note.get("values")
    if not isinstance(values, dict):
        return
    for key, value in values.items():
        if value in (None, "", {}, []):
            continue
        if key == "ticked" and isinstance(value, dict):
            done = [name for name, ticked in value.items() if ticked is True]
            value = f"{len(done)} of {len(value)} points ticked before the start"
        elif key == "mixed_at" and isinstance(value, int | float):
            value = local_time(float(value))
        elif isinstance(value, float):
            value = f"{value:,.0f}".replace(",", "\N{THIN SPACE}") if value >= 1e4 else f"{value:g}"
        yield NAMES.get(key, str(key).replace("_", " ")), str(value)[:_LONGEST]


def format_entry(entry: Any) -> str:
    """One step or note in a line: when, who, what."""
    if not isinstance(entry, dict):
        return str(entry)[:_LONGEST]
    at = entry.get("at")
    when = local_time(float(at)) if isinstance(at, int | float) else ""
    rest = {k: v for k, v in entry.items() if k not in ("at", "who") and v not in (None, "")}
    words = [_words(k, v) for k, v in rest.items()]
    return "  ".join(filter(None, (when, str(entry.get("who") or ""), *words)))[:_LONGEST]


def _words(key: str, value: Any) -> str:
    if isinstance(value, bool):
        return f"({key})" if value else f"(not {key})"
    return str(value) if key in _UNNAMED else f"{key}: {value}"


# Repeat card of the History page: list differences, then prepare the same job again.


def repeat_card(service: HistoryService, shown: PastPrintDetails) -> None:
    """The card with its button and what it finds."""
    with card("Print it again"):
        ui.label(
            "The same G-code, byte for byte, as a new job. What isn't as it was then is told "
            "first; the print is started by you, on the Job page."
        )
        place = ui.element("div").props("role=status")

        async def look() -> None:
            plan = await run_or_notify(service.plan_repeat, shown.entry.id)
            if plan is not None:
                place.clear()
                with place:
                    _tell(service, plan)

        button = ui.button("Compare with today", on_click=look).props("outline no-caps")
        button.style("min-height:44px")
        if shown.found.gcode is None:
            button.disable()
            ui.label(f"Not possible here: {shown.found.missing[0]}.")


def _tell(service: HistoryService, plan: RepeatPlan) -> None:
    ui.label("The G-code is the one that was printed (its SHA-256 agrees).")
    with ui.element("ul"):
        for text in [one.line() for one in plan.differences] or ["Nothing that is known differs."]:
            with ui.element("li"):
                ui.label(text)
        for text in plan.unknown:
            with ui.element("li"):
                ui.label(f"Not known: {text}.")
    place = ui.element("div")

    async def make() -> None:
        job = await run_or_notify(service.repeat, plan.entry.id)
        if job is not None:
            button.disable()
            with place:
                ui.label(f"Job {job.partition('~')[2]} is ready.")
                ui.link("Go to the Job page", f"/job?job={quote(job)}").classes("pc-way")

    button = ui.button("Make the job", on_click=make).props("no-caps").style("min-height:44px")
    button.move(place)


# Timeline strip of a print's states on the History page, drawn to scale with a legend.

COLOURS: Final = {
    "connecting": "#8a94a3",
    "checking": "#5c6675",
    "printing": "#2f7d4f",
    "pausing": "#c48a00",
    "paused": "#c48a00",
    "looking": "#7a5bb5",
    "resuming": "#5b8def",
    "stopping": "#b3261e",
}
_OTHER: Final = "#8a94a3"


def strip(line: TimeLine) -> None:
    """Draw it."""
    whole = sum(one.end_s - one.start_s for one in line.stretches)
    if whole <= 0:
        return
    sums: dict[str, float] = {}
    for one in line.stretches:
        sums[one.state] = sums.get(one.state, 0.0) + one.end_s - one.start_s
    times = ", ".join(f"{state} {duration(s) or '0 s'}" for state, s in sums.items())
    drawn = ui.element("div").classes("ph-strip").props("role=img")
    drawn.props["aria-label"] = f"Times in each state: {times}"
    with drawn:
        for one in line.stretches:
            share = (one.end_s - one.start_s) / whole
            colour = COLOURS.get(one.state, _OTHER)
            ui.element("div").style(f"flex:{share:.6f} 1 0;background:{colour}")
    with ui.element("div").classes("ph-row").style("margin:8px 0"):
        for state, seconds in sums.items():
            with ui.element("span").classes("ph-row").style("gap:6px"):
                mark = ui.element("span").classes("ph-mark")
                mark.style(f"background:{COLOURS.get(state, _OTHER)}")
                ui.label(f"{state} {duration(seconds) or '0 s'}")


def show_print(service: HistoryService, shown: PastPrintDetails) -> None:
    """Build the page of one print."""
    ui.add_css(STYLE)
    heading(shown.entry.file or "(no name)")
    with ui.element("div").classes("ph-cards"):
        _facts_card(shown)
        _scan_card(shown)
        if shown.line is not None:
            _time_card(shown)
        note_card(shown.found.note())
        with ui.element("div"):
            _filing_card(shown)
            repeat_card(service, shown)
        _photos(shown)


def _facts_card(shown: PastPrintDetails) -> None:
    entry = shown.entry
    with card("What was printed"):
        facts([
            ("End", state_words(entry.state)),
            ("Why", entry.message if entry.state != "done" else ""),
            ("Begun", local_time(entry.started)),
            ("Over", local_time(entry.ended)),
            ("Took", duration(entry.ended - entry.started) if entry.ended else ""),
            ("Held", duration(shown.line.held_s) if shown.line else ""),
            ("Lines", f"{entry.done} of {entry.total}"),
            ("Gone on with", f"{entry.begun - 1} times" if entry.begun > 1 else ""),
            ("Profile", entry.profile),
            ("Port", entry.port),
            ("Operator", entry.by),
            ("Computer", f"{entry.who} at {entry.host}"),
            ("Id", entry.id),
            ("SHA-256", entry.sha256),
        ])  # fmt: skip


def _scan_card(shown: PastPrintDetails) -> None:
    evidence = shown.found
    with card("Verdict of the scan"):
        result = outcome(evidence.verdict)
        ui.label(VERDICTS[result]).classes("ph-bad" if result in ("fail", "undecided") else "")
        reasons = (evidence.verdict or {}).get("reasons", ())
        if reasons:
            with ui.element("ul"):
                for text in reasons:
                    with ui.element("li"):
                        ui.label(str(text))
        with ui.element("div").classes("ph-row"):
            if "report.html" in evidence.report:
                way = f"{API}/history/{shown.entry.id}/report"
                ui.link("Open the report", way, new_tab=True).classes("pc-way")
            if "report.pdf" in evidence.report:
                download("Report as PDF", f"{API}/history/{shown.entry.id}/report?kind=pdf")


def _time_card(shown: PastPrintDetails) -> None:
    line = shown.line
    if line is None:
        return
    with card("What happened", wide=True):
        strip(line)
        box = ui.element("div").classes("ph-scroll")
        box.props('tabindex=0 role=region aria-label="Events of the print"')
        with box, ui.element("table").classes("ph-table ph-list"):
            head(("Clock", "After", "What", "Said"))
            with ui.element("tbody"):
                for event in line.events:
                    with ui.element("tr"):
                        cell(local_time(event.at), "Clock", "ph-number")
                        cell(duration(event.after_s) or "0 s", "After", "ph-number")
                        bad = "ph-bad" if event.kind in ("alarm", "damaged") else ""
                        cell(f"! {event.kind}" if bad else event.kind, "", bad)
                        cell(event.text)
        if line.more:
            ui.label(f"{line.more} more events are in the journal.")


def _photos(shown: PastPrintDetails) -> None:
    names = [n.partition("/")[2] for n in shown.found.noted if n.startswith(f"{PHOTOS}/")]
    names = [n for n in names if n.lower().endswith((".jpg", ".jpeg", ".png"))]
    if not names:
        return
    with card("Photos", wide=True), ui.element("div").classes("ph-row"):
        for name in names:
            picture = ui.element("img").classes("ph-photo")
            picture.props["src"] = f"{API}/history/{shown.entry.id}/photos/{name}"
            picture.props["alt"] = f"Photo {name}"
            picture.props["loading"] = "lazy"


def _filing_card(shown: PastPrintDetails) -> None:
    entry = shown.entry
    with card("File the record"):
        ui.label(
            "Journal, G-code, recipe, profiles, checks, notes and report in one zip that is signed "
            "by this lab's key: any change to it will be found."
        )
        with ui.element("div").classes("ph-row"):
            if entry.state == RUNNING:
                ui.label("The print is still going on.")
            elif not entry.journal.is_file():
                ui.label("The journal isn't there any more: nothing can be filed.")
            else:
                download("Download the bundle", f"{API}/history/{entry.id}/bundle")
                download("Lab's public key", f"{API}/history/key")
        for text in shown.found.missing:
            ui.label(f"Not in it: {text}.").classes("ph-quiet")
