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
from printctl.pipeline.heads import vessel_heads
from printctl.pipeline.run import toolpath_recipe
from printctl.recipe import parse_recipe
from printctl.recipe.making import HeadPart

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


def test_a_vessel_that_nobody_writes_is_refused() -> None:
    with pytest.raises(UsageError, match="vessel 2 \\(connection, tree 2\\) is written by no head"):
        heads({"kinds": ["artery"]}, {"kinds": ["vein"]})


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


def test_the_shipped_example_names_two() -> None:
    recipe = parse_recipe(GOOD, "ring_two_inks.yaml")
    assert [head.kinds for head in recipe.printer.heads] == [("artery", "connection"), ("vein",)]


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


def test_a_profile_with_another_count_of_heads_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"names 2, and Generic Marlin 2\.1 bioprinter has 1"):
        whole(tmp_path, profile="generic_marlin")


def test_heads_that_stay_in_the_bath_are_refused(tmp_path: Path) -> None:
    data = load(Printer, "two_syringe_marlin").model_dump(mode="json", exclude_unset=True)
    for head in data["heads"]:
        for key in ("raised_mm", "raises", "lowers", "moving_s"):
            head.pop(key)
    (tmp_path / "fixed.yaml").write_text(yaml.safe_dump(data))
    with pytest.raises(SafetyError, match="drag through gel"):
        whole(tmp_path, profile=str(tmp_path / "fixed.yaml"), bath_depth_mm=6.0)
