"""Complete embedded run: a grown tree of 200 terminals, scanned by simulated micro-CT."""

import json
from pathlib import Path

import pytest

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
