"""Network commands end to end (`view`, `convert`, `measure`), in an empty directory."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
import yaml
from PIL import Image

from tests.system.cli import called as printctl

HEADER = "vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind,tree\n"
FORK = (
    "0,0,1,7,7,0,7,7,3,0.5,0.5,artery,0\n"
    "1,1,2,7,7,3,10,7,7,0.4,0.4,artery,0\n"
    "2,1,3,7,7,3,4,7,7,0.39,0.39,artery,0\n"
)
BLOCK = {"shape": "block", "size_mm": [14, 14, 8]}


@pytest.fixture(scope="module")
def lattice(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a designed lattice, and of a tree in the same tissue as a file."""
    folder = tmp_path_factory.mktemp("lattice")
    recipe = {
        "schema": 1,
        "name": "lattice",
        "tissue": BLOCK,
        "vasculature": {"lattice": "grid", "cell_mm": 3.5, "diameter_mm": 0.8},
    }
    (folder / "recipe.yaml").write_text(yaml.safe_dump(recipe))
    (folder / "fork.csv").write_text(HEADER + FORK)
    done = printctl("design", "recipe.yaml", "--out", "run", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.slow
def test_lattice_and_tree_are_measured_alike_in_one_tissue(lattice: Path) -> None:
    grid = printctl("measure", "run", "--json", "--samples", "20000", cwd=lattice)
    assert grid.returncode == 0, grid.stderr
    tree = printctl(
        "measure", "fork.csv", "--unit", "mm", "--tissue", "run", "--printable-mm", "0.79",
        "--samples", "20000", "--out", "tree.json", cwd=lattice,
    )  # fmt: skip
    assert tree.returncode == 0, tree.stderr
    of_grid, of_tree = json.loads(grid.stdout), json.loads((lattice / "tree.json").read_text())
    assert of_grid["tissue_mm3"] == of_tree["tissue_mm3"] == pytest.approx(14 * 14 * 8, rel=0.01)
    assert of_grid["supply"]["distance_mean_mm"] < of_tree["supply"]["distance_mean_mm"]
    assert (of_grid["inlets"], of_grid["outlets"]) == (1, 1)
    # The thinnest branch is below what can be printed.
    printable = of_tree["printable"]["vessels_per_mm2"]
    assert printable == pytest.approx(of_tree["supply"]["vessels_per_mm2"] * 8 / 13)
    for words in ("Strahler", "diameter-defined", "Murray", "beyond 200 µm", "spread", "Krogh"):
        assert words in tree.stdout
    assert "0.25 mL/min" in tree.stderr


def test_a_run_becomes_a_page(lattice: Path) -> None:
    done = printctl("view", "run", "--colour", "pressure", cwd=lattice)
    assert done.returncode == 0, done.stderr
    assert re.fullmatch(r"run/view\.html \([\d.]+ (k|M)B\)\n", done.stdout)
    page = (lattice / "run" / "view.html").read_text(encoding="utf-8")
    assert '"first":"pressure"' in page
    assert "Content-Security-Policy" in page


def test_a_file_becomes_a_picture(lattice: Path) -> None:
    done = printctl(
        "view", "fork.csv", "--unit", "mm", "--tissue", "run", "--png", "fork.png",
        "--width", "500", "--colour", "flow", "--json", cwd=lattice,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["picture"]["bytes"] == (lattice / "fork.png").stat().st_size
    assert "page" not in told
    with Image.open(lattice / "fork.png") as picture:
        assert picture.size[0] == 500
