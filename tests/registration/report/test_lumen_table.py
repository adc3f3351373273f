"""Report table of predicted lumen openings."""

from __future__ import annotations

from registration.report.sections import lumen_table

ROW = {
    "lumen": "5",
    "designed_mm": 0.4,
    "narrowest_mm": 0.391,
    "at_mm": [1.0, 2.0, 3.456],
    "layer": 12,
    "diameter_error_median_um": -4.2,
    "conductance": 0.973,
    "stepped": {"narrowest_mm": 0.388, "conductance": 0.969},
}


def test_a_lumens_row_shows_both_sets_of_lines() -> None:
    table = lumen_table({"lumens": [ROW]})
    assert table is not None
    texts = [cell.text for cell in table.rows[0].cells]
    assert texts[:4] == ["5", "0.400", "0.391", "0.388"]
    assert texts[5:7] == ["97.30", "96.90"]
    assert texts[-2] == "13"
    assert texts[-1] == "1.00, 2.00, 3.46"


def test_a_print_without_the_report_has_no_table() -> None:
    assert lumen_table({}) is None
    assert lumen_table({"checked": False}) is None
