"""A recipe whose tissue has a part that no vessel reaches."""

from __future__ import annotations

from pathlib import Path

import pytest
import trimesh
from rich.console import Console

from design.errors import TissueError
from printctl.pipeline.run import design_recipe
from printctl.recipe import parse_recipe


@pytest.mark.parametrize(
    "vasculature",
    [{"grow": "tree", "terminals": 4}, {"grow": "closed_loop", "terminals": 4}],
    ids=lambda part: part["grow"],
)
def test_it_is_refused_by_size_and_place(tmp_path: Path, vasculature: dict[str, object]) -> None:
    one, two = trimesh.creation.box((10, 10, 10)), trimesh.creation.box((6, 6, 6))
    two.apply_translation((20, 0, 0))
    trimesh.util.concatenate([one, two]).export(tmp_path / "two.stl")
    recipe = {
        "schema": 1,
        "name": "two",
        "tissue": {"mesh": "two.stl", "unit": "mm"},
        "vasculature": vasculature,
    }
    with pytest.raises(TissueError, match=r"part of 216 mm³ around \(20, 0, 0\)"):
        made = parse_recipe(recipe, "two.yaml")
        design_recipe(made, tmp_path, tmp_path / "out", Console(quiet=True))
