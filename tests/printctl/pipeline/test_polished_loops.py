"""Polished trees of closed loops and forests, judged by a checker of their files."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from benchmarks.checkers import near_pairs, read_network, total_volume
from printctl.errors import RecipeError
from printctl.pipeline.run import design_recipe
from printctl.recipe import parse_recipe
from tests.slower import first_of

LOOPS = {"grow": "closed_loop", "terminals": 12}
FOREST = {
    "grow": "forest",
    "terminals": 8,
    "networks": [{"trees": [{"kind": "artery"}]}, {"trees": [{"kind": "artery"}]}],
}


def volume(folder: Path, vessels: dict[str, Any]) -> float:
    """Volume of a network whose vessels don't meet, mm³."""
    block = {"shape": "block", "size_mm": [12, 10, 8]}
    data = {"schema": 1, "name": "polished", "tissue": block, "vasculature": vessels}
    recipe = parse_recipe(data, "polished.yaml")
    design_recipe(recipe, folder, folder, Console(file=io.StringIO()), until="vasculature")
    network = read_network(folder / "network.csv")
    assert len(near_pairs(network).pairs) == 0
    return float(total_volume(network))


@pytest.mark.parametrize("vessels", first_of([FOREST, LOOPS]), ids=["forest", "loops"])
def test_polish_lowers_the_volume_of_all_trees(tmp_path: Path, vessels: dict[str, Any]) -> None:
    plain = volume(tmp_path / "plain", vessels)
    assert volume(tmp_path / "polished", vessels | {"polish": True}) < 0.97 * plain


def test_polish_beside_given_vessels_is_refused() -> None:
    networks = [*FOREST["networks"], {"network": "given.csv", "unit": "mm"}]  # type: ignore[misc]
    with pytest.raises(RecipeError, match="polish doesn't know vessels that are there"):
        parse_recipe(
            {
                "schema": 1,
                "name": "polished",
                "tissue": {"shape": "block", "size_mm": [12, 10, 8]},
                "vasculature": FOREST | {"networks": networks, "polish": True},
            },
            "polished.yaml",
        )
