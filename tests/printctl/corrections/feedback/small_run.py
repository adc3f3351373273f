"""Small recipe run up to its G-code, with a synthetic registration."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from design.network_files.csv_format import write_network_csv
from printctl.pipeline.run import toolpath_recipe
from printctl.recipe import parse_recipe
from printctl.run_folder.artefacts import NUMBERS
from printctl.run_folder.manifest import Manifest, StageRecord, digest_file
from tests.made_once import made_once
from tests.printctl.corrections.feedback.lab import Lab
from tests.printctl.networks import vessels

TWO = vessels(
    [[0, 1.3, 1], [6, 1.3, 1]], [[0, 2.7, 1], [6, 2.7, 1]], radius=[0.3, 0.4], kind=4, tree=[0, 1]
)
"""Channels of 0.6 and 0.8 mm through a block of 6 x 4 x 2 mm, 0.7 mm of wall between them."""


def recipe_of(method: str = "fresh", **changes: Any) -> dict[str, Any]:
    """The recipe's sections; ``changes`` are the toolpath's."""
    toolpath: dict[str, Any] = {"method": method}
    if method == "embedded":
        toolpath["needle"] = "30g"
    return {
        "schema": 1,
        "name": "two",
        "tissue": {"shape": "block", "size_mm": [6, 4, 2]},
        "vasculature": {"network": "two.csv", "unit": "mm"},
        "toolpath": toolpath | changes,
        "printer": {"bath": "gelatin_support" if method == "fresh" else "cell_matrix"}
        | ({} if method == "fresh" else {"ink": "gelatin_sacrificial"}),
    }


def run(folder: Path, name: str, data: dict[str, Any]) -> dict[str, Any]:
    """Run a recipe in ``folder`` up to the lumens' check; its summaries."""
    write_network_csv(folder / "two.csv", TWO)
    recipe = parse_recipe(data, f"{name}.yaml")
    return toolpath_recipe(recipe, folder, folder / name, Console(quiet=True))


def small_run(factory: pytest.TempPathFactory) -> Path:
    """Return a folder with that recipe's run, `plain`: a copy of the first worker's."""

    def make() -> Path:
        folder = factory.mktemp("small_run")
        run(folder, "plain", recipe_of())
        return folder

    return Path(
        shutil.copytree(made_once(factory, "small_run", make), factory.mktemp("copy") / "runs")
    )


def registered(run_folder: Path, lab: Lab) -> None:
    """Put into a run what registration would have found of a print by ``lab``."""
    found = lab.print().found | {
        "interval_95": {"scale": [4e-4, 4e-4, None]},
        "depth_scale_fitted": False,
    }
    (run_folder / NUMBERS).write_text(json.dumps(found))
    manifest = Manifest.load(run_folder)
    outputs = {NUMBERS: digest_file(run_folder / NUMBERS)}
    manifest.stages["registration"] = StageRecord("key", outputs, {}, 0.0, 0.0)
    manifest.save()
