"""Recipe's growth section: conversion to growth options, files read."""

from pathlib import Path

import numpy as np
import pytest

from design.network_files.swc import write_network_swc
from design.tissue import block, tissue_from_surface
from design.vasculature import DepthPenalty, GrowthOptions, grow_tree, tree_to_network
from printctl.errors import RecipeError
from printctl.pipeline.growing import growth_options, read_terminals, read_trunk
from printctl.recipe.growth import GrownNetwork


def test_every_word_arrives_in_the_design_s_units(tmp_path: Path) -> None:
    part = GrownNetwork.model_validate(
        {
            "grow": "tree",
            "terminal_flow": "demand",
            "viscosity_law": "pries_1994",
            "haematocrit": 0.4,
            "smallest_diameter_mm": 0.2,
            "branch_angle_degrees": [30, 140],
            "turn_angle_degrees": [0, 80],
            "flow_ratio": 0.05,
            "length_to_radius": 2,
            "follow_demand": False,
            "penalty": {"depth_mm": [0, 1], "factor": [3, 1]},
            "root": "search",
            "root_candidates": 8,
            "stages": [
                {"terminals": 50, "clearance_mm": 0.3, "penalty": {"depth_mm": [0], "factor": [2]}},
                {"terminals": 800},
            ],
        }
    )
    options = growth_options(part, 7, tmp_path)
    assert (options.terminals, options.seed, options.terminal_flow) == (800, 7, "demand")
    assert (options.viscosity_law, options.haematocrit) == ("pries_1994", 0.4)
    assert options.smallest_radius_mm == 0.1
    assert (options.branch_angle_degrees, options.turn_angle_degrees) == ((30, 140), (0, 80))
    assert (options.flow_ratio, options.length_to_radius) == (0.05, 2.0)
    assert not options.follow_demand
    assert options.penalty == DepthPenalty((0.0, 1.0), (3.0, 1.0))
    assert options.root_candidates == 8
    assert options.stages[0].clearance_mm == 0.3
    assert options.stages[0].penalty == DepthPenalty((0.0,), (2.0,))
    assert options.stages[1].clearance_mm is None


def test_terminals_come_from_a_table_with_or_without_flows(tmp_path: Path) -> None:
    path = tmp_path / "wells.csv"
    path.write_text("name, x_mm, y_mm, z_mm\nA1, 1, 2, 3\nA2, 4, 5, 6\n")
    points, flows = read_terminals(path)
    np.testing.assert_array_equal(points, [[1, 2, 3], [4, 5, 6]])
    assert flows is None
    path.write_text("flow,z_mm,y_mm,x_mm\n0.5,3,2,1\n2,6,5,4\n")
    part = GrownNetwork.model_validate({"grow": "tree", "terminal_points": "wells.csv"})
    options = growth_options(part, 1, tmp_path)
    assert options.terminals == 2
    assert options.terminal_points_mm == ((1, 2, 3), (4, 5, 6))
    assert options.terminal_flows == (0.5, 2.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x,y,z\n1,2,3\n", r"columns are x, y, z; give x_mm"),
        ("", r"columns are missing"),
        ("x_mm,y_mm,z_mm\n1,2,3\n1,b,3\n", r"line 3: \['1', 'b', '3'\] aren't numbers"),
        ("x_mm,y_mm,z_mm\n1,2\n", r"line 2: .*None.* aren't numbers"),
        ("x_mm,y_mm,z_mm\n1,2,nan\n", r"line 2: \['1', '2', 'nan'\] aren't all finite"),
        ("x_mm,y_mm,z_mm,flow\n1,2,3,-1\n", r"line 2: flow is -1; give one above 0"),
        ("x_mm,y_mm,z_mm\n1,2,3\n4,5,6\n1,2,3\n", r"\(1, 2, 3\) mm stands in line 2 and in line 4"),
    ],
)
def test_a_table_of_another_kind_is_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "wells.csv"
    path.write_text(text)
    with pytest.raises(RecipeError, match=message):
        read_terminals(path)
    with pytest.raises(RecipeError, match="can't be read"):
        read_terminals(tmp_path / "none.csv")


def test_a_trunk_is_read_from_swc(tmp_path: Path) -> None:
    shape = block((12.0, 10.0, 8.0))
    tissue = tissue_from_surface(shape.vertices, shape.faces)
    first = tree_to_network(grow_tree(tissue, GrowthOptions(terminals=4)))
    write_network_swc(tmp_path / "artery.swc", first)
    part = GrownNetwork.model_validate({"grow": "tree", "terminals": 40, "trunk": "artery.swc"})
    trunk = read_trunk(part, tmp_path)
    assert trunk is not None
    tree = grow_tree(tissue, growth_options(part, 1, tmp_path), trunk=trunk)
    assert (tree.children[:, 0] < 0).sum() == 40
    assert tree.given.sum() >= 7
