"""Complete run of a heart with some 500 branches, printable by the recipe's needle."""

import json
from pathlib import Path

import pytest

from tests.system.cli import ROOT, printctl, recipe_file


@pytest.mark.slow
def test_heart_keeps_to_what_the_needle_can_write(tmp_path: Path) -> None:
    recipe = ROOT / "examples" / "heart_printable.yaml"
    done = printctl("design", recipe, "--out", "heart", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    network = report["network"]
    assert network["vessels"] == 499
    assert network["diameter_min_mm"] >= 0.4 - 1e-9
    assert network["diameter_max_mm"] <= 3.568
    assert "lumens of 0.4 mm and walls of 0.1 mm or more kept" in network["notes"][0]


@pytest.mark.slow
def test_design_says_how_far_the_tree_could_grow(tmp_path: Path) -> None:
    vasculature = {
        "terminals": 40,
        "smallest_diameter_mm": 1.2,
        "clearance_mm": 0.5,
        "root_mm": [8.0, 8.0, 12.0],
        "root_direction": [0.0, 0.0, -1.0],
    }
    tissue = {"=": "replace", "shape": "block", "size_mm": [16.0, 16.0, 12.0]}
    recipe = recipe_file(tmp_path, "heart_printable", tissue=tissue, vasculature=vasculature)
    done = printctl("design", recipe, "--out", "block", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    network = json.loads(done.stdout)["network"]
    assert 1 <= network["terminals"] < 40
    said = network["notes"][1]
    assert f"grew {network['terminals']} of 40 terminals before printability stopped it" in said
    assert said in done.stderr


@pytest.mark.slow
def test_printable_finds_its_root_itself(tmp_path: Path) -> None:
    recipe = recipe_file(tmp_path, "heart_printable", vasculature={"root": "search"})
    done = printctl("design", recipe, "--out", "heart", cwd=tmp_path)
    assert done.returncode == 2
    assert "printable doesn't go with root" in done.stderr
