"""Notes on constructs whose handles or open ends differ from the network's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from design.network import VesselNetwork
from design.network_files.csv_format import write_network_csv
from printctl.pipeline.run import design_recipe
from printctl.recipe import parse_recipe


@pytest.mark.parametrize(
    ("first", "last", "radius", "said"),
    [
        ((0.0, 3.0, 2.0), (10.0, 3.0, 2.0), 0.4, ""),
        ((0.0, 3.0, 0.2), (10.0, 3.0, 0.2), 0.4, "has 0 handles, the network asks for 1"),
        ((2.0, 3.0, 2.0), (8.0, 3.0, 2.0), 0.4, "(0 ports): the lumens are closed"),
    ],
)
def test_broken_walls_and_closed_lumens_are_told(
    tmp_path: Path,
    first: tuple[float, ...],
    last: tuple[float, ...],
    radius: float,
    said: str,
) -> None:
    zeros = np.zeros(1, dtype=np.int64)
    network = VesselNetwork.from_segments(
        np.array([first, last]), np.array([[0, 1]]), np.full(1, radius), zeros, zeros
    )
    write_network_csv(tmp_path / "n.csv", network)
    data = {
        "schema": 1,
        "name": "n",
        "tissue": {"shape": "block", "size_mm": [10, 6, 4]},
        "vasculature": {"network": "n.csv", "unit": "mm"},
        "toolpath": {"method": "embedded"},
        "printer": {"ink": "gelatin_sacrificial", "bath": "cell_matrix"},
    }
    recipe = parse_recipe(data, "n.yaml")
    design_recipe(recipe, tmp_path, tmp_path / "run", Console(quiet=True))
    told = (tmp_path / "run" / "manifest.json").read_text()
    assert ("handles, the network" in told or "0 ports" in told) == bool(said)
    assert said in told
