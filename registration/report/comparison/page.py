"""Write the comparison of several prints as one self-contained HTML file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from design.files import write_text
from registration.comparison import Comparison
from registration.comparison import notes as standing_notes
from registration.comparison import verdict as found_verdict
from registration.comparison.gauge import gauge_notes, gauge_sentences
from registration.report.comparison.figures import (
    along_figure,
    history_figure,
    quantities_figure,
    vessels_figure,
)
from registration.report.comparison.gauge import gauge_tables
from registration.report.comparison.sections import (
    key_figures,
    print_table,
    shared_table,
    spread_facts,
    trend_table,
    vessel_table,
)
from registration.report.page_frame import render
from registration.report.svg import inline_figure
from registration.report.wording import number

Drawn = Mapping[str, tuple[str, bytes]]
"""Name to caption and drawing (SVG)."""
_ENTRY: Final = 'import { startPage } from "viewer/page"; startPage();'


def write_comparison_html(
    path: Path,
    comparison: Comparison,
    title: str,
    notes: Sequence[str] = (),
    drawn: Drawn | None = None,
) -> None:
    """Write a comparison as one HTML file that opens offline.

    Parameters
    ----------
    path : Path
        The file; an old one is replaced only by a whole new one.
    comparison : Comparison
    title : str
        Of the design, usually.
    notes : sequence of str
        Sentences to those that follow from the comparison itself.
    drawn : dict or None
        Of `comparison_figures`, where they are drawn already.

    Raises
    ------
    OSError
        When the file can't be written.
    """
    write_text(path, comparison_html(comparison, title, notes, drawn))


def comparison_html(
    comparison: Comparison, title: str, notes: Sequence[str] = (), drawn: Drawn | None = None
) -> str:
    """The text of the page; same input, same text."""
    drawn = comparison_figures(comparison) if drawn is None else drawn
    context = {
        "title": title,
        "facts": facts(comparison),
        "data": {"verdict": found_verdict(comparison)},
        "key_figures": key_figures(comparison),
        "figures": {
            name: inline_figure(picture, caption, f"{name}-")
            for name, (caption, picture) in drawn.items()
        },
        "captions": {name: caption for name, (caption, _) in drawn.items()},
        "print_table": print_table(comparison),
        "vessel_table": vessel_table(comparison),
        "trend_table": trend_table(comparison),
        "shared_table": shared_table(comparison),
        "spread_facts": spread_facts(comparison),
        "gauge": comparison.gauge
        and {
            "sentences": gauge_sentences(comparison.gauge),
            "tables": gauge_tables(comparison.gauge),
            "notes": gauge_notes(comparison.gauge),
        },
        "notes": [*notes, *standing_notes(comparison)],
    }
    return render("comparison.html", context, _ENTRY)


def facts(comparison: Comparison) -> list[str]:
    """A few words for the top of the page."""
    return [
        f"{number(len(comparison.prints))} prints, {number(len(comparison.scans))} scans",
        f"{number(len(comparison.vessels))} vessels",
        f"design {comparison.scans[0].design[:12]}",
    ]


def comparison_figures(comparison: Comparison) -> Drawn:
    """Name to caption and drawing (SVG)."""
    made = {
        "quantities": (
            "By print: each scan with the 95 % interval of its own registration, the prints' "
            "mean and its 95 % interval (band)",
            quantities_figure(comparison),
        ),
        "vessels": (
            "Diameter error of each vessel: mean over the prints with its 95 % interval, each "
            "print (small), tolerance (ticks)",
            vessels_figure(comparison),
        ),
        "history": ("Diameter error from print to print", history_figure(comparison)),
        "along": (
            "Diameter along the vessels: every scan, the later the darker; designed (line)",
            along_figure(comparison),
        ),
    }
    return {
        name: (caption, picture) for name, (caption, picture) in made.items() if picture is not None
    }
