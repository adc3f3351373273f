"""Slab-wise processing: slabs cover a scan once, in order, in whole bins."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import tifffile
from hypothesis import given, settings
from hypothesis import strategies as st

from registration import read_scan
from registration.files.readers import common, tiff
from registration.files.writers import write_scan_zarr
from registration.scan import Scan
from tests.registration.files.readers.crafted import MODALITY, OCT, counts, scan, thorlabs
from tests.slower import examples


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
    for module in (common, tiff, common):
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
