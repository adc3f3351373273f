"""Compose the registration report's PDF: verdict, figures and tables by section, provenance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from reportlab.platypus import Flowable, KeepTogether, Spacer

from design.network import VesselNetwork
from registration.report.budget_table import budget_table
from registration.report.finding_figures import views_note
from registration.report.gauging_sections import defect_table, printed_facts, two_way_rows
from registration.report.key_figures import key_figures
from registration.report.page import all_figures
from registration.report.pdf.blocks import HALF, head, outcome, pair
from registration.report.pdf.document import Facts, build_pdf
from registration.report.pdf.drawing import figure
from registration.report.pdf.provenance import digest_facts, meta_line, origin_facts, printed_on
from registration.report.pdf.styles import BODY, BULLET, HEADING, MINOR, SMALL, WIDTH, text
from registration.report.pdf.tables import data_table, fact_lines, grid
from registration.report.pdf.uncertainty import confidence_facts, fitted_rows, pose_doubts
from registration.report.record import record_facts
from registration.report.sections import (
    LOOK_NOTE,
    fit_rows,
    look_table,
    mapping,
    place_rows,
    records,
    surface_rows,
    vessel_summary,
    vessel_table,
)
from registration.report.views import Views
from registration.report.wording import plain
from registration.report.zones import ZONE_NOTE, frame_lines, zone_table

Figures = Mapping[str, Sequence[tuple[str, bytes]]]


def report_pdf(
    data: Mapping[str, Any],
    network: VesselNetwork | None,
    figures: Mapping[str, bytes],
    views: Views | None = None,
) -> bytes:
    """The file's bytes; parameters as `write_report_pdf`'s."""
    name, verdict = plain(data.get("recipe") or "Scan against design"), mapping(data, "verdict")
    when = printed_on(data)
    return build_pdf(
        report_story(data, network, figures, views),
        Facts(
            title=f"{name}: registration report",
            subject=f"{outcome(verdict)}: {'; '.join(map(plain, verdict.get('reasons') or []))}",
            footer=f"{name} · printed {when}" if when else name,
        ),
    )


def report_story(
    data: Mapping[str, Any],
    network: VesselNetwork | None,
    figures: Mapping[str, bytes],
    views: Views | None = None,
) -> list[Flowable]:
    """Everything in its order: verdict first, provenance last."""
    registration = mapping(data, "registration")
    drawn = _by_place(all_figures(data, network, figures, views))
    name = plain(data.get("recipe") or "Scan against design")
    return [
        *head("registration report", name, meta_line(data), mapping(data, "verdict"),
              key_figures(data)),
        *_deviation(registration, drawn),
        *_uncertainty(registration),
        *_vessels(registration, drawn),
        *_defects(registration),
        *map(KeepTogether, _drawn(drawn, "findings", WIDTH)),
        *([text(views_note(views), SMALL)] if views and views.findings else []),
        *map(KeepTogether, _drawn(drawn, "profiles", WIDTH)),
        *_each_vessel(registration),
        *_zones(registration),
        *_pictures(drawn),
        *_looks(data, drawn),
        *_notes(registration),
        *_record(registration),
        *_provenance(data),
    ]  # fmt: skip


def _by_place(figures: Mapping[str, bytes]) -> Figures:
    placed: dict[str, list[tuple[str, bytes]]] = {}
    for name, picture in figures.items():
        place, slash, caption = name.partition("/")
        placed.setdefault(place if slash else "other", []).append((caption or name, picture))
    return placed


def _drawn(drawn: Figures, place: str, width: float) -> list[list[Flowable]]:
    """Drawings of a place, each with its caption."""
    return [figure(picture, caption, width) for caption, picture in drawn.get(place, ())]


def _flat(parts: Sequence[Sequence[Flowable]]) -> list[Flowable]:
    return [each for part in parts for each in part]


def _deviation(registration: Mapping[str, Any], drawn: Figures) -> list[Flowable]:
    rows = [*fit_rows(registration), *two_way_rows(registration)]
    if not rows:
        return []
    said = f"Signed distance, scan to design ({plain(registration['sign_convention'])})" if (
        registration.get("sign_convention")
    ) else "Signed distance, scan to design"  # fmt: skip
    table = grid(["", "Rigid", "Scaled"], rows, [False, True, True], HALF)
    frame = [text(line, BODY) for line in frame_lines(registration)]
    histograms = _drawn(drawn, "histogram", HALF)
    left = [table, text(said, SMALL), Spacer(0, 6), *_flat(_drawn(drawn, "curve", HALF))]
    return [
        text("Deviation", HEADING),
        *frame,
        pair(left, _flat(histograms[:2])),
        *([pair(*histograms[2:4])] if len(histograms) > 3 else []),
        *_apart(registration),
    ]


def _apart(registration: Mapping[str, Any]) -> list[Flowable]:
    """Lumens and outer faces in a table of their own."""
    rows = surface_rows(registration)
    if not rows:
        return []
    heads = ["", "Lumens,\nrigid", "Lumens,\nscaled", "Outer faces,\nrigid", "Outer faces,\nscaled"]
    table = grid(heads, rows, [False, True, True, True, True])
    return [
        KeepTogether([text("Lumens and outer faces apart", MINOR), table]),
        *_places(registration),
    ]


def _places(registration: Mapping[str, Any]) -> list[Flowable]:
    rows = place_rows(registration)
    if not rows:
        return []
    heads = ["Deviation / µm", "Area / mm²", "x / mm", "y / mm", "z / mm"]
    head = text("Where the print stands out away from lumens (positive: gel is missing)", MINOR)
    return [KeepTogether([head, grid(heads, rows, [True] * 5)])]


def _uncertainty(registration: Mapping[str, Any]) -> list[Flowable]:
    rows, sure = fitted_rows(registration), confidence_facts(registration)
    if not rows and not sure:
        return []
    left = [grid(["Fitted", "Value", "95 %"], rows, [False, True, True], HALF)] if rows else []
    right = [fact_lines(sure, HALF)] if sure else []
    budgets = budget_table(registration)
    table = data_table(budgets) if budgets is not None else []
    # Not beside the rest: a pair can't be broken over pages, and there may be many doubts.
    doubts = [
        text(f"Doubt of the pose: {doubt}", BULLET, "•") for doubt in pose_doubts(registration)
    ]
    return [KeepTogether([text("Uncertainty", HEADING), pair(left, right)]), *doubts, *table]


def _vessels(registration: Mapping[str, Any], drawn: Figures) -> list[Flowable]:
    summary = [*vessel_summary(registration), *printed_facts(registration)]
    if not summary:
        return []
    right = [fact_lines(summary, HALF)]
    both = pair(_flat(_drawn(drawn, "diameters", HALF)), right)
    return [KeepTogether([text("Vessels, designed and measured", HEADING), both])]


def _defects(registration: Mapping[str, Any]) -> list[Flowable]:
    if "defects" not in registration:
        return []
    table = defect_table(registration)
    if table is not None:
        rule = mapping(registration, "judging").get("rule")
        said = [text(plain(rule), BODY)] if rule else []
        return [text("Findings", HEADING), *data_table(table), *said]
    seen = "" if registration.get("all_open") else "; not all of every vessel was seen"
    judged = "Every section is within its limits, and none" if "judging" in registration else "None"
    said = text(f"{judged} stands out from the sections' noise{seen}.", BODY)
    return [KeepTogether([text("Findings", HEADING), said])]


def _each_vessel(registration: Mapping[str, Any]) -> list[Flowable]:
    table = vessel_table(registration)
    return [] if table is None else [text("Each vessel", HEADING), *data_table(table)]


def _zones(registration: Mapping[str, Any]) -> list[Flowable]:
    table = zone_table(registration)
    if table is None:
        return []
    return [
        text("Geometric characteristics", HEADING),
        *data_table(table),
        text(ZONE_NOTE, SMALL),
    ]


_PICTURED = ("registration", "design", "flow", "fidelities", "oxygen", "toolpath", "other")


def _pictures(drawn: Figures) -> list[Flowable]:
    """Two in a row, and what belongs to no other section."""
    shown = [
        one for place in _PICTURED
        for one in _drawn(drawn, place, HALF)
    ]  # fmt: skip
    if not shown:
        return []
    shown += [[]] * (len(shown) % 2)
    rows = [pair(left, right) for left, right in zip(shown[::2], shown[1::2], strict=True)]
    return [KeepTogether([text("Design and print", HEADING), rows[0]]), *rows[1:]]


def _looks(data: Mapping[str, Any], drawn: Figures) -> list[Flowable]:
    """Looks at the print, as wide as the page, and what the final scan says to them."""
    shown, table = _drawn(drawn, "print", WIDTH), look_table(records(data, "looks"))
    beside = [] if table is None else [
        text("Looks held against the final scan", MINOR), *data_table(table), text(LOOK_NOTE, SMALL)
    ]  # fmt: skip
    if not shown and not beside:
        return []
    head = text("Looks at the print", HEADING)
    return [
        KeepTogether([head, *(shown[0] if shown else [])]),
        *map(KeepTogether, shown[1:]),
        *beside,
    ]


def _notes(registration: Mapping[str, Any]) -> list[Flowable]:
    notes = registration.get("notes")
    if not isinstance(notes, list) or not notes:
        return []
    return [text("Notes", HEADING), *(text(plain(note), BULLET, "•") for note in notes)]


def _record(registration: Mapping[str, Any]) -> list[Flowable]:
    facts = record_facts(registration)
    return [text("Measurement record", HEADING), fact_lines(facts)] if facts else []


def _provenance(data: Mapping[str, Any]) -> list[Flowable]:
    made = [text("Provenance", HEADING), fact_lines(origin_facts(data))]
    digests = digest_facts(data)
    return [*made, text("Versions and digests", MINOR), fact_lines(digests)] if digests else made
