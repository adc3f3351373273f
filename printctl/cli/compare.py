"""`printctl compare`: shared deviations, spread, drift and gauge study of one design's prints."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from design.files import write_text
from printctl.cli.declare import command
from printctl.cli.options import JsonFlag, PdfFlag, folder_to_write, print_json, print_lines
from printctl.errors import UsageError
from printctl.history.comparing import NewLimits, PrintNames, read_folders
from printctl.settings import arg, opt
from registration.comparison import (
    Comparison,
    compare,
    comparison_csv,
    comparison_dict,
    gauge_csv,
    verdict,
)
from registration.report.comparison_page import comparison_figures, write_comparison_html
from registration.report.print_page import print_page

JSON: Final = "compare.json"
CSV: Final = "compare.csv"
GAUGE_CSV: Final = "gauge.csv"
HTML: Final = "compare.html"
PDF: Final = "compare.pdf"


@command
def compare_prints(
    folders: list[Path] = arg(
        "Run folders, or folders that `printctl register` wrote; two or more.", metavar="RUN..."
    ),
    out: Path = opt("Folder for the files.", ..., callback=folder_to_write),
    prints: str | None = opt(
        "Which print each folder's scan is of, by any names; else by its journal.",
        metavar="A,A,B,...",
    ),
    repeatability: bool = opt(
        "Gauge R&R: the folders are operators x parts x repeats (ANOVA, AIAG MSA).", False
    ),
    operators: str | None = opt(
        "With --repeatability: who made each folder's scan; else as its record says.",
        metavar="A,A,B,...",
    ),
    parts: str | None = opt(
        "With --repeatability: the part each folder's scan is of; else as its record or journal "
        "says.",
        metavar="1,2,1,...",
    ),
    tolerance_um: float | None = opt("Judge all prints anew by this RMS limit.", min=0.1),
    diameter_tolerance_percent: float | None = opt(
        "Judge all prints anew by this limit, and tell the capability (Cp, Cpk).", min=0.1
    ),
    pdf: PdfFlag = False,
    as_json: JsonFlag = False,
) -> None:
    """Hold several prints of one design against each other: what repeats, varies, drifts.

    Exit code 0 whatever the verdicts are; 1 when the registrations can't be compared.
    """
    named = _named(len(folders), repeatability, prints, operators, parts)
    anew = _judged(tolerance_um, diameter_tolerance_percent)
    scans = read_folders(folders, named, anew)
    comparison = compare(scans, diameter_tolerance_percent, repeatability)
    files = _Files(out, comparison, _title(folders), _judged_note(anew))
    data = files.write(pdf)
    if as_json:
        print_json(data)
    else:
        print_lines(*verdict(comparison)["reasons"], *data["notes"], *files.pages(pdf))


@dataclass(frozen=True)
class _Files:
    """Files of a comparison: their folder, what they show, their title and notes."""

    out: Path
    found: Comparison
    title: str
    notes: list[str]

    def write(self, pdf: bool) -> dict[str, Any]:
        """Write all files; return the numbers."""
        data = comparison_dict(self.found)
        data["notes"] = [*self.notes, *data["notes"]]
        self.out.mkdir(parents=True, exist_ok=True)
        write_text(self.out / JSON, json.dumps(data, indent=1, allow_nan=False) + "\n")
        write_text(self.out / CSV, comparison_csv(self.found))
        if self.found.gauge is not None:
            write_text(self.out / GAUGE_CSV, gauge_csv(self.found.gauge))
        self._draw(pdf)
        return data

    def _draw(self, pdf: bool) -> None:
        drawn = comparison_figures(self.found)
        write_comparison_html(self.out / HTML, self.found, self.title, self.notes, drawn)
        if pdf:
            print_page(self.out / HTML, self.out / PDF)

    def pages(self, pdf: bool) -> list[str]:
        """Return the paths of the pages."""
        return [str(self.out / name) for name in (HTML, *([PDF] if pdf else []))]


def _named(
    count: int, repeatability: bool, prints: str | None, operators: str | None, parts: str | None
) -> PrintNames:
    if not repeatability and (operators or parts):
        raise UsageError("--operators and --parts describe a gauge study; add --repeatability")
    given = ((prints, "--prints"), (operators, "--operators"), (parts, "--parts"))
    return PrintNames(*(_names(text, option, count) for text, option in given))


def _names(text: str | None, option: str, count: int) -> list[str] | None:
    if text is None:
        return None
    names = [name.strip() for name in text.split(",")]
    if len(names) != count or not all(names):
        raise UsageError(
            f"{option} {text!r} names {len(names)} {option[2:]} for {count} folders; give one name "
            "for each folder, in their order, like A,A,B"
        )
    return names


def _judged(tolerance_um: float | None, percent: float | None) -> NewLimits | None:
    if tolerance_um is None and percent is None:
        return None
    return NewLimits(tolerance_um or 100.0, percent or 10.0)


def _judged_note(judged: NewLimits | None) -> list[str]:
    if judged is None:
        return []
    return [
        f"All prints are judged anew: RMS deviation at most {judged.tolerance_um:g} µm, diameters "
        f"within ±{judged.diameter_percent:g} %."
    ]


def _title(folders: list[Path]) -> str:
    names = [folder.resolve().name for folder in folders]
    return f"{names[0]} to {names[-1]}"
