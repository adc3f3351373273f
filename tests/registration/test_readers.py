"""Scan readers: round trips, broken files, slabs of volumes larger than memory."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from registration import Scan, ScanOverrides, read_scan, write_scan_tiff
from registration.errors import ScanFileError
from registration.files.readers import common
from registration.files.readers.metadata import describe
from registration.files.readers.volumes import tiff
from registration.files.writers import write_scan_zarr
from tests.registration.files.readers.crafted import MODALITY, OCT, counts, scan, thorlabs
from tests.slower import examples


def plain_scan(**changes: Any) -> Scan:
    volume = np.random.default_rng(0).integers(0, 60000, (9, 8, 7)).astype(np.uint16)
    known: dict[str, Any] = {
        "volume": volume, "voxel_mm": (0.02, 0.03, 0.031), "refractive_index": 1.34,
        "optical_depth": True, "scale": "linear", "modality": "oct", "depth_down": True,
        "came_from": Path("x"),
    }  # fmt: skip
    return Scan(**(known | changes))


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "int16", "float32"])
@pytest.mark.parametrize("compress", [False, True])
def test_tiff_comes_back_exactly(tmp_path: Path, dtype: str, compress: bool) -> None:
    path = tmp_path / "scan.tif"
    original = plain_scan(volume=plain_scan().volume.astype(dtype), scale="db")
    write_scan_tiff(path, original, compress=compress)
    found = read_scan(path)
    np.testing.assert_array_equal(found.volume, original.volume)
    assert found.volume.dtype == original.volume.dtype
    for name in ("voxel_mm", "refractive_index", "optical_depth", "scale", "modality"):
        assert getattr(found, name) == getattr(original, name)
    assert found.depth_down
    assert found.came_from == path


@given(
    voxel=st.tuples(*[st.floats(1e-4, 5.0)] * 3),
    index=st.floats(1.0, 2.0),
    scale=st.sampled_from(["linear", "db"]),
    down=st.booleans(),
)
@settings(
    max_examples=examples(20),
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
def test_any_units_come_back(tmp_path, voxel, index, scale, down):
    original = plain_scan(voxel_mm=voxel, refractive_index=index, scale=scale, depth_down=down)
    write_scan_tiff(tmp_path / "s.tif", original)
    found = read_scan(tmp_path / "s.tif")
    assert (found.voxel_mm, found.refractive_index) == (voxel, index)
    assert (found.scale, found.depth_down) == (scale, down)


def bare_tiff(path: Path) -> Path:
    tifffile.imwrite(path, plain_scan().volume, photometric="minisblack", metadata=None)
    return path


def test_oct_without_index_asks_for_it_and_microct_needs_none(tmp_path: Path) -> None:
    said = ScanOverrides(voxel_mm=(0.1, 0.1, 0.1), scale="linear", modality="oct")
    with pytest.raises(ScanFileError, match=r"--refractive-index, --optical-depth"):
        read_scan(bare_tiff(tmp_path / "s.tif"), said)
    said = ScanOverrides(voxel_mm=(0.1, 0.1, 0.1), scale="linear", modality="microct")
    found = read_scan(bare_tiff(tmp_path / "s.tif"), said)
    assert found.refractive_index == 1.0
    assert not found.depth_down
    assert found.geometric_voxel_mm == (0.1, 0.1, 0.1)


def test_sidecar_completes_and_the_user_overrules(tmp_path: Path) -> None:
    path = bare_tiff(tmp_path / "s.tif")
    known = {"voxel_mm": [0.1, 0.1, 0.1], "scale": "linear", "modality": "microct"}
    path.with_suffix(".json").write_text(json.dumps(known))
    assert read_scan(path).voxel_mm == (0.1, 0.1, 0.1)
    assert read_scan(path, ScanOverrides(voxel_mm=(0.2, 0.1, 0.1))).voxel_mm == (0.2, 0.1, 0.1)


@pytest.mark.parametrize(
    ("key", "value", "reason"),
    [
        ("voxel_mm", [0.1, 0.1], "three sizes"),
        ("voxel_mm", [0.1, 0.1, -1], "of 1e-05 to 5"),
        ("voxel_mm", [0.1, 0.1, float("nan")], "three sizes"),
        ("voxel_mm", [100, 30, 30], "of 1e-05 to 5"),
        ("refractive_index", 13.4, "1 to 2"),
        ("scale", "log", "scale"),
        ("modality", "mri", "modality"),
        ("depth_down", "yes", "true or false"),
        ("voxel_um", [1, 2, 3], "unknown key"),
    ],
)
def test_impossible_metadata_is_refused(tmp_path, key, value, reason):
    path = bare_tiff(tmp_path / "s.tif")
    known = {"voxel_mm": [0.1] * 3, "scale": "linear", "modality": "microct", key: value}
    path.with_suffix(".json").write_text(json.dumps(known))
    with pytest.raises(ScanFileError, match=reason):
        read_scan(path)


@pytest.mark.parametrize("wrong", [0.1, [0.1, 0.1], ["a", "b", "c"], {"z": 1}, None, "0.1"])
def test_nonsense_in_the_file_gives_way_to_the_user(tmp_path: Path, wrong: object) -> None:
    path = tmp_path / "s.tif"
    text = json.dumps(json.loads(describe(plain_scan(optical_depth=False))) | {"voxel_mm": wrong})
    tifffile.imwrite(path, plain_scan().volume, description=text, metadata=None)
    said = ScanOverrides(voxel_mm=(0.1, 0.2, 0.3), refractive_index=1.4, axes="zxy")
    assert read_scan(path, said).voxel_mm == (0.1, 0.2, 0.3)
    with pytest.raises(ScanFileError, match="voxel_mm"):
        read_scan(path, ScanOverrides(refractive_index=1.4, axes="zxy"))


def test_other_files_and_colour_stacks_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "s.tif"
    path.write_bytes(b"solid block")
    with pytest.raises(ScanFileError, match="no known format"):
        read_scan(path)
    with pytest.raises(ScanFileError, match="no such scan"):
        read_scan(tmp_path / "none.tif")
    tifffile.imwrite(path, np.zeros((9, 8, 7, 3), np.uint8), photometric="rgb", metadata=None)
    with pytest.raises(ScanFileError, match="grey images"):
        read_scan(path, ScanOverrides((0.1, 0.1, 0.1), 1.0, False, "linear", "microct", False))


def test_failed_write_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "s.tif"
    write_scan_tiff(path, plain_scan())
    before = path.read_bytes()
    broken = plain_scan(volume=np.full((2, 2, 2), object()))
    with pytest.raises((ValueError, TypeError, KeyError)):
        write_scan_tiff(path, broken)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


# Slabs cover a scan once, in order, in whole bins.


def binned(volume: np.ndarray, bins: tuple[int, int, int]) -> np.ndarray:
    """Mean of whole bins, the plain way."""
    nz, ny, nx = (n // b for n, b in zip(volume.shape, bins, strict=True))
    whole = volume[: nz * bins[0], : ny * bins[1], : nx * bins[2]].astype(float)
    return whole.reshape(nz, bins[0], ny, bins[1], nx, bins[2]).mean(axis=(1, 3, 5))


def by_slabs(item: Scan, bins: tuple[int, int, int], slab_bytes: int) -> np.ndarray:
    out = np.full([n // b for n, b in zip(item.volume.shape, bins, strict=True)], np.nan)
    for slab in item.slabs(bins, slab_bytes):
        assert slab.voxels.flags.c_contiguous
        assert slab.voxels.dtype.isnative
        assert np.isnan(out[slab.where]).all()
        out[slab.where] = binned(slab.voxels, bins)
    return out


@given(
    shape=st.tuples(*[st.integers(1, 12)] * 3),
    bins=st.tuples(*[st.integers(1, 5)] * 3),
    order=st.permutations((0, 1, 2)),
    slab_bytes=st.integers(1, 3000),
    kind=st.sampled_from(["<u2", ">u2", "f4"]),
)
@settings(max_examples=examples(60), deadline=None)
def test_slabs_bin_as_the_whole_does(shape, bins, order, slab_bytes, kind):
    volume = counts(*shape).astype(kind).transpose(order)
    item = scan(volume=volume)
    expected = binned(volume, bins)
    if expected.size:
        np.testing.assert_allclose(by_slabs(item, bins, slab_bytes), expected)
    else:
        assert list(item.slabs(bins, slab_bytes)) == []


@pytest.fixture
def tiny_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (common, tiff):
        monkeypatch.setattr(module, "IN_MEMORY_BYTES", 100)


@pytest.mark.usefixtures("tiny_memory")
def test_a_volume_larger_than_memory_stays_a_view_of_its_file(tmp_path: Path) -> None:
    path = thorlabs(tmp_path / "s.oct", counts().astype(np.float32))
    before = path.read_bytes()
    found = read_scan(path, OCT)
    assert isinstance(found.volume, np.memmap)
    np.testing.assert_array_equal(found.volume, counts())
    np.testing.assert_allclose(by_slabs(found, (2, 2, 2), 300), binned(counts(), (2, 2, 2)))
    found.volume[0, 0, 0] = 1e9  # type: ignore[call-overload]
    assert path.read_bytes() == before
    tifffile.imwrite(tmp_path / "s.tif", counts(), photometric="minisblack", metadata=None)
    path.with_suffix(".json").write_text('{"voxel_mm": [0.1, 0.1, 0.1]}')
    assert isinstance(read_scan(tmp_path / "s.tif", MODALITY).volume, np.memmap)


@pytest.mark.usefixtures("tiny_memory")
def test_a_decoded_volume_larger_than_memory_lives_in_a_nameless_file(tmp_path: Path) -> None:
    write_scan_zarr(tmp_path / "s.zarr", scan())
    found = read_scan(tmp_path / "s.zarr")
    assert isinstance(found.volume, np.memmap)
    np.testing.assert_array_equal(found.volume, counts())
    assert [place.name for place in tmp_path.iterdir()] == ["s.zarr"]
