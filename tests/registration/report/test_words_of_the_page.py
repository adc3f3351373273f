"""Report wording: findings, numbers file, picture captions."""

from __future__ import annotations

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from registration.report import finding_figures
from registration.report.gauging_sections import defect_table
from registration.report.page import report_html
from registration.report.wording import MISSING as NOT_KNOWN

MISSING = {"kind": "missing", "vessel": 3, "from_mm": 0.2, "to_mm": 8.9, "at_mm": 4.5,
           "size_um": 520.0, "error_um": 0.0}  # fmt: skip


def test_the_designed_diameter_of_a_missing_vessel_has_no_interval() -> None:
    leak = MISSING | {"kind": "leak", "size_um": 200.0, "error_um": 12.0}
    table = defect_table({"defects": [MISSING, leak]})
    assert table is not None
    keys = [column.key for column in table.columns]
    size, error = keys.index("size_um"), keys.index("error_um")
    said = [(row.cells[size].text, row.cells[error].text) for row in table.rows]
    assert said == [("520", NOT_KNOWN), ("200", "12.0")]


@pytest.mark.parametrize("name", ["report.json", "registration.json"])
def test_the_page_names_the_file_that_stands_beside_it(name: str) -> None:
    data = {} if name == "report.json" else {"numbers_file": name}
    page = report_html(data, (), None, {})
    assert f"<code>{name}</code> beside it has every number" in page


@pytest.mark.parametrize("ratios", [[1.0, 1.0, 1.0], [2.5, 2.5, 1.0], [5.5, 5.5, 1.0]])
def test_the_last_title_isnt_cut_off(ratios: list[float]) -> None:
    figure, axes = finding_figures._laid_out(ratios)
    vessel = {"along_mm": [12.34], "diameter_um": [1569.0], "interval_95_um": [129.0],
              "designed_along_um": [1520.0]}  # fmt: skip
    title = axes[-1].set_title(finding_figures._measured(vessel, 0), loc="left", fontsize=8.6)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    assert title.get_window_extent().x1 <= figure.bbox.x1
    assert all(0 <= one.get_position().x0 < one.get_position().x1 <= 1 for one in axes)
