"""Fuzzed scan files: read or refused, never another exception."""

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from scipy.io import savemat

from registration import ScanOverrides, read_scan
from registration.errors import ScanFileError
from registration.files.writers import write_scan_zarr
from tests.registration.files.readers.crafted import bioptigen, counts, heidelberg, scan, thorlabs
from tests.registration.files.readers.oriented import write_enhanced
from tests.registration.files.readers.test_images import metaimage, nifti, write_nrrd
from tests.registration.files.readers.test_libraries import UPRIGHT, hdf5

ALL = ScanOverrides((0.01, 0.02, 0.03), 1.34, True, "linear", "oct", True, "zyx")


MICRONS = {"axes": "ZYX", "PhysicalSizeX": 1.0}
FORMATS: dict[str, Callable[[Path], Any]] = {
    "a.oct": lambda path: thorlabs(path, counts().astype(np.float32)),
    "b.oct": lambda path: thorlabs(path, counts().astype(np.float32), compression=8),
    "c.OCT": lambda path: bioptigen(path, counts()),
    "d.vol": lambda path: heidelberg(path, counts().astype(np.float32)),
    "e.tif": lambda path: tifffile.imwrite(path, counts(), metadata=MICRONS, ome=True),
    "f.tif": lambda path: tifffile.imwrite(path, counts(), compression="zlib", metadata=None),
    "g.nii": lambda path: nifti(path, np.eye(4)),
    "h.nii.gz": lambda path: nifti(path, np.eye(4)),
    "i.nrrd": write_nrrd,
    "j.nrrd": lambda path: write_nrrd(path, encoding="gzip"),
    "q.mha": metaimage,
    "r.mha": lambda path: metaimage(path, CompressedData=True),
    "k.dcm": lambda path: write_enhanced(path, UPRIGHT),
    "l.h5": hdf5,
    "m.mat": lambda path: savemat(path, {"V": counts()}),
    "n.npz": lambda path: np.savez(path, volume=counts(), voxel_mm=[0.1] * 3),
    "o.npz": lambda path: np.savez_compressed(path, volume=counts()),
    "p.zarr": lambda path: write_scan_zarr(path, scan()),
}


@pytest.mark.parametrize("name", list(FORMATS))
def test_bytes_gone_wrong_end_with_a_reason(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    FORMATS[name](path)
    file = path / "0" / ".zarray" if path.is_dir() else path
    good = file.read_bytes()
    rng = np.random.default_rng(7)
    refused = 0
    for turn in range(60):
        data = bytearray(good)
        # Headers are where it hurts: half of the changes go there.
        most = min(len(data), 400) if turn % 2 else len(data)
        for at in rng.integers(0, most, int(rng.integers(1, 4))):
            data[at] = int(rng.choice([0, 255, 127, int(rng.integers(256))]))
        file.write_bytes(data[: int(rng.integers(1, len(data)))] if turn % 5 == 0 else data)
        with warnings.catch_warnings():
            # Libraries warn of what they mend.
            warnings.simplefilter("ignore")
            try:
                found = read_scan(path, ALL)
            except ScanFileError:
                refused += 1
            else:
                assert found.volume.ndim == 3
    assert refused > 5
