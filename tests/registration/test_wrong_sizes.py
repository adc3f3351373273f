"""Scans that can't show the part, by a wrong unit, and scans of noise alone are refused plainly."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from registration import register_scan
from registration.errors import RegistrationError, SegmentationError
from registration.scan import Scan
from registration.segmentation import segment
from tests.registration.phantom import ladder, ladder_construct


def scan(voxel_mm: float) -> Scan:
    values = np.random.default_rng(0).exponential(100, (60, 60, 60)).astype(np.float32)
    return Scan(values, (voxel_mm,) * 3, 1.34, False, "linear", "oct", True, Path("noise"))


@pytest.mark.parametrize(("voxel_mm", "extent"), [(2e-5, "0.0012"), (4.0, "240")])
def test_a_scan_in_a_wrong_unit_is_refused_with_both_sizes(voxel_mm: float, extent: str) -> None:
    with pytest.raises(RegistrationError, match=f"the scan is {extent} × .*check --voxel-um"):
        register_scan(scan(voxel_mm), ladder_construct(), ladder())


@pytest.mark.filterwarnings("error")
def test_noise_alone_is_refused_without_a_warning() -> None:
    with pytest.raises(SegmentationError, match="can't be told apart"):
        segment(scan(0.03))
