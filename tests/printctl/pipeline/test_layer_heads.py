"""FRESH layers in two inks, from recipe to checked G-code."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from rich.console import Console

from design.network import VesselNetwork
from design.network_files.csv_format import write_network_csv
from firmware_profiles import Printer, load
from printctl.errors import RecipeError, UsageError
from printctl.pipeline.heads import layer_lines_um
from printctl.pipeline.run import toolpath_recipe
from printctl.recipe import parse_recipe
from printctl.recipe.making import Fresh, HeadPart
from sim.gcode.dry_run.run import dry_run

ROOT = Path(__file__).parents[3]
SIZE_MM = (6.0, 4.0, 1.5)
WHOLE_UL = 6.0 * (4.0 * 1.5 - np.pi * 0.25**2)
CREST = 0.06 * (1 - np.pi / 4) / 2
"""How far a line's round side stands beyond that of the rectangle of its area, mm."""
WRITTEN_UL = WHOLE_UL - CREST * (2 * (6.0 + 4.0) * 1.5 + 2 * 6.0 * 0.5)
"""Without the notches between the lines' crests along the part's sides and its lumen's."""
LEVELS = 0.06 * (np.arange(25) + 0.5) - 0.75
RING = 0.06 * 2 * np.sqrt(np.maximum(0.65**2 - LEVELS**2, 0.0)).sum() - np.pi * 0.25**2
"""Area of what lies within 0.4 mm of the lumen, as layers cut it, mm²."""
ROUND_UL = 6.0 * RING - CREST * (2 * 6.0 * 0.5 + 2 * RING)
NONE = np.zeros(1, dtype=np.int64)
TUBE = VesselNetwork.from_segments(
    np.array([[0.0, 2, 0.75], [6, 2, 0.75]]), np.array([[0, 1]]), np.array([0.25]), NONE, NONE
)
HALF = {"where": {"shape": "block", "from_mm": [3, -1, -1], "to_mm": [7, 5, 3]}, "head": 1}
HEADS = [{"ink": "collagen_fresh"}, {"syringe": "hamilton_2_5ml", "ink": "collagen_fresh"}]


def recipe(regions: list[dict[str, Any]], heads: list[dict[str, Any]]) -> dict[str, Any]:
    return {
        "schema": 1,
        "name": "two_inks",
        "tissue": {"shape": "block", "size_mm": list(SIZE_MM)},
        "vasculature": {"network": "tube.csv", "unit": "mm"},
        "toolpath": {"method": "fresh", "needle": "fresh_150um", "regions": regions},
        "printer": {
            "profile": "two_syringe_marlin",
            "bath": "gelatin_support",
            "dish": "petri_60mm",
            "bath_depth_mm": 6.0,
            "heads": heads,
        },
    }


def planned(folder: Path, regions: list[dict[str, Any]], name: str = "run") -> dict[str, Any]:
    write_network_csv(folder / "tube.csv", TUBE)
    made = parse_recipe(recipe(regions, HEADS), "two.yaml")
    return toolpath_recipe(made, folder, folder / name, Console(quiet=True))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("region", "second_ul"),
    [(HALF, WRITTEN_UL / 2), ({"around_vessels_mm": 0.4, "head": 1}, ROUND_UL)],
)
def test_two_inks_pass_the_checks_and_leave_the_lumen_as_open_as_one(
    tmp_path: Path, region: dict[str, Any], second_ul: float
) -> None:
    one, two = planned(tmp_path, [], "one"), planned(tmp_path, [region], "two")
    assert 20 <= two["toolpath"]["plan"]["changes"] <= 25  # at most one for each layer
    each = two["toolpath"]["plan"]["written_ul_of_heads"]
    assert each == pytest.approx([WRITTEN_UL - second_ul, second_ul], rel=0.01)
    pushed = [head["ink_pushed_ul"] for head in two["dry_run"]["ink_of_heads"]]
    assert pushed == pytest.approx(each, rel=0.01)
    lumen = [found["lumens"]["lumens"][0] for found in (one, two)]
    for size in ("narrowest_mm", "mean_mm"):
        assert lumen[1][size] == pytest.approx(lumen[0][size], abs=5e-3)
    assert two["lumens"]["passed"]


@pytest.mark.slow
def test_written_text_holds_each_head_on_its_own_side(tmp_path: Path) -> None:
    planned(tmp_path, [HALF])
    printer = load(Printer, "two_syringe_marlin")
    run = dry_run((tmp_path / "run" / "part.gcode").read_bytes(), printer, (0.0, 0.0, 0.0))
    reach = []
    for number in range(2):
        program = run.of_head(number).program
        wrote = np.flatnonzero(
            (program.pushed > 0) & (np.diff(program.target[:, 0], prepend=0) != 0)
        )
        ends = np.concatenate([program.target[wrote - 1, 0], program.target[wrote, 0]])
        reach.append((ends.min(), ends.max()))
    (_, left), (right, _) = reach
    # Half a line on either side of the border, by the true places of both tips, but for the crests
    # of their round sides: these pass the border.
    assert right - left == pytest.approx(0.15 - 2 * CREST, abs=2e-3)


def lines(regions: list[dict[str, Any]], *heads: dict[str, Any], count: int = 2) -> list[float]:
    part = Fresh.model_validate({"method": "fresh", "regions": regions})
    return layer_lines_um(part, [HeadPart(**one) for one in heads], count)


def test_a_head_writes_lines_of_the_width_that_its_regions_say() -> None:
    assert lines([HALF]) == [150, 150]
    assert lines([HALF | {"line_um": 200}, HALF, {"around_vessels_mm": 0.3}]) == [150, 200]


@pytest.mark.parametrize(
    ("regions", "heads", "count", "words"),
    [
        ([HALF], [], 1, r"regions\.0: head is 1, and the printer has 1"),
        ([HALF | {"line_um": 200}, HALF | {"line_um": 300}], [], 2, "lines of one width"),
        ([HALF], [{"kinds": ["artery"]}, {}], 2, r"heads\.0 names kinds or trees"),
    ],
)
def test_heads_that_can_t_write_layers_so_are_refused(
    regions: list[dict[str, Any]], heads: list[dict[str, Any]], count: int, words: str
) -> None:
    with pytest.raises(UsageError, match=words):
        lines(regions, *heads, count=count)


def test_line_width_without_a_head_is_refused() -> None:
    data = recipe([{"around_vessels_mm": 0.3, "line_um": 200}], HEADS)
    with pytest.raises(RecipeError, match="no head is named that writes such lines"):
        parse_recipe(data, "two.yaml")


def test_the_shipped_example_gives_the_vessels_their_own_ink() -> None:
    data = yaml.safe_load((ROOT / "examples" / "planar_two_inks.yaml").read_text())
    found = parse_recipe(data, "planar_two_inks.yaml")
    assert isinstance(found.toolpath, Fresh)
    assert [region.head for region in found.toolpath.regions] == [1]
    assert layer_lines_um(found.toolpath, found.printer.heads, 2) == [150, 150]
