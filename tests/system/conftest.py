"""Fixture: one planar run shared by all tests of its results."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path
from typing import Any

import pytest

from kernels import cache_dir
from kernels.needed import needed_kernels
from tests.kernels.record import row
from tests.system.cli import called, printctl, recipe_file


@pytest.fixture(scope="session")
def listed_kernels(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store of compiled kernels that holds none but those on the list (`kernels.needed`)."""
    folder = tmp_path_factory.mktemp("listed")
    (folder / "kernels").mkdir()
    listed = {(one.kernel, one.takes) for one in needed_kernels()}
    for file in cache_dir().glob("*.nbc"):
        if row(file) in listed:
            shutil.copyfile(file, folder / "kernels" / file.name)
    return folder


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
def planar_run(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory, planar_recipe: Path
) -> Path:
    """Folder of that recipe, run once through the command line, nightly in a process."""
    folder, words = tmp_path_factory.mktemp("planar"), ("run", planar_recipe, "--out", "run")
    if any("listed_kernels" in getattr(item, "fixturenames", ()) for item in request.session.items):
        store = {"PRINTCTL_CACHE": str(request.getfixturevalue("listed_kernels"))}
        done = printctl(*words, cwd=folder, env=os.environ | store)
    else:
        done = called(*words, cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder / "run"


@pytest.fixture(scope="session")
def planar_report(planar_run: Path) -> dict[str, Any]:
    """report.json of that run."""
    found: dict[str, Any] = json.loads((planar_run / "report.json").read_text())
    return found
