"""Notes on constructs whose handles or open ends differ from the network's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from design.network import VesselNetwork
from design.network_files.csv_format import write_network_csv
from kernels.arrays import FloatArray
from printctl.pipeline.run import design_recipe
from printctl.recipe import parse_recipe


def test_vessels_that_merge_are_told_by_number_and_place(tmp_path: Path) -> None:
    """Two channels side by side, whose lumens become one; a foreign network has 329 such places."""
    ends = np.array([(0.0, 3, 2), (10, 3, 2), (0, 3.6, 2), (10, 3.6, 2)])
    told = design_notes(tmp_path, ends, 0.4)
    assert "vessels merge that the network keeps apart: 0 and 1 by 0.2 mm at (" in told
    assert told.count("0 and 1 by") == 1
    assert "break through" not in told


@pytest.mark.parametrize(
    ("first", "last", "radius", "said"),
    [
        ((0.0, 3.0, 2.0), (10.0, 3.0, 2.0), 0.4, ""),
        ((0.0, 3.0, 0.2), (10.0, 3.0, 0.2), 0.4, "vessel 0 by 0.2 mm at ("),
        ((2.0, 3.0, 2.0), (8.0, 3.0, 2.0), 0.4, "vessel 0 at (2, 3, 2) mm, 2 mm below it"),
    ],
)
def test_broken_walls_and_closed_lumens_are_told(
    tmp_path: Path,
    first: tuple[float, ...],
    last: tuple[float, ...],
    radius: float,
    said: str,
) -> None:
    told = design_notes(tmp_path, np.array([first, last]), radius)
    assert ("handles, the network" in told or "0 ports" in told) == bool(said)
    assert said in told


def design_notes(tmp_path: Path, ends: FloatArray, radius: float) -> str:
    """Design straight vessels between pairs of `ends` in a block; return the run's manifest."""
    n = len(ends) // 2
    zeros = np.zeros(n, dtype=np.int64)
    pairs = np.arange(2 * n).reshape(-1, 2)
    network = VesselNetwork.from_segments(ends, pairs, np.full(n, radius), zeros, zeros)
    write_network_csv(tmp_path / "n.csv", network)
    data = {
        "schema": 1,
        "name": "n",
        "tissue": {"shape": "block", "size_mm": [10, 6, 4]},
        "vasculature": {"network": "n.csv", "unit": "mm", "overlaps": "tell"},
        "toolpath": {"method": "embedded"},
        "printer": {"ink": "gelatin_sacrificial", "bath": "cell_matrix"},
    }
    recipe = parse_recipe(data, "n.yaml")
    design_recipe(recipe, tmp_path, tmp_path / "run", Console(quiet=True))
    return (tmp_path / "run" / "manifest.json").read_text()
