"""Print time against cell lifetime, and ink use, on a complete simulated job."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from design.network_files.csv_format import write_network_csv
from printctl.errors import SafetyError
from printctl.pipeline.run import toolpath_recipe
from printctl.recipe import parse_recipe
from tests.printctl.corrections.feedback.small_run import TWO, recipe_of


def dry_run(folder: Path, **care: Any) -> dict[str, Any]:
    write_network_csv(folder / "two.csv", TWO)
    recipe = recipe_of(needle="22g", layer_um=150, line_um=400) | {"printer": {"care": care}}
    found = toolpath_recipe(
        parse_recipe(recipe, "test"), folder, folder, Console(file=io.StringIO())
    )
    summary: dict[str, Any] = found["dry_run"]
    return summary


SAID = {"viability_source": "our protocol"}
REFUSED = r"print time, of what the cells have.*our protocol"


def test_a_print_longer_than_its_cells_have_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SafetyError, match=REFUSED):
        dry_run(tmp_path, viability_min=0.5, **SAID)


@pytest.mark.slow
def test_a_print_as_long_as_half_its_cells_time_is_taken_as_long_as_twice_refused(
    tmp_path: Path,
) -> None:
    long = dry_run(tmp_path, viability_min=1000, **SAID)
    assert long["time_the_cells_have"] == "1000 min (our protocol)"
    minutes = long["print_time_s"] / 60
    assert long["changes_of_syringe"] == 0
    assert minutes > 0.5
    dry_run(tmp_path, viability_min=2 * minutes, **SAID)
    with pytest.raises(SafetyError, match=REFUSED):
        dry_run(tmp_path, viability_min=minutes / 2, **SAID)


@pytest.mark.slow
def test_ink_is_told_with_what_stays_behind(tmp_path: Path) -> None:
    found = dry_run(tmp_path)
    assert "not known" in found["time_the_cells_have"]
    # 20 µL of the syringe, and the bore of a 22G needle of half an inch.
    assert found["ink_left_per_filling_ul"] == pytest.approx(21.68, abs=0.01)
    assert found["ink_needed_ul"] == pytest.approx(
        found["ink_pushed_ul"] + found["ink_left_per_filling_ul"], abs=2e-3
    )
    assert found["fillings"] == 1
