"""Collect a plate run's results; write report.html, report.json, wells.csv and plate.svg."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from typing import Any, Final

from design.files import write_bytes, write_text
from printctl.pipeline.running.plate.wells import WELLS, PlateRun
from printctl.pipeline.stages.collect import collect
from printctl.run_folder.artefacts import HTML, JSON, PLATE_PICTURE, PLATE_TABLE
from registration.json_ready import Verdict
from report.pages.plate import plate_figure, write_plate_html

_COLUMNS: Final = (
    "well", "variant", "copy", "x_mm", "y_mm", "first_line", "last_line", "ink_ul", "begins_s",
    "lasts_s", "outcome", "rms_um", "mean_error_percent", "worst_error_percent", "run",
)  # fmt: skip


def collect_plate(run: PlateRun, scans: Mapping[str, dict[str, Any]]) -> dict[str, Any]:
    """Collect the results of the plate's stages and wells; ``scans`` are report.json by well."""
    data = collect(run.whole)
    for context in run.runs.values():
        records = context.manifest.stages
        data["timings"] |= {
            f"{context.title} {stage}": {
                "seconds": record.seconds,
                "peak_mb": record.peak_mb,
                "reused": stage in context.reused,
            }
            for stage, record in records.items()
        }
    data["plate"] = run.standing.plate.model_dump(mode="json") | {
        "middle_mm": list(run.standing.middle_mm),
        "turned_deg": run.standing.turned_deg,
        "bath_depth_mm": run.standing.bath_mm,
    }
    made = data.get("dry_run", {}).get("wells") or [{"well": well.name} for well in run.wells]
    data["wells"] = [_row(run, well, row, scans) for well, row in zip(run.wells, made, strict=True)]
    return data


def _row(
    run: PlateRun, well: Any, made: Mapping[str, Any], scans: Mapping[str, dict[str, Any]]
) -> dict[str, Any]:
    row = {
        "well": well.name,
        "variant": well.variant + 1,
        "label": well.label,
        "values": dict(well.point.values),
        "copy": well.copy,
        "run": run.folder_of(well),
        **made,
    }
    return row | (well_figures(scans[well.name]) if well.name in scans else {})


def well_figures(report: Mapping[str, Any]) -> dict[str, Any]:
    """What a well's own report says, in a few numbers."""
    verdict, numbers = report["verdict"], report["registration"]
    errors = [
        row["error_percent"] for row in numbers["vessels"] if row["error_percent"] is not None
    ]
    return {
        "passed": verdict["passed"],
        "undecided": verdict["undecided"],
        "outcome": _outcome(verdict),
        "reasons": verdict["reasons"],
        "rms_um": numbers["scaled"]["rms_um"],
        "mean_error_percent": sum(errors) / len(errors) if errors else None,
        "worst_error_percent": max(errors, key=abs) if errors else None,
    }


def write_results(run: PlateRun, scans: Mapping[str, dict[str, Any]]) -> dict[str, Any]:
    """Write the whole report; return report.json's content."""
    data = collect_plate(run, scans)
    scanned = [row for row in data["wells"] if row["well"] in scans]
    data["scanned"] = [{**row, "report": f"{WELLS}/{row['well']}/{HTML}"} for row in scanned]
    data["verdict"] = plate_verdict(scanned, len(data["wells"]))
    whole = run.whole
    write_text(whole.folder / JSON, json.dumps(data, indent=1, allow_nan=False) + "\n")
    write_table(run, data["wells"])
    write_plate_html(whole.folder / HTML, data, run.standing.plate)
    return data


def write_table(run: PlateRun, wells: Sequence[Mapping[str, Any]]) -> None:
    """Write wells.csv and plate.svg."""
    text = io.StringIO()
    swept = list(run.part.sweep)
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*_COLUMNS[:2], *swept, *_COLUMNS[2:]])
    for row in wells:
        own = [row["values"].get(key) for key in swept]
        cells = [row.get(name) for name in _COLUMNS]
        writer.writerow([*cells[:2], *own, *cells[2:]])
    write_text(run.whole.folder / PLATE_TABLE, text.getvalue())
    write_bytes(run.whole.folder / PLATE_PICTURE, plate_figure(run.standing.plate, wells))


def plate_verdict(scanned: Sequence[Mapping[str, Any]], wells: int) -> Verdict:
    """Collect the verdicts of the wells that were scanned, of so many; fail before undecided."""
    reasons = [
        f"{row['well']} ({row['label']}) {row['outcome']}: {'; '.join(row['reasons'])}"
        for row in scanned
    ]
    left = wells - len(scanned)
    if left:
        reasons.append(f"{left} of {wells} wells weren't scanned, and aren't judged")
    failed = any(row["outcome"] == "failed" for row in scanned)
    return {
        "passed": all(row["passed"] for row in scanned),
        "undecided": not failed and any(row["undecided"] for row in scanned),
        "reasons": reasons,
    }


def _outcome(verdict: Mapping[str, Any]) -> str:
    if verdict["passed"]:
        return "passed"
    return "undecided" if verdict["undecided"] else "failed"
