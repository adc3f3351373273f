"""Height maps and points of laser profilers, as their programs export them."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from registration.errors import ScanFileError
from registration.files.readers.heights import read_heights

PIXEL = (0.02, 0.05)


@pytest.fixture
def heights() -> np.ndarray:
    """20 rows of 30 heights, mm, one of them lost."""
    rows, columns = np.indices((20, 30))
    out = np.round(1.0 + 0.01 * columns + 0.002 * rows, 4).astype(np.float32)
    out[3, 4] = np.nan
    return out


def test_heights_as_floats(tmp_path: Path, heights: np.ndarray) -> None:
    cv2.imwrite(str(tmp_path / "a.tif"), heights)
    np.save(tmp_path / "a.npy", heights)
    np.savez(tmp_path / "a.npz", height_mm=heights, pixel_mm=np.array(PIXEL))
    for name in ("a.tif", "a.npy", "a.npz"):
        found = read_heights(tmp_path / name, None if name == "a.npz" else PIXEL)
        np.testing.assert_array_equal(found.height_mm, heights)
        assert found.pixel_mm == PIXEL


@pytest.mark.parametrize("name", ["a.png", "a.tif"])
def test_counts_of_16_bits_are_scaled_and_0_is_lost(tmp_path, heights, name):
    counts = np.where(np.isnan(heights), 0, np.round(heights * 1e4)).astype(np.uint16)
    cv2.imwrite(str(tmp_path / name), counts)
    found = read_heights(tmp_path / name, PIXEL, count_mm=1e-4)
    np.testing.assert_allclose(found.height_mm, heights, atol=1e-6)


def test_a_table_of_heights_behind_a_header(tmp_path: Path, heights: np.ndarray) -> None:
    rows = [",".join(f"{z:.4f}" for z in row) for row in heights]
    (tmp_path / "a.csv").write_text("Profile data,mm\r\n0.02,0.05\r\n" + "\r\n".join(rows))
    with pytest.raises(ScanFileError, match="don't all have 2 numbers"):
        read_heights(tmp_path / "a.csv", PIXEL, lost=-1.0)
    (tmp_path / "a.csv").write_text("Profile data,mm\r\n" + "\r\n".join(rows) + "\r\n")
    np.testing.assert_allclose(
        read_heights(tmp_path / "a.csv", PIXEL).height_mm, heights, atol=1e-6
    )


@pytest.mark.parametrize(
    ("name", "split", "point"), [("a.csv", ",", "."), ("a.csv", ";", ","), ("a.xyz", " ", ".")]
)
def test_points_are_laid_into_cells(tmp_path, heights, name, split, point):
    rows, columns = np.nonzero(np.isfinite(heights))
    order = np.random.default_rng(1).permutation(len(rows))
    rows, columns = rows[order], columns[order]
    lines = [
        split.join(f"{v:.4f}".replace(".", point) for v in (5 + 0.02 * x, -3 + 0.05 * y, 1e3 * z))
        for x, y, z in zip(columns, rows, heights[rows, columns], strict=True)
    ]
    (tmp_path / name).write_text(f"x{split}y{split}z\n" + "\n".join(lines))
    found = read_heights(tmp_path / name, PIXEL, count_mm=1e-3)
    np.testing.assert_allclose(found.height_mm, heights, atol=1e-4)
    assert found.origin_mm == pytest.approx((5.0, -3.0))


def test_several_points_of_a_cell_are_averaged_and_lost_ones_left_out(tmp_path: Path) -> None:
    x, y = (one.ravel() for one in np.meshgrid(np.arange(20.0), np.arange(20.0)))
    points = np.column_stack([x, y, np.ones(400)])
    twice = np.vstack([points, points + (0.2, -0.2, 0.5), [(1e9, 1e9, -1e9), (3, 3, np.nan)]])
    np.save(tmp_path / "a.npy", twice)
    found = read_heights(tmp_path / "a.npy", (1.0, 1.0))
    assert found.height_mm.shape == (20, 20)
    np.testing.assert_allclose(found.height_mm, 1.25)


def test_what_is_no_height_map_is_told(tmp_path: Path, heights: np.ndarray) -> None:
    def refused(name: str, said: str, pixel: tuple[float, float] | None = PIXEL) -> None:
        with pytest.raises(ScanFileError, match=said):
            read_heights(tmp_path / name, pixel)

    cv2.imwrite(str(tmp_path / "grey.png"), np.zeros((20, 20), np.uint8))
    refused("grey.png", "array of uint8")
    np.save(tmp_path / "a.npy", heights)
    refused("a.npy", r"pixel_mm: \[x, y\]", None)
    whole = (tmp_path / "a.npy").read_bytes()
    (tmp_path / "a.npy").write_bytes(whole[:200])
    refused("a.npy", "broken height map")
    (tmp_path / "a.npz").write_bytes(b"PK" + bytes(80))
    refused("a.npz", "broken height map")
    (tmp_path / "a.csv").write_text("x,y,z\n1,2,3\n4,5")
    refused("a.csv", "cut off")
    (tmp_path / "b.csv").write_text("nothing here\n")
    refused("b.csv", "no line of numbers")
    (tmp_path / "c.csv").write_text("\n".join(f"{k},{k},1" for k in range(40)))
    refused("c.csv", r"1951 x 781 cells|correct pixel_mm", (1e-3, 1e-6))
    refused("gone.tif", "isn't a height map")
