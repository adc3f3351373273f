"""OCT spectra with known reflectors: depth, width, background, dispersion."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from registration import read_scan
from registration.errors import ScanFileError
from registration.scan import Scan

SAMPLES = 1024
POLYNOMIAL = [1230.0, 0.155, -1.75e-5]
"""Wavelength over a sample's number: the chirp of a grating spectrometer."""

DEPTHS_MM = (0.231, 0.7774, 1.4)
Floats = NDArray[np.float64]


def wavelengths() -> Floats:
    return np.asarray(np.polynomial.Polynomial(POLYNOMIAL)(np.arange(SAMPLES)))


def source(wavelength: Floats) -> Floats:
    return np.asarray(np.exp(-(((wavelength - 1300) / 40) ** 2)))


def interference(depths: Any, dispersion: tuple[float, float] = (0.0, 0.0)) -> Floats:
    """Spectra of one reflector each, (depths, samples): two-beam interference, counts."""
    wavelength = wavelengths()
    wavenumber = 2 * np.pi / (wavelength * 1e-6)
    u = 2 * (wavenumber - wavenumber.min()) / np.ptp(wavenumber) - 1
    extra = dispersion[0] * u**2 + dispersion[1] * u**3
    fringe = np.cos(2 * np.outer(depths, wavenumber) + extra)
    return np.asarray(2000 * source(wavelength) * (1 + 0.1 * fringe) + 300)


def scan_of(tmp_path: Path, spectra: Floats, **said: Any) -> Scan:
    """Two equal B-scans in a raw file of 16 bit, read back."""
    counts = np.round(np.stack([spectra, spectra])).astype("<u2")
    (tmp_path / "s.raw").write_bytes(counts.tobytes())
    np.savetxt(tmp_path / "dark.txt", 2000 * source(wavelengths()) + 300)
    known = {"wavelength_polynomial_nm": POLYNOMIAL, "spacing_mm": [0.02, 0.01], **said}
    beside = {
        "shape": list(counts.shape), "dtype": "uint16", "byte_order": "little", "axes": "yxz",
        "refractive_index": 1.0, "spectra": {k: v for k, v in known.items() if v is not None},
    }  # fmt: skip
    (tmp_path / "s.yaml").write_text(yaml.safe_dump(beside))
    return read_scan(tmp_path / "s.raw")


def peak(profile: Floats) -> tuple[float, float]:
    """Place and full width at half maximum of the highest peak, in voxels."""
    top = int(np.argmax(profile))
    around = np.arange(max(0, top - 12), min(len(profile), top + 13))
    fine = np.linspace(around[0], around[-1], 24 * 200 + 1)
    curve = np.exp(CubicSpline(around, np.log(profile[around]))(fine))
    above = fine[curve >= curve.max() / 2]
    return float(fine[np.argmax(curve)]), float(above[-1] - above[0])


@cache
def limit(voxel: float) -> float:
    """Width that the source and a Hann window over the band allow, in voxels."""
    wavenumber = np.linspace(*(2 * np.pi / (wavelengths()[[-1, 0]] * 1e-6)), 4096)
    weight = source(2e6 * np.pi / wavenumber) * np.hanning(4096)
    depth = np.linspace(0, 20 * voxel, 4001)
    amplitude = np.abs(np.exp(-2j * np.outer(depth, wavenumber - wavenumber.mean())) @ weight)
    return float(2 * depth[np.argmax(amplitude**2 < 0.5 * amplitude[0] ** 2)] / voxel)


def check(found: Scan) -> None:
    """Depths within a tenth of a voxel, widths within 10 % of the transform limit."""
    voxel = found.voxel_mm[0]
    for line, depth in enumerate(DEPTHS_MM):
        place, width = peak(found.volume[:, 1, line].astype(float))
        assert place == pytest.approx(depth / voxel, abs=0.1)
        assert width == pytest.approx(limit(voxel), rel=0.1)


@pytest.mark.parametrize("background", ["auto", "dark.txt"])
def test_reflectors_lie_where_they_are(tmp_path: Path, background: str) -> None:
    # Many depths, so that the mean of a B-scan holds no fringe.
    others = np.random.default_rng(0).uniform(0.1, 1.8, 200)
    spectra = interference([*DEPTHS_MM, *others])
    found = scan_of(tmp_path, spectra, background=background)
    assert (found.scale, found.optical_depth, found.modality) == ("linear", True, "oct")
    assert found.volume.shape == (SAMPLES // 2, 2, 203)
    assert found.voxel_mm[1:] == (0.02, 0.01)
    assert "made from spectra" in found.notes[0]
    check(found)


def test_a_table_says_the_same_as_a_polynomial(tmp_path: Path) -> None:
    np.savetxt(tmp_path / "nm.txt", wavelengths())
    spectra = interference(DEPTHS_MM)
    by_file = {"wavelength_polynomial_nm": None, "wavelength_nm": "nm.txt"}
    check(scan_of(tmp_path, spectra, background="dark.txt", **by_file))
    by_list = {"wavelength_polynomial_nm": None, "wavelength_nm": wavelengths().tolist()}
    check(scan_of(tmp_path, spectra, background="dark.txt", **by_list))


def test_dispersion_is_taken_out(tmp_path: Path) -> None:
    spectra = interference(DEPTHS_MM, (9.0, 3.0))
    blurred = scan_of(tmp_path, spectra, background="dark.txt")
    width = peak(blurred.volume[:, 0, 1].astype(float))[1]
    assert width > 1.5 * limit(blurred.voxel_mm[0])
    check(scan_of(tmp_path, spectra, background="dark.txt", dispersion=[9.0, 3.0]))


@pytest.mark.parametrize(
    ("said", "reason"),
    [
        ({"wavelength_nm": [1230, 1370]}, "give wavelength_nm"),
        ({"wavelength_polynomial_nm": None}, "give wavelength_nm"),
        ({"wavelength_polynomial_nm": [1300.0, 1.0, -0.01]}, "rise or all fall|above 0"),
        ({"wavelength_polynomial_nm": None, "wavelength_nm": [1.0, 2.0, 3.0]}, "3 values"),
        ({"spacing_mm": None}, "spacing_mm"),
        ({"window": "magic"}, "window is 'magic'"),
        ({"dispersion": [1.0]}, "dispersion"),
        ({"background": "../dark.txt"}, "isn't in its folder"),
        ({"colour": 1}, "give it the keys"),
    ],
)
def test_spectra_that_arent_described_are_refused(tmp_path, said, reason):
    with pytest.raises(ScanFileError, match=reason):
        scan_of(tmp_path, interference(DEPTHS_MM), **said)


@pytest.mark.parametrize(("mark", "name"), [(b"CMDb", r"\.e2e"), (b"FOCT", r"\.fda")])
def test_files_that_arent_read_are_refused_by_name(tmp_path: Path, mark: bytes, name: str) -> None:
    (tmp_path / "s.bin").write_bytes(mark + bytes(600))
    with pytest.raises(ScanFileError, match=name):
        read_scan(tmp_path / "s.bin")
