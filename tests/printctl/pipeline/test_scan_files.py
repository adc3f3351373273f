"""Rerun of a run's scan stage after any change of the user's scan."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from printctl.pipeline.stages.scan import digest_user_files, load_scan
from printctl.recipe.making import FileScan, SimulatedScan
from registration.devices.optics.beam import OctCalibration
from registration.devices.optics.file import write_calibration
from registration.files.writers import write_scan
from registration.wall_reference import WallCalibration
from tests.registration.files.readers.crafted import counts, scan


def loaded(folder: Path, **said: Any) -> Any:
    """A scan as a recipe that says this of it reads it."""
    context: Any = SimpleNamespace(recipe_folder=folder, scan_part=FileScan(**said))
    return load_scan(context)


def test_a_recipe_says_what_the_file_doesnt(tmp_path: Path) -> None:
    counts(9, 10, 11).tofile(tmp_path / "s.raw")
    sidecar = {"shape": [9, 10, 11], "dtype": "uint16", "byte_order": "little", "axes": "zyx"}
    (tmp_path / "s.json").write_text(json.dumps(sidecar))
    found = loaded(
        tmp_path,
        file="s.raw",
        voxel_um=(30, 20, 10),
        axes="yzx",
        refractive_index=1.4,
        optical_depth=True,
        modality="oct",
        scale="db",
        counts_per_db=1,
        depth_down=False,
        mirrored=False,
    )
    assert found.volume.shape == (10, 9, 11)
    assert found.voxel_mm == pytest.approx((0.01, 0.02, 0.03))
    assert (found.scale, found.refractive_index, found.optical_depth) == ("db", 1.4, True)
    assert not found.depth_down


def test_a_recipe_names_the_devices_calibration(tmp_path: Path) -> None:
    write_scan(tmp_path / "s.tif", scan(volume=counts(20, 20, 20)))
    said = {"file": "s.tif", "oct_calibration": "device.yaml"}
    before = digest_user_files(tmp_path, FileScan(**said))
    walls = WallCalibration(4.5, 0.6, 400.0, 1000.0, 3)
    device = OctCalibration(refractive_index=1.45, depth_standard=True, walls=walls)
    write_calibration(tmp_path / "device.yaml", device)
    assert digest_user_files(tmp_path, FileScan(**said)) != before
    assert loaded(tmp_path, **said).depth_standard
    assert loaded(tmp_path, **said).walls == walls
    assert not loaded(tmp_path, file="s.tif").depth_standard
    write_calibration(tmp_path / "device.yaml", OctCalibration(walls=walls))
    # Walls alone lay no voxel anew.
    found = loaded(tmp_path, **said)
    assert found.walls == walls
    assert found.volume.dtype == np.uint16


def test_only_an_oct_writes_a_thorlabs_file() -> None:
    assert SimulatedScan(simulated="oct", format="oct").format == "oct"
    with pytest.raises(ValidationError, match="micro-CT writes no"):
        SimulatedScan(simulated="microct", voxel_um=(30, 30, 30), format="oct")
