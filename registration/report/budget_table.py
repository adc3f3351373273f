"""Report table of uncertainty budgets: each quantity's main terms and its 95 % interval."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from registration.report.sections import records
from registration.report.tables import Column, Table, make_table
from registration.report.wording import is_number, number

LEAST_SHARE = 0.01
"""Of the variance; smaller terms stand in registration.json alone."""
COLUMNS = (
    Column("quantity", "Quantity", kind="text"),
    Column("term", "Term", kind="text"),
    Column("type", "Type", kind="text"),
    Column("standard", "Standard uncertainty", kind="text"),
    Column("dof", "Degrees of freedom", kind="text"),
    Column("share", "Share of variance", kind="text"),
    Column("remark", "Rests on, or is made less by", kind="text"),
)


def budget_table(registration: Mapping[str, Any]) -> Table | None:
    """Return every budget's terms and its 95 % interval; None without budgets."""
    rows = [row for budget in records(registration, "budget") for row in _rows(budget)]
    return make_table("budget", rows, COLUMNS, order="by quantity") if rows else None


def _rows(budget: Mapping[str, Any]) -> list[dict[str, Any]]:
    unit = "µm" if budget["unit"] == "um" else budget["unit"]
    name = str(budget["quantity"]).replace("_", " ")
    rows = [
        {
            "quantity": name,
            "term": term["term"],
            "type": term["type"],
            "standard": f"{number(term['standard'], 3)} {unit}",
            "dof": _freedom(term["dof"]),
            "share": f"{100 * term['share']:.0f} %",
            "remark": term["note"],
        }
        for term in budget["terms"]
        if (term["share"] or 0.0) >= LEAST_SHARE
    ]
    half = f"± {number(budget['interval_95'], 3)} {unit}"
    total = {"term": "95 % interval", "type": "", "standard": half, "share": ""}
    return [
        *rows,
        {
            "quantity": name,
            **total,
            "dof": _freedom(budget["dof"]),
            "remark": f"most is gained by: {budget['reduce']}",
        },
    ]


def _freedom(value: Any) -> str:
    return number(value, 2) if is_number(value) else "∞"
