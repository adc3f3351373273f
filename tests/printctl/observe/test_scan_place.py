"""A scan of another place, size or spacing is told as that."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from printctl.observe.devices import DeviceError
from printctl.observe.learned import Learned
from printctl.observe.scan_place import ScanSize, refuse_elsewhere
from registration.files.readers.heights import HeightMap
from registration.inspection import ExpectedLines
from registration.scan import Scan

TO_SCAN = np.array([[1.0, 0, 0, -100], [0, 1, 0, -50], [0, 0, -1, 3], [0, 0, 0, 1]])
"""The scan's corner at x 100, y 50; its first section at z 3."""


def scan(voxel_mm: tuple[float, float, float], shape: tuple[int, int, int]) -> Scan:
    empty = np.zeros(shape, np.uint8)
    return Scan(empty, voxel_mm, 1.0, False, "linear", "oct", True, Path("painted"))


def lines() -> ExpectedLines:
    y = np.linspace(51.0, 54.0, 7)
    start = np.column_stack([np.full(7, 101.0), y, np.full(7, 2.0)])
    each, fresh = np.arange(7), np.ones(7, dtype=np.bool_)
    return ExpectedLines(start, start + [4.0, 0, 0], np.full(7, 0.2), each, each, fresh)


@pytest.mark.parametrize(
    ("voxel_mm", "shape", "share"),
    [
        (
            (0.02, 0.03, 0.012),
            (100, 200, 200),
            "40%",
        ),  # too narrow a spacing
        ((0.02, 0.03, 0.03), (100, 60, 200), "29%"),  # a third of the sections
        ((0.005, 0.03, 0.03), (100, 200, 200), "0%"),  # not as deep
    ],
)
def test_a_scan_of_other_spacing_or_size_says_what_it_holds(
    voxel_mm: tuple[float, float, float], shape: tuple[int, int, int], share: str
) -> None:
    with pytest.raises(DeviceError, match="of the lines lie in the scan: they are at x 101") as no:
        refuse_elsewhere(ScanSize.of(scan(voxel_mm, shape), TO_SCAN), lines())
    assert str(no.value).startswith(share)
    assert "correct the voxel size" in str(no.value)


def test_a_scan_that_tells_nothing_of_another_spacing_than_the_last_is_refused() -> None:
    sizes = [ScanSize.of(scan((0.02, y, 0.03), (100, 200, 200)), TO_SCAN) for y in (0.03, 0.06)]
    assert (
        Learned().size_words(sizes[1]).startswith("the scan has 200 × 200 × 100 voxels of 30 × 60")
    )
    known = Learned().with_size(sizes[0])
    assert known.size_words(sizes[0]).startswith("the scan has")
    with pytest.raises(DeviceError, match=r"30 × 60 × 20 .* the last one that did had .* 30 × 30"):
        known.size_words(sizes[1])


def test_a_height_map_that_holds_the_lines_passes_whatever_its_heights() -> None:
    to_map = np.array([[1.0, 0, 0, -100], [0, 1, 0, -50], [0, 0, 1, -2], [0, 0, 0, 1]])
    heights = np.full((200, 200), 7.0, np.float32)
    whole = ScanSize.of_heights(HeightMap(heights, (0.03, 0.03)), to_map)
    refuse_elsewhere(whole, lines())
    assert whole.words == (
        "200 × 200 heights of 30 × 30 µm (x, y) and covers x 100.00 to 105.97, y 50.00 to 55.97 mm"
    )
    narrow = ScanSize.of_heights(HeightMap(heights[:60], (0.03, 0.03)), to_map)
    with pytest.raises(DeviceError, match=r"29% of the lines .* the scan has 200 × 60 heights"):
        refuse_elsewhere(narrow, lines())
