"""Thorlabs files with raw spectra: chirp, background, sizes, refusals."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from registration import ScanOverrides, read_scan
from registration.errors import ScanFileError
from tests.registration.files.readers.test_spectra import peak

SAMPLES, LINES, SCANS, DARK = 512, 6, 3, 4
PLACES = (60.0, 101.37, 180.8)
"""Of reflectors, in voxels of depth."""

INDEX = ScanOverrides(refractive_index=1.34)


def chirp() -> NDArray[np.float32]:
    share = np.arange(SAMPLES) / (SAMPLES - 1)
    return ((SAMPLES - 1) * (0.9 * share + 0.1 * share**2)).astype(np.float32)


def spectra(scan: int) -> NDArray[np.uint16]:
    """One B-scan: lines without sample, then A-scans of one reflector each."""
    place = chirp().astype(float)
    source = 2000 * np.exp(-(((place - 256) / 130) ** 2)) + 200
    lines = [source] * DARK
    for line in range(LINES):
        turns = PLACES[(line + scan) % 3] * place / SAMPLES
        lines.append(source * (1 + 0.2 * np.cos(2 * np.pi * turns + line)))
    return np.round(np.array(lines)).astype("<u2")


def write(path: Path, *, averaged: int = 1, leave: str = "", depths: int = SAMPLES // 2) -> Path:
    sizes = {"SizePixel": (depths, LINES, SCANS), "PixelSpacing": (0.003, 0.01, 0.02)}
    rows = "".join(
        f"<{name}><SizeZ>{z}</SizeZ><SizeX>{x}</SizeX><SizeY>{y}</SizeY></{name}>"
        for name, (z, x, y) in sizes.items()
    )
    files = "".join(
        f'<DataFile Type="Raw" SizeZ="{SAMPLES}" SizeX="{DARK + LINES}" BytesPerPixel="2" '
        f'ApoRegionStart0="0" ApoRegionEnd0="{DARK}" ScanRegionStart0="{DARK}" '
        f'ScanRegionEnd0="{DARK + LINES}">data\\Spectral{n}.data</DataFile>'
        for n in range(SCANS)
    )
    header = (
        "<Ocity><Acquisition><RefractiveIndex>1.0</RefractiveIndex><SpeckleAveraging>"
        f"<SlowAxis>{averaged}</SlowAxis></SpeckleAveraging></Acquisition>"
        f'<Image Type="RawSpectra">{rows}<AxisOrder>ZXYT</AxisOrder></Image>'
        f"<Instrument><RawDataIsSigned>False</RawDataIsSigned></Instrument>"
        f"<DataFiles>{files}</DataFiles></Ocity>"
    )
    members = {f"data\\Spectral{n}.data": spectra(n).tobytes() for n in range(SCANS)}
    members |= {"Header.xml": header.encode(), "data\\Chirp.data": chirp().tobytes()}
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in members.items():
            if name != leave:
                archive.writestr(name, data)
    return path


def test_reflectors_lie_where_they_are(tmp_path: Path) -> None:
    found = read_scan(write(tmp_path / "s.oct"), INDEX)
    assert found.volume.shape == (SAMPLES // 2, SCANS, LINES)
    assert found.voxel_mm == (0.003, 0.02, 0.01)
    assert (found.scale, found.optical_depth) == ("linear", True)
    assert "not verified on a device's file" in found.notes[0]
    for scan in range(SCANS):
        for line in range(LINES):
            place, _ = peak(found.volume[:, scan, line].astype(float))
            assert place == pytest.approx(PLACES[(line + scan) % 3], abs=0.1)


def test_what_isnt_certain_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ScanFileError, match=r"SlowAxis 2.*export processed data"):
        read_scan(write(tmp_path / "a.oct", averaged=2), INDEX)
    with pytest.raises(ScanFileError, match="Spectral2 of 3 B-scans is missing"):
        read_scan(write(tmp_path / "b.oct", leave="data\\Spectral2.data"), INDEX)
    with pytest.raises(ScanFileError, match=r"without Chirp\.data"):
        read_scan(write(tmp_path / "c.oct", leave="data\\Chirp.data"), INDEX)
    with pytest.raises(ScanFileError, match="256 depths, but the image is Z 200"):
        read_scan(write(tmp_path / "d.oct", depths=200), INDEX)
