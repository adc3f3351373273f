"""Recipe section on tree growth: invalid values refused with key and remedy."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from printctl.errors import RecipeError
from printctl.recipe import Recipe, parse_recipe
from printctl.recipe.growth import GrownNetwork
from printctl.recipe.model import LatticeNetwork
from printctl.recipe.tissue import CylinderPart, DepthDemandPart, MeshPart

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


# --- recipe section on forests: what is implied, and what is refused with a remedy
ARTERY, VEIN, LYMPH = ({"kind": kind} for kind in ("artery", "vein", "lymph"))


def recipe_of_forest(
    networks: list[Any], flow: dict[str, Any] | None = None, **keys: Any
) -> Recipe:
    data = yaml.safe_load((ROOT / "examples" / "planar_fresh.yaml").read_text())
    data["vasculature"] = {"grow": "forest", "terminals": 9, "networks": networks, **keys}
    data["flow"] = flow or {}
    return parse_recipe(data, "test.yaml")


@pytest.mark.parametrize(
    ("networks", "keys", "said"),
    [
        ([{"trees": [LYMPH]}], {}, r"tree 0 of the forest is a lymph without partner.*supplies"),
        ([{"trees": [ARTERY, LYMPH]}], {}, r"trees are artery, lymph; say join"),
        ([{"trees": [ARTERY, VEIN, LYMPH], "join": "loops"}], {}, r"give lymph a network"),
        ([{"trees": [ARTERY, VEIN], "join": "mixing"}], {}, r"mixing takes three trees or more"),
        (
            [{"trees": [ARTERY, VEIN | {"terminals": 5}]}],
            {},
            r"networks\.0 joins 9 arterial terminals to 5 venous",
        ),
        (
            [{"trees": [ARTERY, ARTERY, VEIN | {"terminals": 5}], "join": "mixing"}],
            {},
            r"networks\.0 mixes trees of 9, 9, 5 terminals",
        ),
        ([{"trees": [ARTERY]}], {"root_mm": [0, 0, 0]}, r"each tree of a forest has its root_mm"),
        ([{"network": "old.csv", "unit": "mm"}], {}, r"a forest grows at least one tree"),
        ([{"trees": [ARTERY]}, {"network": "old.csv"}], {}, r"give unit"),
        ([{"trees": [ARTERY | {"trunk": "a.swc", "root_mm": [0, 0, 0]}]}], {}, r"without root_mm"),
        ([{"trees": [ARTERY]}], {"radius_exponent": 9}, r"radius_exponent"),
    ],
)
def test_what_cannot_be_is_refused(networks: list[Any], keys: dict[str, Any], said: str) -> None:
    with pytest.raises(RecipeError, match=said):
        recipe_of_forest(networks, **keys)


# --- recipe section on lattices
BLOCK = {"shape": "block", "size_mm": [16, 8, 8]}


def parsed(**lattice: Any) -> LatticeNetwork:
    part = {"lattice": "grid", "cell_mm": 3.0, "diameter_mm": 0.6, **lattice}
    data = {"schema": 1, "name": "x", "tissue": BLOCK, "vasculature": part}
    found = parse_recipe(data, "recipe.yaml").vasculature
    assert isinstance(found, LatticeNetwork)
    return found


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"lattice": "cube"}, r"vasculature\.lattice.*gyroid.*'cube'"),
        ({"cell_mm": -1}, r"vasculature\.cell_mm.*-1"),
        ({"cell": 3}, r"vasculature\.cell: .*remove it"),
        ({"axis": "w"}, r"vasculature\.axis"),
    ],
)
def test_wrong_lattices_are_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(RecipeError, match=message):
        parsed(**change)


# --- recipe section on tissue: zones, demand, label images; errors named with their place
NEEDLE = {"shape": "cylinder", "from_mm": [0, 0, 0], "to_mm": [0, 0, 9], "radius_mm": 0.5}
BALL = {"shape": "sphere", "centre_mm": [0, 0, 0], "radius_mm": 2}
BOX = {"shape": "block", "from_mm": [0, 0, 0], "to_mm": [1, 1, 1]}
PORT = {"mesh": "port.stl", "unit": "mm"}
LABELS = {"labels": "seg.nii.gz", "value": 3}


def recipe(**tissue: Any) -> Any:
    """A recipe with this tissue."""
    data = {"schema": 1, "name": "x", "vasculature": {"grow": "tree", "terminals": 9}}
    return parse_recipe({**data, "tissue": tissue}, "test.yaml").tissue


@pytest.mark.parametrize(
    "source",
    [
        {"shape": "biventricle"},
        {"mesh": "heart.stl", "unit": "mm"},
        {"points": "heart.xyz", "unit": "cm"},
        LABELS,
    ],
)
def test_every_source_takes_zones_and_demand(source: dict[str, Any]) -> None:
    table = {"depth_mm": [0, 1], "relative": [1, 2]}
    part = recipe(**source, keep_out=[NEEDLE, BALL, PORT], keep_within=[BOX], demand=table)
    assert isinstance(part.keep_out[0], CylinderPart)
    assert isinstance(part.keep_out[2], MeshPart)
    assert isinstance(part.demand, DepthDemandPart)
    assert "port.stl" in part.files()


@pytest.mark.parametrize(
    ("tissue", "message"),
    [
        ({"keep_out": [{**NEEDLE, "radius_mm": 0}]}, r"keep_out\.0.*radius_mm.*0"),
        ({"keep_out": [{**NEEDLE, "radius": 1}]}, r"keep_out\.0.*radius.*remove it"),
        ({"keep_out": [{"shape": "cone"}]}, r"cone.*cylinder"),
        ({"keep_out": [{"mesh": "a.stl"}]}, r"keep_out\.0.*unit.*add it"),
        ({"demand": {"depth_mm": [0, 1], "relative": [1]}}, r"demand.*2 depths but 1 relative"),
        ({"demand": {"depth_mm": [1, 0], "relative": [1, 1]}}, r"demand.*doesn't ascend"),
        ({"demand": {"depth_mm": [0, 1], "relative": [0, 0]}}, r"demand.*0 throughout"),
        ({"demand": {"depth_mm": [0], "relative": [-1]}}, r"demand.*relative.*-1"),
        ({"demand": {"image": "a.nii", "voxel_mm": [1, 1, 0]}}, r"demand.*voxel_mm.*0"),
    ],
)
def test_wrong_section_names_place_and_value(tissue: dict[str, Any], message: str) -> None:
    with pytest.raises(RecipeError, match=message):
        recipe(shape="biventricle", **tissue)
