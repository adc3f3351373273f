"""Adaptive layer heights, from recipe to checked G-code."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from design.network_files.csv_format import write_network_csv
from printctl.pipeline.run import toolpath_recipe
from printctl.recipe import parse_recipe
from tests.printctl.pipeline.test_layer_heads import SIZE_MM, TUBE, WHOLE_UL, recipe


def test_a_recipe_s_layers_are_thinner_round_a_lying_lumen(tmp_path: Path) -> None:
    """Heights as its G-code says them; both checks take each layer by its own."""
    write_network_csv(tmp_path / "tube.csv", TUBE)
    said = recipe([], [])
    said["toolpath"] |= {"layer_um": 60, "thinnest_layer_um": 20, "stair_um": 15}
    said["printer"] |= {"profile": "generic_marlin", "heads": []}
    made = parse_recipe(said, "thin.yaml")
    summary = toolpath_recipe(made, tmp_path, tmp_path / "run", Console(quiet=True))
    text = (tmp_path / "run" / "part.gcode").read_text()
    heights = np.array([float(found) for found in re.findall(r";HEIGHT:([\d.]+)", text)])
    assert heights.sum() == pytest.approx(SIZE_MM[2], abs=1e-6)
    assert (heights.min(), heights.max()) == pytest.approx((0.02, 0.06), abs=0.006)
    top = np.cumsum(heights)
    assert heights[top < 0.45] == pytest.approx(0.06, abs=0.006)
    assert heights[np.abs(top - 1.0) < 0.02].max() < 0.03
    assert summary["toolpath"]["written_ul"] == pytest.approx(WHOLE_UL, rel=0.02)
    found = json.loads((tmp_path / "run" / "lumens.json").read_text())
    assert found["passed"]
    # Its floor and ceiling stand on whole layers: 41 um are lost with layers of 60 um all alike.
    assert -20 < found["lumens"][0]["diameter_error_median_um"] < 5
    assert found["line_um"] == pytest.approx(150, abs=5)
