"""Regions with their own infill or head, from a recipe."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pydantic import TypeAdapter

from design.errors import DesignError
from design.network import VesselNetwork
from design.solids import block_solid, write_stl
from printctl.pipeline.stages.toolpath import make_region
from printctl.recipe.regions import RegionPart

NONE = np.zeros(1, dtype=np.int64)
TUBE = VesselNetwork.from_segments(
    np.array([[0.0, 0, 0], [10, 0, 0]]), np.array([[0, 1]]), np.array([0.5]), NONE, NONE
)


def made(words: dict[str, object], folder: Path = Path()) -> float:
    part = TypeAdapter(RegionPart).validate_python(words)
    return make_region(part, 2, folder, TUBE).solid.volume_mm3


def test_around_vessels_is_the_vessels_widened() -> None:
    # A rod of radius 1.5 with round ends.
    rod = np.pi * 1.5**2 * 10 + 4 / 3 * np.pi * 1.5**3
    assert made({"around_vessels_mm": 1.0}) == pytest.approx(rod, rel=0.01)


def test_shapes_and_meshes_have_their_volume(tmp_path: Path) -> None:
    ball = {"shape": "sphere", "centre_mm": [0, 0, 0], "radius_mm": 2.0}
    assert made({"where": ball}) == pytest.approx(4 / 3 * np.pi * 8, rel=0.02)
    block = {"shape": "block", "from_mm": [0, 0, 0], "to_mm": [1, 2, 3]}
    assert made({"where": block}) == pytest.approx(6.0)
    write_stl(tmp_path / "a.stl", block_solid((2, 2, 2)))
    mesh = {"mesh": "a.stl", "unit": "cm"}
    assert made({"where": mesh}, tmp_path) == pytest.approx(8000.0)


def test_a_flat_region_is_refused_by_name() -> None:
    flat = {"shape": "block", "from_mm": [0, 0, 0], "to_mm": [1, 2, 0]}
    with pytest.raises(DesignError, match=r"toolpath\.regions\.2"):
        made({"where": flat})
