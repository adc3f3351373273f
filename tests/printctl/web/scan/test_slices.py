"""Slice pictures of a scan, against plain NumPy."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from printctl.web.scan.slices import TINT, Slices, picture, plane
from registration.files.readers import write_scan_tiff
from registration.scan import Scan

SHAPE = (5, 7, 9)


def _scan() -> Scan:
    volume = np.arange(np.prod(SHAPE), dtype=np.uint16).reshape(SHAPE)
    return Scan(
        volume=volume,
        voxel_mm=(0.04, 0.03, 0.02),
        refractive_index=1.0,
        optical_depth=False,
        scale="linear",
        modality="microct",
        depth_down=False,
        came_from=Path("scan"),
    )


@pytest.fixture
def path(tmp_path: Path) -> Path:
    place = tmp_path / "scan.tif"
    write_scan_tiff(place, _scan())
    return place


@pytest.mark.parametrize("index", [0, 2, 4])
def test_slices_are_those_of_the_volume(index: int) -> None:
    volume = _scan().volume
    np.testing.assert_array_equal(plane(volume, "z", index), volume[index])
    np.testing.assert_array_equal(plane(volume, "y", index), volume[:, index])
    np.testing.assert_array_equal(plane(volume, "x", index), volume[:, :, index])


def test_a_picture_is_the_window_in_256_steps(path: Path) -> None:
    data = Slices().png(path, "y", 3, window=(50.0, 250.0))
    seen = np.asarray(Image.open(io.BytesIO(data)))
    values = np.asarray(_scan().volume[:, 3], dtype=float)
    wanted = np.rint(255 * np.clip((values - 50.0) / 200.0, 0, 1))
    np.testing.assert_array_equal(seen[..., 0], wanted)
    np.testing.assert_array_equal(seen[..., 0], seen[..., 2])


def test_what_is_above_the_threshold_is_tinted() -> None:
    image = np.array([[0.0, 10.0], [20.0, 30.0]])
    seen = picture(image, 0.0, 30.0, threshold=20.0)
    np.testing.assert_array_equal(seen[0, 1], [85, 85, 85])
    np.testing.assert_array_equal(seen[1, 1], [(255 + part) // 2 for part in TINT])
    assert (seen[1, 0] != seen[1, 0, 0]).any()


def test_a_changed_scan_is_read_again(path: Path) -> None:
    slices = Slices()
    before = slices.open(path)
    path.with_suffix(".json").write_text('{"modality": "confocal"}')
    assert before.scan.modality == "microct"
    assert slices.open(path).scan.modality == "confocal"
