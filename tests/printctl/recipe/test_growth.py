"""Recipe section on tree growth: invalid values refused with key and remedy."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from printctl.errors import RecipeError
from printctl.recipe import Recipe, parse_recipe
from printctl.recipe.growth import GrownNetwork

ROOT = Path(__file__).parents[3]


def recipe_of(**keys: Any) -> Recipe:
    data = yaml.safe_load((ROOT / "examples" / "planar_fresh.yaml").read_text())
    data["vasculature"] = {"grow": "tree", **keys}
    return parse_recipe(data, "test.yaml")


def grown(**keys: Any) -> GrownNetwork:
    part = recipe_of(**keys).vasculature
    assert isinstance(part, GrownNetwork)
    return part


def test_all_that_growth_knows_can_be_said() -> None:
    part = grown(
        terminal_flow="demand",
        viscosity_law="pries_1994",
        haematocrit=0.4,
        branch_angle_degrees=[30, 140],
        turn_angle_degrees=[0, 80],
        flow_ratio=0.05,
        length_to_radius=2,
        penalty={"depth_mm": [0, 1], "factor": [3, 1]},
        root="search",
        root_candidates=8,
        stages=[{"terminals": 50, "clearance_mm": 0.3}, {"terminals": 800}],
    )
    assert part.stages[0].clearance_mm == 0.3
    assert part.files() == []
    named = grown(terminal_points="wells.csv", trunk="artery.swc")
    assert named.files() == ["wells.csv", "artery.swc"]


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"terminals": 9, "inlets": "every"}, r"inlets.*each_part"),
        ({"terminals": 9, "inlets": [{"at_mm": [1, 2]}]}, r"inlets.*at_mm"),
        (
            {"terminals": 9, "inlets": "each_part", "printable": True},
            r"inlets don't go with printable",
        ),
        (
            {"terminals": 9, "inlets": [{"at_mm": [1, 2, 3]}], "root_mm": [1, 2, 3]},
            r"remove root_mm",
        ),
        ({}, r"how many terminals isn't said; add terminals"),
        ({"terminals": 9, "terminal_points": "a.csv"}, r"terminals and terminal_points each say"),
        ({"terminals": 9, "stages": [{"terminals": 9}]}, r"terminals and stages each say"),
        ({"stages": [{"terminals": 9}, {"terminals": 5}]}, r"stages reach \[9, 5\].*ascend"),
        ({"stages": [{"terminals": 9, "seed": 1}]}, r"stages.0.seed.*remove it"),
        ({"terminals": 9, "branch_angle_degrees": [90, 30]}, r"branch_angle_degrees \[90, 30\]"),
        ({"terminals": 9, "turn_angle_degrees": [0, 200]}, r"turn_angle_degrees.*180.*200"),
        ({"terminals": 9, "flow_ratio": 0.7}, r"flow_ratio.*0\.5.*0\.7"),
        ({"terminals": 9, "terminal_flow": "fair"}, r"terminal_flow.*'equal' or 'demand'.*fair"),
        ({"terminals": 9, "viscosity_law": "carreau"}, r"viscosity_law.*pries_1994.*carreau"),
        (
            {"terminals": 9, "penalty": {"depth_mm": [0, 1], "factor": [1]}},
            r"penalty: 2 depths but 1 factors",
        ),
        (
            {"terminals": 9, "penalty": {"depth_mm": [1, 0], "factor": [1, 2]}},
            r"doesn't ascend; sort",
        ),
        ({"terminals": 9, "root": "search", "root_mm": [0, 0, 0]}, r"without root_mm"),
        ({"terminals": 9, "root": "here"}, r"root: .*'search'.*here"),
        ({"terminals": 9, "trunk": "a.csv"}, r"trunk a\.csv.*give trunk_unit"),
        ({"terminals": 9, "trunk": "a.json", "trunk_unit": "mm"}, r"remove trunk_unit"),
        ({"terminals": 9, "trunk": "a.stl"}, r"trunk a\.stl isn't a \.csv"),
        ({"terminals": 9, "polish": True}, r"vasculature\.polish.*remove it"),
        (
            {"stages": [{"terminals": 9}], "printable": True},
            r"printable doesn't go with stages yet",
        ),
    ],
)
def test_wrong_growth_names_place_value_and_remedy(keys: dict[str, Any], message: str) -> None:
    with pytest.raises(RecipeError, match=message):
        recipe_of(**keys)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"network": "a.csv"}, r"a\.csv: .*give unit"),
        ({"network": "a.vtp"}, r"a\.vtp: .*give unit"),
        ({"network": "a.txt", "unit": "cm"}, r"a\.txt: .*remove unit"),
        ({"network": "a.stl", "unit": "mm"}, r"a\.stl isn't a \.csv"),
    ],
)
def test_a_given_network_says_its_unit_where_its_file_doesnt(
    given: dict[str, str], message: str
) -> None:
    data = yaml.safe_load((ROOT / "examples" / "planar_fresh.yaml").read_text())
    data["vasculature"] = given
    with pytest.raises(RecipeError, match=message):
        parse_recipe(data, "test.yaml")
    data["vasculature"] = {"network": "a.json"}
    assert parse_recipe(data, "test.yaml").vasculature.files() == ["a.json"]
