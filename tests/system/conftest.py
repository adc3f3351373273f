"""One planar run for all tests that look at its results."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.system.cli import ROOT, printctl


@pytest.fixture(scope="session")
def planar_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the shipped planar recipe, run once through the command line."""
    folder = tmp_path_factory.mktemp("planar")
    done = printctl("run", ROOT / "examples" / "planar_fresh.yaml", "--out", "run", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder / "run"


@pytest.fixture(scope="session")
def planar_report(planar_run: Path) -> dict[str, Any]:
    """report.json of that run."""
    found: dict[str, Any] = json.loads((planar_run / "report.json").read_text())
    return found
