"""Read registrations of several prints from folders; write what their comparison finds.

Goes in: folders. Comes out: registrations as `registration.comparison` takes them, and its files.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from design.files import write_text
from printctl.errors import UsageError
from printctl.machine.records.folders import print_identity
from printctl.pipeline.judging.verdict import verdict
from printctl.run_folder.artefacts import JOURNAL_FOLDER, NUMBERS
from printctl.run_folder.artefacts import JSON as REPORT
from registration.comparison import (
    Comparison,
    GaugedScan,
    Origin,
    comparison_csv,
    comparison_dict,
    gauge_csv,
    gauged_scan,
)
from registration.json_ready import Verdict
from registration.measuring.judging import judge_plain
from report.pages.comparison import comparison_figures, write_comparison_html
from report.print_page import print_page


@dataclass(frozen=True)
class NewLimits:
    """Limits by which all prints are judged anew.

    Attributes
    ----------
    tolerance_um : float, µm
    diameter_percent : float, %
    """

    tolerance_um: float
    diameter_percent: float

    def note(self) -> str:
        """For the report."""
        return (
            f"All prints are judged anew: RMS deviation at most {self.tolerance_um:g} µm, "
            f"diameters within ±{self.diameter_percent:g} %."
        )


@dataclass(frozen=True)
class PrintNames:
    """What the folders are, by any names; None: as journals and records say.

    Attributes
    ----------
    prints, operators, parts : sequence of str or None
        One a folder: the print that it is a scan of, who scanned, and which part of a gauge study
        was scanned. `parts` stand for `prints` where those aren't given.
    """

    prints: Sequence[str] | None = None
    operators: Sequence[str] | None = None
    parts: Sequence[str] | None = None

    def of(self, number: int) -> dict[str, str | None]:
        """Names of one folder."""
        given = {"print": self.prints or self.parts, "operator": self.operators, "part": self.parts}
        return {name: None if each is None else each[number] for name, each in given.items()}


def read_folders(
    folders: Sequence[Path], named: PrintNames, judged: NewLimits | None
) -> list[GaugedScan]:
    """Read the registrations of several folders.

    Parameters
    ----------
    folders : sequence of Path
        Run folders, or those of `printctl register`.
    named : PrintNames
    judged : NewLimits or None
        None: the verdicts stand that were given.

    Raises
    ------
    UsageError
        For a folder that isn't one of these, or is named twice.
    ComparisonError
        For a registration that is broken.
    """
    places = [folder.resolve() for folder in folders]
    twice = [str(f) for f, place in zip(folders, places, strict=True) if places.count(place) > 1]
    if twice:
        raise UsageError(f"{twice[0]} is named twice; name each registration once")
    names = [folder.resolve().name for folder in folders]
    labels = [
        name if names.count(name) == 1 else str(folder)
        for folder, name in zip(folders, names, strict=True)
    ]
    return [
        _read(folder, label, named.of(k), judged)
        for k, (folder, label) in enumerate(zip(folders, labels, strict=True))
    ]


def _read(
    folder: Path, label: str, named: dict[str, str | None], judged: NewLimits | None
) -> GaugedScan:
    whole = _load(folder)
    own = "registration" in whole
    numbers = whole["registration"] if own else whole
    if not isinstance(numbers, dict) or "vessels" not in numbers:
        raise UsageError(
            f"{folder / NUMBERS} holds no registration; run it, or register the scan, again"
        )
    made = whole.get("printed") if own else print_identity(folder / JOURNAL_FOLDER)
    its_verdict = whole.get("verdict") if own else _report_verdict(folder)
    if judged is not None:
        its_verdict = _judged(numbers, judged, folder)
    made, its_verdict, record = made or {}, its_verdict or {}, _record(numbers)
    part = named["part"] or record.get("part")
    origin = Origin(
        label=label,
        design=_design(numbers, folder),
        print_id=named["print"] or made.get("id") or part or str(folder.resolve()),
        started=made.get("started"),
        passed=its_verdict.get("passed"),
        undecided=its_verdict.get("undecided") is True,
        reasons=tuple(its_verdict.get("reasons", ())),
        operator=named["operator"] or record.get("operator"),
        part=part,
    )
    return gauged_scan(numbers, origin)


def _record(numbers: dict[str, Any]) -> dict[str, Any]:
    """Return the measurement record; empty where none was given."""
    record = numbers.get("record")
    return record if isinstance(record, dict) else {}


def _judged(numbers: dict[str, Any], judged: NewLimits, folder: Path) -> Verdict:
    try:
        numbers |= judge_plain(numbers, judged.tolerance_um, judged.diameter_percent)
        return verdict(numbers)
    except (KeyError, TypeError) as exc:
        raise UsageError(
            f"{folder / NUMBERS} can't be judged anew ({type(exc).__name__}: {exc}); register the "
            "scan again"
        ) from exc


def _load(folder: Path) -> dict[str, Any]:
    path = folder / NUMBERS
    if not folder.is_dir():
        raise UsageError(
            f"{folder} isn't a folder; name a run's, or one that `printctl register` wrote"
        )
    if not path.is_file():
        raise UsageError(
            f"{folder} has no {NUMBERS}: it is neither a run that came as far as its registration "
            "nor a folder of `printctl register`"
        )
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as exc:
        raise UsageError(f"{path} can't be read ({exc}); register the scan again") from exc
    if not isinstance(data, dict):
        raise UsageError(f"{path} holds no registration; register the scan again")
    return data


def _design(numbers: dict[str, Any], folder: Path) -> str:
    design = numbers.get("design")
    if not isinstance(design, dict) or not isinstance(design.get("network_sha256"), str):
        raise UsageError(
            f"{folder / NUMBERS} doesn't say which design it was held against (an older version "
            "wrote it); run it, or register the scan, again"
        )
    return str(design["network_sha256"])


def _report_verdict(folder: Path) -> dict[str, Any] | None:
    """Of a whole run; None where it has none that can be read."""
    try:
        judged = json.loads((folder / REPORT).read_text(encoding="utf-8"))["verdict"]
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return judged if isinstance(judged, dict) else None


def write_comparison(
    folder: Path, found: Comparison, title: str, judged: NewLimits | None, *, pdf: bool = False
) -> tuple[dict[str, Any], list[Path]]:
    """Write compare.json, compare.csv, gauge.csv of a study, and the page; return data and pages.

    Parameters
    ----------
    judged : NewLimits or None
        By which the verdicts are, if they aren't those that were given.
    pdf : bool
        Print the page to a PDF, too.
    """
    notes = [] if judged is None else [judged.note()]
    data = comparison_dict(found)
    data["notes"] = [*notes, *data["notes"]]
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / "compare.json", json.dumps(data, indent=1, allow_nan=False) + "\n")
    write_text(folder / "compare.csv", comparison_csv(found))
    if found.gauge is not None:
        write_text(folder / "gauge.csv", gauge_csv(found.gauge))
    page = folder / "compare.html"
    write_comparison_html(page, found, title, notes, comparison_figures(found))
    if not pdf:
        return data, [page]
    print_page(page, folder / "compare.pdf")
    return data, [page, folder / "compare.pdf"]
