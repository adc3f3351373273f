"""Several heads in a recipe: their contents, and the vessels they write."""

from __future__ import annotations

from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from rich.console import Console

from design.network import VesselKind, VesselNetwork
from design.network_files.csv_format import write_network_csv
from firmware_profiles import Printer, load
from printctl.errors import RecipeError, SafetyError, UsageError
from printctl.pipeline.heads import layer_lines_um, vessel_heads
from printctl.pipeline.run import toolpath_recipe
from printctl.recipe import parse_recipe
from printctl.recipe.heads import HeadPart
from printctl.recipe.making import Fresh

ROOT = Path(__file__).parents[3]
GOOD = yaml.safe_load((ROOT / "examples" / "ring_two_inks.yaml").read_text())
KIND = np.array([VesselKind.ARTERY, VesselKind.VEIN, VesselKind.CONNECTION], dtype=np.int64)
NETWORK = VesselNetwork.from_segments(
    np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]]),
    np.array([[0, 1], [1, 2], [2, 3]]),
    np.full(3, 0.2),
    KIND,
    np.array([0, 1, 2]),
)


def heads(*said: dict[str, Any]) -> list[int]:
    found = vessel_heads(NETWORK, [HeadPart(**one) for one in said])
    return [int(head) for head in found]


def test_vessels_go_to_heads_by_kind_by_tree_and_by_what_is_left() -> None:
    assert heads({"kinds": ["artery", "connection"]}, {"kinds": ["vein"]}) == [0, 1, 0]
    assert heads({}, {"kinds": ["vein"]}) == [0, 1, 0]
    assert heads({"trees": [2]}, {}) == [1, 1, 0]
    assert heads({"kinds": ["artery"]}, {"trees": [0], "kinds": ["vein", "connection"]}) == [
        1,
        1,
        1,
    ]
    assert heads() == [0, 0, 0]
    assert heads({}, {}) == [0, 0, 0]


def with_heads(*said: dict[str, Any], **printer: Any) -> dict[str, Any]:
    data = deepcopy(GOOD)
    data["printer"] |= {"heads": list(said), **printer}
    return data


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (with_heads({"kinds": ["vein"]}, {"kinds": ["vein"]}), "kinds vein is given to two"),
        (with_heads({"trees": [1]}, {"trees": [1]}), "trees 1 is given to two"),
        (with_heads({"kinds": ["vein"]}, {}, {}), "only one can write the rest"),
        (with_heads({}, {}, ink="collagen_fresh"), "say it in heads alone"),
        (with_heads({"kinds": ["hose"]}, {}), "kinds"),
    ],
)
def test_heads_that_contradict_each_other_are_refused(data: dict[str, Any], words: str) -> None:
    with pytest.raises(RecipeError, match=words):
        parse_recipe(data, "test.yaml")


def whole(folder: Path, **printer: Any) -> dict[str, Any]:
    """An artery and a vein side by side, as far as the dry run."""
    write_network_csv(folder / "two.csv", BESIDE)
    data = {
        "schema": 1,
        "name": "two_inks",
        "tissue": {"shape": "block", "size_mm": [10, 6, 4]},
        "vasculature": {"network": "two.csv", "unit": "mm"},
        "toolpath": {"method": "embedded", "needle": "30g"},
        "printer": {
            "profile": "two_syringe_marlin",
            "bath": "cell_matrix",
            "dish": "petri_60mm",
            "heads": [
                {"ink": "gelatin_sacrificial", "kinds": ["artery"]},
                {"syringe": "hamilton_2_5ml", "ink": "gelatin_sacrificial", "kinds": ["vein"]},
            ],
            **printer,
        },
    }
    recipe = parse_recipe(data, "two.yaml")
    return toolpath_recipe(recipe, folder, folder / "run", Console(quiet=True))


BESIDE = VesselNetwork.from_segments(
    np.array([[1.0, 2, 2], [9, 2, 2], [1, 4, 2], [9, 4, 2]]),
    np.array([[0, 1], [2, 3]]),
    np.full(2, 0.2),
    np.array([VesselKind.ARTERY, VesselKind.VEIN], dtype=np.int64),
    np.array([0, 1]),
)


def test_two_inks_are_planned_written_and_checked(tmp_path: Path) -> None:
    found = whole(tmp_path, bath_depth_mm=6.0)
    text = (tmp_path / "run" / "part.gcode").read_text()
    assert text.count("\nT1 S1\n") == 1
    names = [check["check"] for check in found["dry_run"]["checks"]]
    assert "head 1 (right): needle to the dish's wall" in names
    assert "lowest tip that doesn't write, above the bath's surface" in names
    pushed = [one["ink_pushed_ul"] for one in found["dry_run"]["ink_of_heads"]]
    assert pushed == pytest.approx([np.pi * 0.04 * 8] * 2, rel=0.05)
    assert found["lumens"]["passed"]


def test_heads_that_stay_in_the_bath_are_refused(tmp_path: Path) -> None:
    data = load(Printer, "two_syringe_marlin").model_dump(mode="json", exclude_unset=True)
    for head in data["heads"]:
        for key in ("raised_mm", "raises", "lowers", "moving_s"):
            head.pop(key)
    (tmp_path / "fixed.yaml").write_text(yaml.safe_dump(data))
    with pytest.raises(SafetyError, match="drag through gel"):
        whole(tmp_path, profile=str(tmp_path / "fixed.yaml"), bath_depth_mm=6.0)


# --- fRESH layers in two inks, from recipe to checked G-code
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


def lines(regions: list[dict[str, Any]], *heads: dict[str, Any], count: int = 2) -> list[float]:
    part = Fresh.model_validate({"method": "fresh", "regions": regions})
    return layer_lines_um(part, [HeadPart(**one) for one in heads], count)


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
