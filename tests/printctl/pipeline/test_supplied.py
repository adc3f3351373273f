"""A recipe whose tissue has two parts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import trimesh
from rich.console import Console

from design.errors import TissueError
from printctl.pipeline.run import run_recipe
from printctl.pipeline.run_options import RunOptions
from printctl.recipe import parse_recipe


def design(folder: Path, **vasculature: Any) -> dict[str, Any]:
    one, two = trimesh.creation.box((10, 10, 10)), trimesh.creation.box((6, 6, 6))
    two.apply_translation((20, 0, 0))
    trimesh.util.concatenate([one, two]).export(folder / "two.stl")
    recipe = {
        "schema": 1,
        "name": "two",
        "tissue": {"mesh": "two.stl", "unit": "mm"},
        "vasculature": vasculature,
    }
    made = parse_recipe(recipe, "two.yaml")
    return run_recipe(made, folder, folder / "out", Console(quiet=True), RunOptions(until="flow"))


@pytest.mark.parametrize("grow", ["tree", "closed_loop"])
def test_a_part_without_vessels_is_refused_by_size_and_place(tmp_path: Path, grow: str) -> None:
    with pytest.raises(TissueError, match=r"part of 216 mm³ around \(20, 0, 0\)"):
        design(tmp_path, grow=grow, terminals=4)


def test_with_an_inlet_each_both_are_supplied_and_the_manifest_says_by_how_much(
    tmp_path: Path,
) -> None:
    network = design(tmp_path, grow="tree", terminals=40, inlets="each_part")["network"]
    assert [part["terminals"] for part in network["supply"]] == [33, 7]
    assert [part["flow_share"] for part in network["supply"]] == pytest.approx(
        [1000 / 1216, 216 / 1216]
    )
    assert "2 separate parts, each with vessels" in network["notes"][-1]
