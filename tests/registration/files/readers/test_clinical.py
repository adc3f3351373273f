"""Readers of Bioptigen and Heidelberg files."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from registration import ScanOverrides, read_scan
from registration.errors import ScanFileError
from tests.registration.files.readers.crafted import OCT, bioptigen, counts, heidelberg

INDEX = ScanOverrides(refractive_index=1.36, optical_depth=False)


def test_bioptigen_volume_comes_back(tmp_path: Path) -> None:
    found = read_scan(bioptigen(tmp_path / "s.OCT", counts()), OCT)
    np.testing.assert_array_equal(found.volume, counts())
    assert found.voxel_mm == pytest.approx((1.5 / 9, 3.0 / 8, 2.0 / 7))
    assert any("not verified" in note for note in found.notes)


def test_heidelberg_volume_comes_back(tmp_path: Path) -> None:
    volume = counts().astype(np.float32) / 1000
    found = read_scan(heidelberg(tmp_path / "s.vol", volume), INDEX)
    np.testing.assert_array_equal(found.volume, volume)
    assert found.voxel_mm == (0.004, 0.05, 0.011)
    assert found.scale == "linear"
    assert found.handedness == "right"


def test_heidelberg_scanned_upwards_is_recognised_as_mirrored(tmp_path: Path) -> None:
    volume = counts().astype(np.float32)
    found = read_scan(heidelberg(tmp_path / "s.vol", volume, upwards=True), INDEX)
    np.testing.assert_array_equal(found.volume, volume[:, ::-1, :])
    assert "mirrored" in found.notes[-1]


def test_heidelberg_scans_that_lie_elsewhere_are_refused(tmp_path: Path) -> None:
    path = heidelberg(tmp_path / "s.vol", counts().astype(np.float32))
    data = bytearray(path.read_bytes())
    struct.pack_into("<I", data, 100, 256)
    path.write_bytes(data)
    with pytest.raises(ScanFileError, match=r"B-scan 1 of 8 isn't where .* version HSF-OCT-103"):
        read_scan(path, INDEX)


def test_heidelberg_sizes_beyond_the_file_and_circles_are_refused(tmp_path: Path) -> None:
    path = heidelberg(tmp_path / "s.vol", counts().astype(np.float32))
    data = bytearray(path.read_bytes())
    struct.pack_into("<3I", data, 12, 2**31, 2**31, 2**31)
    path.write_bytes(data)
    with pytest.raises(ScanFileError, match=r"no scan is larger|truncated"):
        read_scan(path, INDEX)
    heidelberg(path, counts().astype(np.float32), pattern=2)
    with pytest.raises(ScanFileError, match="isn't a volume"):
        read_scan(path, INDEX)
