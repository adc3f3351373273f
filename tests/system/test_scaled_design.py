"""Complete embedded run, scaled up, with purge and prime line, up to its report."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from printctl.pipeline.context import RunContext
from printctl.pipeline.stages import toolpath
from printctl.progress import StageBars
from printctl.recipe import load_recipe
from printctl.run_folder.manifest import Manifest
from tests.design.toolpath.gcode_reader import Machine
from tests.system.cli import printctl, recipe_file

pytestmark = pytest.mark.slow
"""One run of a minute; shorter ones elsewhere scale, prime and register each for itself."""

PRIME = {"line_mm": 6, "gap_mm": 4, "purge_ul": 5, "cup_mm": [20, 20, 70], "wipe_mm": [30, 20, 70]}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scaled")
    recipe = recipe_file(folder, "carbopol_scaled", toolpath={"prime": PRIME})
    done = printctl("run", recipe, "--out", "run", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder / "run"


def test_print_is_registered_against_the_print_s_size(run: Path):
    report = json.loads((run / "report.json").read_text())
    assert report["print"]["state"] == "done"
    assert report["registration"]["all_open"]
    assert report["registration"]["scaled"]["rms_um"] < 40
    assert report["truth_check"]["pose_error_um"] < 30
    assert not report["registration"]["ambiguity"]["flag"]
    assert report["frames"]["tissue_to_part"][0][0] == 4


def test_another_dish_makes_the_toolpath_again(run: Path):
    """The way from the cup goes above its wall, whose height isn't in the network or solid."""
    recipe = load_recipe(next(run.parent.glob("*.yaml")))
    keys = []
    for dish in ("box_80mm", "petri_60mm"):
        printer = recipe.printer.model_copy(update={"dish": dish})
        one = recipe.model_copy(update={"printer": printer})
        bars = StageBars(Console(quiet=True))
        context = RunContext(one, run.parent, run, Manifest.load(run), bars)
        keys.append(json.dumps(toolpath.depends(context)))
    assert keys[0] != keys[1]


def test_job_purges_over_the_cup_then_writes_a_line_beside_the_part(run: Path):
    machine = Machine().read((run / "part.gcode").read_bytes())
    pushed = []
    for before, after in zip(machine.states, machine.states[1:], strict=False):
        if after[1] > before[1]:
            pushed.append((before[0], after[0]))
    standing, moving = pushed[0], next(pair for pair in pushed if pair[0] != pair[1])
    assert [float(standing[1][axis]) for axis in "XYZ"] == [20, 20, 70]
    start, end = (np.array([float(place[axis]) for axis in "XYZ"]) for place in moving)
    assert np.linalg.norm(end - start) == pytest.approx(6, abs=0.01)
    away = np.abs((start + end)[:2] / 2 - 100).max()  # the part's middle is at 100, 100
    assert away == pytest.approx(16 + 4, abs=0.2)
