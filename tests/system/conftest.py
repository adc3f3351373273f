"""Fixture: one planar run shared by all tests of its results."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from tests.system.cli import called, recipe_file


@pytest.fixture(scope="session")
def planar_recipe(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The shipped planar recipe; in CI with few layers and lines, a 14th of the voxels."""
    coarse: dict[str, Any] = {
        "toolpath": {"layer_um": 100, "line_um": 250},
        "scan": {"voxel_um": [60, 60, 36]},
        "registration": {"diameter_tolerance_percent": 20},
    }
    changes = {} if "PRINTCTL_NIGHTLY" in os.environ else coarse
    return recipe_file(tmp_path_factory.mktemp("recipe"), "planar_fresh", **changes)


@pytest.fixture(scope="session")
def planar_run(tmp_path_factory: pytest.TempPathFactory, planar_recipe: Path) -> Path:
    """Folder of that recipe, run once through the command line."""
    folder, words = tmp_path_factory.mktemp("planar"), ("run", planar_recipe, "--out", "run")
    done = called(*words, cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder / "run"


@pytest.fixture(scope="session")
def planar_report(planar_run: Path) -> dict[str, Any]:
    """report.json of that run."""
    found: dict[str, Any] = json.loads((planar_run / "report.json").read_text())
    return found
