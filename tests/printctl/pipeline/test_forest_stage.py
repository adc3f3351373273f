"""Forests from a recipe: mixing beside given vessels, notes on what isn't supplied."""

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from benchmarks.checkers import near_pairs, read_network
from printctl.pipeline.run import design_recipe
from printctl.recipe import parse_recipe

CHANNEL = (
    "vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind,tree\n"
    "0,0,1,0,8,6,20,8,6,0.8,0.8,channel,0\n"
)


def designed(folder: Path, vessels: dict[str, Any]) -> dict[str, Any]:
    block = {"shape": "block", "size_mm": [20, 16, 12]}
    forest = {"grow": "forest", **vessels}
    data = {"schema": 1, "name": "forest", "tissue": block, "vasculature": forest}
    recipe = parse_recipe(data, "forest.yaml")
    console = Console(file=io.StringIO())
    design_recipe(recipe, folder, folder, console, until="vasculature")
    manifest = json.loads((folder / "manifest.json").read_text())
    summary: dict[str, Any] = manifest["stages"]["vasculature"]["summary"]
    return summary


def test_a_mixing_network_grows_round_given_vessels(tmp_path: Path) -> None:
    (tmp_path / "given.csv").write_text(CHANNEL)
    kinds = ("artery", "artery", "vein")
    mixed = {"trees": [{"kind": kind} for kind in kinds], "join": "mixing"}
    given = {"network": "given.csv", "unit": "mm"}
    found = designed(tmp_path, {"terminals": 6, "networks": [given, mixed]})
    assert found["networks"][0]["connections"] == 6
    net = read_network(tmp_path / "network.csv")
    assert len(near_pairs(net, clearance_ratio=0.1).colliding) == 0
    # Trees 0 to 2, the limbs of their nodes, what was there.
    np.testing.assert_array_equal(np.unique(net.tree), np.arange(5))


def test_trees_that_divide_the_tissue_are_held_against_it_together(tmp_path: Path) -> None:
    networks = [{"trees": [{"kind": "artery"}]}] * 2
    vessels = {"terminals": 30, "networks": networks, "territories": "divided"}
    assert "notes" not in designed(tmp_path, vessels)
