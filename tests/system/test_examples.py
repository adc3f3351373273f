"""Complete embedded run: a grown tree of 200 terminals, scanned by simulated micro-CT."""

from __future__ import annotations

import csv
import json
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from printctl.pipeline.context import RunContext
from printctl.pipeline.stages.paths import toolpath
from printctl.progress import StageBars
from printctl.recipe import load_recipe
from printctl.run_folder.manifest import Manifest
from tests.design.toolpath.gcode_reader import Machine
from tests.system.cli import ROOT, SHARED, printctl, recipe_file

GYRUS = SHARED / "data" / "gyrus_patch_fsaverage5.stl"


def _run(recipe: Path, folder: Path) -> None:
    done = printctl("run", recipe, "--out", "run", cwd=folder)
    assert (folder / "run" / "report.json").exists(), done.stderr
    report = json.loads((folder / "run" / "report.json").read_text())
    assert report["network"]["terminals"] == 200
    assert report["print"]["state"] == "done"
    assert report["registration"]["all_open"]
    assert report["registration"]["scaled"]["rms_um"] < 40
    assert not report["registration"]["ambiguity"]["flag"]
    assert report["truth_check"]["pose_error_um"] < 30
    assert done.returncode == 0, report["verdict"]


@pytest.mark.slow
def test_shipped_phantom(tmp_path: Path) -> None:
    _run(ROOT / "examples" / "cortex_embedded.yaml", tmp_path)


@pytest.mark.slow
@pytest.mark.skipif(not GYRUS.exists(), reason="no shared data beside the project")
def test_real_gyrus(tmp_path: Path) -> None:
    """Its slab is thinner than the phantom's: the smallest lumen is 0.25 mm, not 0.3."""
    tissue = {"=": "replace", "mesh": str(GYRUS), "unit": "mm"}
    changes = {"tissue": tissue, "vasculature": {"smallest_diameter_mm": 0.25}}
    _run(recipe_file(tmp_path, "cortex_embedded", name="gyrus_embedded", **changes), tmp_path)


# Closed artery-vein recipe: flow shares of all loops, checked on the exported files.


@pytest.mark.slow
def test_ring_is_designed_with_balanced_loops(tmp_path: Path) -> None:
    recipe = ROOT / "examples" / "ring_closed_loop.yaml"
    done = printctl("design", recipe, "--out", "ring", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    with (tmp_path / "ring" / "flow.csv").open(newline="") as handle:
        rows = list(csv.DictReader(handle))
    kinds = Counter(row["kind"] for row in rows)
    assert kinds == {"artery": 17, "vein": 17, "connection": 9}
    shares = np.array([float(row["flow_ul_s"]) for row in rows if row["kind"] == "connection"])
    np.testing.assert_allclose(shares, shares.mean(), rtol=1e-9)
    assert report["solid"]["genus"] == report["solid"]["genus_expected"] == 10
    assert report["network"]["diameter_min_mm"] >= 0.4 - 1e-9


# Shipped examples with a scan pass as they are, or fail in nothing where some can't be decided.

ELSEWHERE = {"planar_fresh", "cortex_embedded", "cube_multifidelity"}
"""The first two have tests of their own. The third takes ten minutes for its flow; where its loop
closes lumens come out 15 to 30 % too wide, so that its verdict is undecided."""
UNDECIDED = {"ring_two_inks"}
"""One lumen of 43 is 7.5 ± 2.6 % too wide where two passes meet, for a limit of 10 %."""
NAMES = sorted(
    path.stem
    for path in (ROOT / "examples").glob("*.yaml")
    if "\nscan:" in path.read_text(encoding="utf-8") and path.stem not in ELSEWHERE
)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_a_shipped_example_passes(name: str, tmp_path: Path) -> None:
    done = printctl("run", ROOT / "examples" / f"{name}.yaml", "--out", "run", cwd=tmp_path)
    report = tmp_path / "run" / "report.json"
    assert report.is_file(), done.stderr
    data = json.loads(report.read_text())
    reasons = data["verdict"]["reasons"]
    if name not in UNDECIDED:
        assert done.returncode == 0, reasons
        return
    decisions = [vessel["decision"] for vessel in data["registration"]["vessels"]]
    assert decisions.count("pass") >= len(decisions) - 1, reasons
    assert "fail" not in decisions, reasons


# Complete run of a heart with some 500 branches, printable by the recipe's needle.


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


# --- complete embedded run, scaled up, with purge and prime line, up to its report
# One run of a minute; shorter ones elsewhere scale, prime and register each for itself.
PRIME = {"line_mm": 6, "gap_mm": 4, "purge_ul": 5, "cup_mm": [20, 20, 70], "wipe_mm": [30, 20, 70]}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scaled")
    recipe = recipe_file(folder, "carbopol_scaled", toolpath={"prime": PRIME})
    done = printctl("run", recipe, "--out", "run", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder / "run"


@pytest.mark.slow
def test_print_is_registered_against_the_print_s_size(run: Path):
    report = json.loads((run / "report.json").read_text())
    assert report["print"]["state"] == "done"
    assert report["registration"]["all_open"]
    assert report["registration"]["scaled"]["rms_um"] < 40
    assert report["truth_check"]["pose_error_um"] < 30
    assert not report["registration"]["ambiguity"]["flag"]
    assert report["frames"]["tissue_to_part"][0][0] == 4


@pytest.mark.slow
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


@pytest.mark.slow
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
