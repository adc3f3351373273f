"""Report text on uncertainty budgets and the pressure ratio."""

from __future__ import annotations

import math

from registration.alignment.uncertainty import Budget, Term, quantity
from registration.report.gauging_sections import pressure_words
from registration.report.measurement_tables import budget_table


def test_a_budgets_rows_name_the_largest_terms_remedy() -> None:
    budget = Budget(
        (
            Term("refractive index", "B", 0.01, math.inf, "depth"),
            Term("speckle", "A", 0.002, 20.0, "patches"),
            Term("voxel size", "B", 0.0001, math.inf, "as stated"),
        )
    )
    row = quantity("scale_z", "%", budget, 100.0)
    assert [term["term"] for term in row["terms"]] == ["refractive index", "speckle", "voxel size"]
    assert "depth standard" in row["reduce"]
    table = budget_table({"budget": [row]})
    assert table is not None
    assert len(table.rows) == 3  # terms of a percent and more, and their sum
    assert budget_table({}) is None


def test_a_pressure_ratio_stands_with_its_interval() -> None:
    flow = {"pressure_ratio": 1.063, "pressure_ratio_interval_95": [0.98, 1.154]}
    assert pressure_words(flow) == "1.06 [0.98, 1.15]"
    unknown = {"pressure_ratio": 1.063, "pressure_ratio_interval_95": [None, None]}
    assert pressure_words(unknown) == "1.06 (interval not known)"
