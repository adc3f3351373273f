"""Build a past print's page: facts, scan verdict, timeline, notes, photos, repeat, bundle."""

from __future__ import annotations

from nicegui import ui

from printctl.history.table import local_time, outcome
from printctl.pipeline.evidence import PHOTOS
from printctl.web.api.answers import API
from printctl.web.history.layout import STYLE, card, cell, download, facts, head, heading
from printctl.web.history.notes import note_card
from printctl.web.history.repeating import repeat_card
from printctl.web.history.service import RUNNING, HistoryService, PastPrintDetails
from printctl.web.history.strip import strip
from printctl.web.history.wording import VERDICTS, duration, state_words


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
