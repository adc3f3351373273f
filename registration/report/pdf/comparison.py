"""Compose the PDF that compares several prints: verdict, key figures, tables and drawings."""

from __future__ import annotations

from collections.abc import Sequence

from reportlab.platypus import Flowable, KeepTogether

from registration.comparison import Comparison
from registration.comparison import notes as standing_notes
from registration.comparison import verdict as found_verdict
from registration.comparison.gauge import GaugeStudy, gauge_notes, gauge_sentences
from registration.report.comparison.gauge import gauge_tables
from registration.report.comparison.page import Drawn, comparison_figures, facts
from registration.report.comparison.sections import (
    key_figures,
    print_table,
    shared_table,
    spread_facts,
    trend_table,
    vessel_table,
)
from registration.report.pdf.blocks import head, outcome
from registration.report.pdf.document import Facts, build_pdf
from registration.report.pdf.drawing import figure
from registration.report.pdf.styles import BULLET, HEADING, MINOR, SMALL, WIDTH, text
from registration.report.pdf.tables import data_table, fact_lines

_MARKS = (
    "Off: the mean error isn't zero. Beyond the others: nor is it what all vessels of the print "
    "share. Varies: more than the others do. Each after Holm's correction for the number of "
    "vessels, at 5 %."
)


def comparison_pdf(
    comparison: Comparison, title: str, notes: Sequence[str], drawn: Drawn | None = None
) -> bytes:
    """The file's bytes; parameters as `write_comparison_pdf`'s."""
    verdict = found_verdict(comparison)
    subject = f"{outcome(verdict)}: {'; '.join(verdict['reasons'])}"
    return build_pdf(
        comparison_story(comparison, title, notes, drawn),
        Facts(
            f"{title}: comparison of prints", subject, f"{title} · {' · '.join(facts(comparison))}"
        ),
    )


def comparison_story(
    comparison: Comparison, title: str, notes: Sequence[str], drawn: Drawn | None = None
) -> list[Flowable]:
    """Everything in its order, the verdict first."""
    drawn = comparison_figures(comparison) if drawn is None else drawn
    shown = {
        name: KeepTogether(figure(picture, caption, WIDTH))
        for name, (caption, picture) in drawn.items()
    }
    shared = shared_table(comparison)
    return [
        *head(
            "comparison of prints",
            title,
            "   ·   ".join(facts(comparison)),
            found_verdict(comparison),
            key_figures(comparison),
        ),
        text("From print to print", HEADING),
        shown["quantities"],
        text("Each scan", MINOR),
        *data_table(print_table(comparison)),
        text("Mean, spread and drift", MINOR),
        *data_table(trend_table(comparison)),
        text("Repeatability of a vessel's diameter, all vessels pooled", MINOR),
        fact_lines(spread_facts(comparison)),
        *([] if comparison.gauge is None else _gauge(comparison.gauge)),
        text("Vessels", HEADING),
        *(shown[name] for name in ("vessels", "history", "along") if name in shown),
        text("Each vessel", MINOR),
        *data_table(vessel_table(comparison)),
        text(_MARKS, SMALL),
        *([text("Defects, common and single", HEADING), *data_table(shared)] if shared else []),
        text("How to read this", HEADING),
        *(text(note, BULLET, "•") for note in [*notes, *standing_notes(comparison)]),
    ]  # fmt: skip


def _gauge(study: GaugeStudy) -> list[Flowable]:
    made = [text("Gauge study: repeatability and reproducibility", HEADING)]
    made += [text(line, BULLET, "•") for line in gauge_sentences(study)]
    for heading, table in gauge_tables(study):
        made += [text(heading, MINOR), *data_table(table)]
    return made + [text(line, BULLET, "•") for line in gauge_notes(study)]
