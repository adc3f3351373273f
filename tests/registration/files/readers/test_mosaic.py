"""Mosaics: positions of overlapping scans recovered."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

from registration import ScanOverrides, write_scan_tiff
from registration.errors import ScanFileError
from registration.files.readers.mosaic import is_mosaic, read_mosaic
from tests.registration.files.readers.crafted import scan

VOXEL = (0.02, 0.03, 0.03)
SHAPE = (60, 90, 100)


def scene() -> NDArray[np.float32]:
    rng = np.random.default_rng(5)
    smooth = gaussian_filter(rng.normal(size=SHAPE), 2.5)
    return (1000 + 4000 * smooth / smooth.std()).astype(np.float32)


def cut(corner: Any, size: Any, seed: int, noise: float = 800.0) -> NDArray[np.float32]:
    """A part of the scene with noise of its own; the corner (z, y, x) may lie between voxels."""
    places = np.indices(size).reshape(3, -1) + np.array(corner, dtype=float)[:, None]
    part = map_coordinates(scene(), places, order=3).reshape(size)
    return (part + np.random.default_rng(seed).normal(0, noise, size)).astype(np.float32)


def listed(
    folder: Path, kind: str, parts: list[tuple[Any, Any, Any]], noise: float = 800.0
) -> Path:
    """Parts (true corner, size, listed corner), written with their list."""
    scans = []
    for number, (corner, size, said) in enumerate(parts):
        part = scan(
            volume=cut(corner, size, number, noise), voxel_mm=VOXEL, optical_depth=False,
            refractive_index=1.34,
        )  # fmt: skip
        write_scan_tiff(folder / f"{number}.tif", part)
        at = [float(v) for v in (np.array(said) * VOXEL)[::-1]]
        scans.append({"file": f"{number}.tif", "at_mm": at})
    path = folder / "all.yaml"
    path.write_text(yaml.safe_dump({"mosaic": kind, "settle_um": 300, "scans": scans}))
    return path


TILES = [
    ((0, 0, 0), (60, 50, 60), (0, 0, 0)),
    ((0, 0, 40), (60, 50, 60), (1, -3, 44)),
    ((0, 40, 0), (60, 50, 60), (0, 45, -2)),
    ((0, 40, 40), (60, 50, 60), (-2, 38, 36)),
]


def test_tiles_find_their_places(tmp_path: Path) -> None:
    path = listed(tmp_path, "tiles", TILES)
    assert is_mosaic(path)
    found = read_mosaic(path)
    assert found.volume.shape == SHAPE
    inner = found.volume[5:55, 5:85, 5:95]
    assert np.corrcoef(inner.ravel(), scene()[5:55, 5:85, 5:95].ravel())[0, 1] > 0.97
    assert "4 scans fused (tiles), 4 overlaps; moved by up to" in found.notes[-1]


@pytest.mark.slow
def test_parts_of_a_voxel_are_found(tmp_path: Path) -> None:
    parts = [((0, 0, 0), (60, 90, 60), (0, 0, 0)), ((0.4, 1.3, 35.7), (58, 86, 60), (0, 0, 37))]
    found = read_mosaic(listed(tmp_path, "tiles", parts, noise=100.0))
    # Where both overlap, the blend is as sharp and right as the parts.
    band = (slice(5, 50), slice(8, 80), slice(40, 56))
    off = found.volume[band] - scene()[band]
    assert np.abs(off).mean() < 0.06 * scene().std()


def test_noise_alone_leaves_scans_where_they_are_listed(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    path = listed(tmp_path, "tiles", TILES[:2])
    for number in range(2):
        noise = rng.normal(1000, 100, (60, 50, 60)).astype(np.float32)
        write_scan_tiff(tmp_path / f"{number}.tif", scan(volume=noise, voxel_mm=VOXEL))
    found = read_mosaic(path)
    assert "1 overlaps show too little" in found.notes[-1]


def test_scans_that_dont_belong_together_are_refused(tmp_path: Path) -> None:
    far = [TILES[0], ((0, 0, 40), (60, 50, 60), (0, 0, 400))]
    with pytest.raises(ScanFileError, match="overlaps none"):
        read_mosaic(listed(tmp_path, "tiles", far))
    path = listed(tmp_path, "tiles", TILES[:2])
    write_scan_tiff(tmp_path / "1.tif", scan(voxel_mm=(0.02, 0.03, 0.04)))
    with pytest.raises(ScanFileError, match="scan all parts alike"):
        read_mosaic(path)
    path.write_text(path.read_text().replace("1.tif", "2.tif"))
    with pytest.raises(ScanFileError, match="no such scan"):
        read_mosaic(path, ScanOverrides())


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("a: [", "not YAML"),
        ("{mosaic: heap, scans: []}", "isn't a mosaic"),
        ("{mosaic: tiles, scans: []}", "2 to 1000"),
        ("{mosaic: tiles, colour: red}", "isn't a mosaic"),
        ("{mosaic: tiles, scans: [1, 2]}", "isn't {file"),
        ("{mosaic: tiles, scans: [{file: a, at_mm: [0, 0, .nan]}, 2]}", "within"),
        ("{mosaic: tiles, settle_um: -1, scans: [1, 2]}", "0 to 5000"),
    ],
)
def test_a_list_that_cant_be_used_is_refused(tmp_path: Path, text: str, reason: str) -> None:
    path = tmp_path / "all.yaml"
    path.write_text(text)
    with pytest.raises(ScanFileError, match=reason):
        read_mosaic(path)
