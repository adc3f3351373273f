"""Collect the summaries of a run's finished stages, with timings and provenance."""

from __future__ import annotations

from typing import Any

from design.hemodynamics import read_flow_csv
from printctl.analysis.flow import TABLE
from printctl.pipeline.context import RunContext
from printctl.pipeline.stages.measures import key_numbers

_SECTIONS = {
    "tissue": "tissue",
    "vasculature": "network",
    "flow": "flow",
    "fidelities": "fidelities",
    "measures": "measures",
    "oxygen": "oxygen",
    "solid": "solid",
    "toolpath": "toolpath",
    "dry run": "dry_run",
    "lumens": "lumens",
    "print": "print",
    "scan": "scan",
    "registration": "registration",
}
"""Stage to section of the report."""


def collect(context: RunContext) -> dict[str, Any]:
    """Collect the results of the finished stages, with timings and provenance."""
    records = context.manifest.stages
    data: dict[str, Any] = {"schema": 1, "recipe": context.recipe.name}
    for stage, section in _SECTIONS.items():
        if stage in records:
            data[section] = records[stage].summary
    table = context.folder / TABLE
    if "flow" in data and table.is_file():  # not in the manifest, which is read by every command
        data["flow"] = {**data["flow"], "vessels": read_flow_csv(table)}
    if "measures" in data:
        data["tissue"] = {**data["tissue"], **key_numbers(data["measures"])}
    data["timings"] = {
        stage: {
            "seconds": record.seconds,
            "peak_mb": record.peak_mb,
            "reused": stage in context.reused,
        }
        for stage, record in records.items()
    }
    data["provenance"] = context.manifest.facts
    return data
