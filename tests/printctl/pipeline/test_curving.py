"""Trees with curves in the place of bends, judged by a checker of their files."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from benchmarks.checkers import near_pairs, read_network
from design.hemodynamics import FlowConditions, solve_flow
from design.network_files.csv_format import read_network_csv
from printctl.errors import RecipeError
from printctl.pipeline.run import design_recipe
from printctl.recipe import Recipe, parse_recipe

TREE = {"grow": "tree", "terminals": 60, "curves": True}


def recipe(vessels: dict[str, Any]) -> Recipe:
    block = {"shape": "block", "size_mm": [12, 10, 8]}
    data = {"schema": 1, "name": "curved", "tissue": block, "vasculature": vessels}
    return parse_recipe(data, "curved.yaml")


def test_main_lines_are_curves_clear_of_each_other_with_flows_as_asked(tmp_path: Path) -> None:
    said = io.StringIO()
    design_recipe(recipe(TREE), tmp_path, tmp_path, Console(file=said), until="vasculature")
    assert "0 curved" in said.getvalue().replace("\n", " ")
    found = near_pairs(read_network(tmp_path / "network.csv"), 0.0, 0.1)
    assert len(found.colliding) == 0
    network = read_network_csv(tmp_path / "network.csv", "mm")
    assert network.vessel_count == 2 * 60 - 1
    assert len(network.points) > 3 * network.vessel_count
    flow = solve_flow(network, FlowConditions(4e-3, inlet_flow_ul_s=1.0)).flow
    ends = np.isin(network.vessel_nodes[:, 1], network.outlets())
    assert flow[ends] == pytest.approx(1.0 / 60, rel=1e-9)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"printable": True}, "curves wouldn't keep to printable"),
        ({"turn_angle_degrees": [0, 90]}, "curves wouldn't keep to turn_angle_degrees"),
        ({"anatomy": {"template": "heart"}}, "curved as it is; leave curves out"),
    ],
)
def test_what_curves_would_break_is_refused(more: dict[str, Any], message: str) -> None:
    with pytest.raises(RecipeError, match=message):
        recipe(TREE | more)
