"""Recipes refused before any computation, for their profiles or given network."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from rich.console import Console

from design.errors import SolidError, ToolpathError
from design.network import VesselNetwork
from design.network_files.csv_format import write_network_csv
from firmware_profiles import Needle, load
from printctl.errors import SafetyError, UsageError
from printctl.pipeline.refusals import refuse_before
from printctl.pipeline.run import design_recipe, toolpath_recipe
from printctl.recipe import Recipe, parse_recipe

EMBEDDED = {"method": "embedded", "needle": "30g_50mm"}
GELATIN = {"ink": "gelatin_sacrificial", "bath": "cell_matrix"}


def network(depth_mm: float = 8.0, radius_mm: float = 0.2) -> VesselNetwork:
    """A straight, slanted vessel."""
    return VesselNetwork.from_segments(
        np.array([[1.0, 3, 1], [9, 3, 1 + depth_mm]]),
        np.array([[0, 1]]),
        np.full(1, radius_mm),
        np.zeros(1, dtype=np.int64),
        np.zeros(1, dtype=np.int64),
    )


def recipe(folder: Path, vessels: VesselNetwork, **parts: Any) -> Recipe:
    write_network_csv(folder / "net.csv", vessels)
    data = {
        "schema": 1,
        "name": "one",
        "tissue": {"shape": "block", "size_mm": [10, 6, 10]},
        "vasculature": {"network": "net.csv", "unit": "mm"},
        "toolpath": EMBEDDED,
        "printer": GELATIN,
        **parts,
    }
    return parse_recipe(data, "one.yaml")


def short(folder: Path) -> str:
    """A needle of 9.5 mm, shorter than the block and longer than the vessel is deep."""
    facts = load(Needle, "30g").model_dump(mode="json", exclude_none=True) | {"length_mm": 9.5}
    (folder / "short.yaml").write_text(yaml.safe_dump(facts))
    return str(folder / "short.yaml")


@pytest.mark.parametrize(
    ("parts", "vessels", "error", "why"),
    [
        (
            {},
            network(radius_mm=0.06),
            ToolpathError,
            r"diameter 0\.120 mm at \(1, 3, 1\) mm is thinner",
        ),
        (
            {"toolpath": {"method": "fresh"}, "printer": {}},
            network(radius_mm=0.06),
            ToolpathError,
            r"vessel 0: lumen of 0\.120 mm is narrower",
        ),
        (
            {"printer": {**GELATIN, "place_mm": [195, 50, 1]}},
            network(),
            SafetyError,
            "greatest x of the network: 204 mm, limit 200",
        ),
        (
            {"toolpath": {"method": "fresh"}, "printer": {"place_mm": [195, 50, 1]}},
            network(),
            SafetyError,
            "greatest x of the part: 205 mm, limit 200",
        ),
        (
            {"print_scale": 30.0, "toolpath": {**EMBEDDED, "needle": "18g"}},
            network(depth_mm=1.0),
            SafetyError,
            "length of the network in x: 240 mm, limit 200",
        ),
        (
            {
                "printer": {
                    **GELATIN,
                    "dish": "petri_35mm",
                    "dish_centre_mm": [100, 100],
                    "place_mm": [110, 97, 1],
                }
            },
            network(depth_mm=2.0),
            SafetyError,
            r"needle to the dish's wall: .* \(vessel 0\)",
        ),
        (
            {"printer": {"ink": "alginate_fresh", "bath": "cell_matrix"}},
            network(),
            SafetyError,
            "what sets the ink and the bath lacks",
        ),
        (
            {
                "toolpath": {"method": "fresh", "needle": "22g", "line_um": 320},
                "printer": {"ink": "collagen_fresh", "bath": "gelatin_support"},
            },
            network(),
            SafetyError,
            r"bore: 0.32 mm, limit 0.328 .* of at most 0.4 mm bore \(23g",
        ),
    ],
)
def test_a_part_that_cannot_be_printed_is_refused_before_it_is_designed(
    parts: dict[str, Any], vessels: VesselNetwork, error: type[Exception], why: str, tmp_path: Path
) -> None:
    made = recipe(tmp_path, vessels, **parts)
    with pytest.raises(error, match=why):
        toolpath_recipe(made, tmp_path, tmp_path / "run", Console(quiet=True))
    assert not (tmp_path / "run").exists()


def test_step_without_its_extra_is_refused_before_anything_is_designed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "netgen", None)
    made = recipe(tmp_path, network(), solid={"formats": ["stl", "step"]})
    with pytest.raises(SolidError, match=r"pip install 'printctl\[step\]'"):
        design_recipe(made, tmp_path, tmp_path / "run", Console(quiet=True))
    assert not (tmp_path / "run").exists()


def test_a_file_that_is_not_there_is_refused_first(tmp_path: Path) -> None:
    made = recipe(tmp_path, network(), flow={"outlets": "none.csv"})
    with pytest.raises(UsageError, match=r"none\.csv, which the recipe names, isn't there"):
        design_recipe(made, tmp_path, tmp_path / "run", Console(quiet=True))
    assert not (tmp_path / "run").exists()


def test_a_block_is_as_deep_as_it_says_and_other_tissue_as_its_network(tmp_path: Path) -> None:
    toolpath = {**EMBEDDED, "needle": short(tmp_path)}
    with pytest.raises(SafetyError, match=r"needle's length: 10 mm, limit 9\.5"):
        refuse_before(recipe(tmp_path, network(), toolpath=toolpath), tmp_path)
    cut = {
        "shape": "block",
        "size_mm": [10, 6, 10],
        "keep_within": [{"shape": "block", "from_mm": [0, 0, 0], "to_mm": [10, 6, 9.2]}],
    }
    refuse_before(recipe(tmp_path, network(), toolpath=toolpath, tissue=cut), tmp_path)
