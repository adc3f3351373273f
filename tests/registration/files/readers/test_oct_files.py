"""Readers of OCT files: Thorlabs, raw spectra with known reflectors, Bioptigen, Heidelberg."""

import struct
import zipfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from registration import Scan, ScanOverrides, read_scan
from registration.errors import ScanFileError
from tests.registration.files.readers.crafted import OCT, bioptigen, counts, heidelberg, thorlabs

INDEX = ScanOverrides(refractive_index=1.34)


@pytest.mark.parametrize("folder", ["data\\", "data/"])
@pytest.mark.parametrize("compression", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_depth_fastest_floats_come_back_as_z_y_x(tmp_path, folder, compression):
    volume = counts().astype(np.float32)
    path = thorlabs(tmp_path / "s.oct", volume, folder=folder, compression=compression)
    found = read_scan(path, INDEX)
    np.testing.assert_array_equal(found.volume, volume)
    assert found.volume.flags.c_contiguous
    assert found.voxel_mm == (0.003, 0.012, 0.010)
    assert (found.scale, found.modality, found.depth_down) == ("db", "oct", True)
    assert found.handedness == "unknown"
    assert found.origins["voxel_mm"] == "file"
    assert found.origins["refractive_index"] == "option"


def test_index_of_one_says_that_depth_is_optical(tmp_path: Path) -> None:
    path = thorlabs(tmp_path / "s.oct", counts().astype(np.float32), index="1.0")
    with pytest.raises(ScanFileError, match="--refractive-index"):
        read_scan(path)
    found = read_scan(path, INDEX)
    assert found.optical_depth
    assert found.geometric_voxel_mm[0] == pytest.approx(0.003 / 1.34)


def test_axis_order_in_the_header_is_heeded(tmp_path: Path) -> None:
    volume = counts().astype(np.float32)
    path = thorlabs(tmp_path / "s.oct", volume, extra="<AxisOrder>XZY</AxisOrder>")
    with zipfile.ZipFile(path) as archive:
        header = archive.read("Header.xml")
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("Header.xml", header)
        archive.writestr(
            "data/Intensity.data", np.ascontiguousarray(volume.transpose(1, 0, 2)).tobytes()
        )
    np.testing.assert_array_equal(read_scan(path, INDEX).volume, volume)


def test_swapped_axes_are_caught_by_the_aspect(tmp_path: Path) -> None:
    volume = counts(40, 30, 20).astype(np.float32)
    extent = (40 * 0.003, 30 * 0.010, 20 * 0.012)
    path = thorlabs(tmp_path / "s.oct", volume, extent=extent)
    with pytest.raises(ScanFileError, match="axes y and x are swapped"):
        read_scan(path, INDEX)
    path = thorlabs(tmp_path / "s.oct", volume, extent=(1.0, 2.0, 3.0))
    with pytest.raises(ScanFileError, match="contradicts itself"):
        read_scan(path, INDEX)


def rewritten(path: Path, old: str, new: str) -> Path:
    """The same file with its header changed."""
    with zipfile.ZipFile(path) as archive:
        members = {info.filename: archive.read(info) for info in archive.infolist()}
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in members.items():
            archive.writestr(name, data.replace(old.encode(), new.encode()))
    return path


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("<SizeZ>9</SizeZ>", "<SizeZ>10</SizeZ>", "array"),
        ('SizeZ="9"', 'SizeZ="8"', "swapped or the header is broken"),
        ("<SizeZ>9</SizeZ>", "<SizeZ>-9</SizeZ>", "sizes"),
        ("<SizeZ>9</SizeZ>", "<SizeZ>nine</SizeZ>", "no number"),
        ("<RefractiveIndex>1.0", "<RefractiveIndex>glass", "RefractiveIndex"),
        ("<RefractiveIndex>1.0", "<RefractiveIndex>13.4", "1 to 2"),
        ("</Ocity>", "", "broken XML"),
        ("<Ocity>", "<!DOCTYPE x [<!ENTITY a 'b'>]><Ocity>", "entities"),
        ('BytesPerPixel="4"', 'BytesPerPixel="2"', "2 BytesPerPixel"),
    ],
)
def test_a_header_that_lies_is_refused(tmp_path: Path, old: str, new: str, reason: str) -> None:
    path = rewritten(thorlabs(tmp_path / "s.oct", counts().astype(np.float32)), old, new)
    with pytest.raises(ScanFileError, match=reason):
        read_scan(path)


def test_giant_sizes_raw_spectra_alone_and_nan_are_refused(tmp_path: Path) -> None:
    path = thorlabs(tmp_path / "s.oct", counts().astype(np.float32))
    for size in ("30000", "300000000"):
        rewritten(path, "<SizeZ>9</SizeZ>", f"<SizeZ>{size}</SizeZ>")
        rewritten(path, 'SizeZ="9"', f'SizeZ="{size}"')
        with pytest.raises(ScanFileError, match=r"sizes are wrong|no scan is larger"):
            read_scan(path, INDEX)
    path = thorlabs(tmp_path / "s.oct", counts().astype(np.float32), folder="data/Raw")
    with pytest.raises(ScanFileError, match="store processed data"):
        read_scan(path, INDEX)
    volume = counts().astype(np.float32)
    volume[3, 2, 1] = np.nan
    volume[3, 2, 2] = -np.inf
    with pytest.raises(ScanFileError, match="2 of 504 voxels are NaN or infinite"):
        read_scan(thorlabs(tmp_path / "s.oct", volume), INDEX)


def test_names_that_climb_out_of_the_folder_write_nothing(tmp_path: Path) -> None:
    inner = tmp_path / "a" / "b"
    inner.mkdir(parents=True)
    evil = {"../../evil.txt": b"x", "..\\..\\evil.txt": b"x", "/evil.txt": b"x"}
    path = thorlabs(inner / "s.oct", counts().astype(np.float32), members=evil)
    read_scan(path, INDEX)
    files = sorted(place.name for place in tmp_path.rglob("*") if place.is_file())
    assert files == ["s.oct"]


def test_depth_already_divided_is_not_divided_again(tmp_path: Path) -> None:
    path = thorlabs(tmp_path / "s.oct", counts().astype(np.float32), index="1.33")
    found = read_scan(path)
    assert not found.optical_depth
    assert found.refractive_index == 1.33
    assert found.geometric_voxel_mm[0] == 0.003
    # Another index replaces the one that the program divided by.
    other = read_scan(path, ScanOverrides(refractive_index=1.40))
    assert other.geometric_voxel_mm[0] == pytest.approx(0.003 * 1.33 / 1.40)


# Thorlabs files with raw spectra


RAW_SAMPLES, LINES, SCANS, DARK = 512, 6, 3, 4
PLACES = (60.0, 101.37, 180.8)
"""Of reflectors, in voxels of depth."""


def chirp() -> NDArray[np.float32]:
    share = np.arange(RAW_SAMPLES) / (RAW_SAMPLES - 1)
    return ((RAW_SAMPLES - 1) * (0.9 * share + 0.1 * share**2)).astype(np.float32)


def b_scan(scan: int) -> NDArray[np.uint16]:
    """One B-scan: lines without sample, then A-scans of one reflector each."""
    place = chirp().astype(float)
    source = 2000 * np.exp(-(((place - 256) / 130) ** 2)) + 200
    lines = [source] * DARK
    for line in range(LINES):
        turns = PLACES[(line + scan) % 3] * place / RAW_SAMPLES
        lines.append(source * (1 + 0.2 * np.cos(2 * np.pi * turns + line)))
    return np.round(np.array(lines)).astype("<u2")


def write_raw(
    path: Path, *, averaged: int = 1, leave: str = "", depths: int = RAW_SAMPLES // 2, way: int = 1
) -> Path:
    sizes = {"SizePixel": (depths, LINES, SCANS), "PixelSpacing": (0.003, 0.01, 0.02)}
    rows = "".join(
        f"<{name}><SizeZ>{z}</SizeZ><SizeX>{x}</SizeX><SizeY>{y}</SizeY></{name}>"
        for name, (z, x, y) in sizes.items()
    )
    files = "".join(
        f'<DataFile Type="Raw" SizeZ="{RAW_SAMPLES}" SizeX="{DARK + LINES}" BytesPerPixel="2" '
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
    members = {f"data\\Spectral{n}.data": b_scan(n).tobytes() for n in range(SCANS)}
    members |= {"Header.xml": header.encode(), "data\\Chirp.data": chirp()[::way].tobytes()}
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in members.items():
            if name != leave:
                archive.writestr(name, data)
    return path


def test_reflectors_of_a_thorlabs_file_lie_where_they_are(tmp_path: Path) -> None:
    found = read_scan(write_raw(tmp_path / "s.oct"), INDEX)
    assert found.volume.shape == (RAW_SAMPLES // 2, SCANS, LINES)
    assert found.voxel_mm == (0.003, 0.02, 0.01)
    assert (found.scale, found.optical_depth) == ("linear", True)
    assert "not verified on a device's file" in found.notes[0]
    for scan in range(SCANS):
        for line in range(LINES):
            place, _ = peak(found.volume[:, scan, line].astype(float))
            assert place == pytest.approx(PLACES[(line + scan) % 3], abs=0.1)


def test_raw_spectra_that_arent_certain_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ScanFileError, match=r"SlowAxis 2.*export processed data"):
        read_scan(write_raw(tmp_path / "a.oct", averaged=2), INDEX)
    with pytest.raises(ScanFileError, match="Spectral2 of 3 B-scans is missing"):
        read_scan(write_raw(tmp_path / "b.oct", leave="data\\Spectral2.data"), INDEX)
    with pytest.raises(ScanFileError, match=r"without Chirp\.data"):
        read_scan(write_raw(tmp_path / "c.oct", leave="data\\Chirp.data"), INDEX)
    with pytest.raises(ScanFileError, match="256 depths, but the image is Z 200"):
        read_scan(write_raw(tmp_path / "d.oct", depths=200), INDEX)
    with pytest.raises(ScanFileError, match=r"chirp runs from 511 to 0 \(needed: rising"):
        read_scan(write_raw(tmp_path / "e.oct", way=-1), INDEX)


# Spectra in other files


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
def transform_limit(voxel: float) -> float:
    """Width that the source and a Hann window over the band allow, in voxels."""
    wavenumber = np.linspace(*(2 * np.pi / (wavelengths()[[-1, 0]] * 1e-6)), 4096)
    weight = source(2e6 * np.pi / wavenumber) * np.hanning(4096)
    depth = np.linspace(0, 20 * voxel, 4001)
    amplitude = np.abs(np.exp(-2j * np.outer(depth, wavenumber - wavenumber.mean())) @ weight)
    return float(2 * depth[np.argmax(amplitude**2 < 0.5 * amplitude[0] ** 2)] / voxel)


def check_reflectors(found: Scan) -> None:
    """Depths within a tenth of a voxel, widths within 10 % of the transform limit."""
    voxel = found.voxel_mm[0]
    for line, depth in enumerate(DEPTHS_MM):
        place, width = peak(found.volume[:, 1, line].astype(float))
        assert place == pytest.approx(depth / voxel, abs=0.1)
        assert width == pytest.approx(transform_limit(voxel), rel=0.1)


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
    check_reflectors(found)


def test_a_table_says_the_same_as_a_polynomial(tmp_path: Path) -> None:
    np.savetxt(tmp_path / "nm.txt", wavelengths())
    spectra = interference(DEPTHS_MM)
    by_file = {"wavelength_polynomial_nm": None, "wavelength_nm": "nm.txt"}
    check_reflectors(scan_of(tmp_path, spectra, background="dark.txt", **by_file))
    by_list = {"wavelength_polynomial_nm": None, "wavelength_nm": wavelengths().tolist()}
    check_reflectors(scan_of(tmp_path, spectra, background="dark.txt", **by_list))


def test_dispersion_is_taken_out(tmp_path: Path) -> None:
    spectra = interference(DEPTHS_MM, (9.0, 3.0))
    blurred = scan_of(tmp_path, spectra, background="dark.txt")
    width = peak(blurred.volume[:, 0, 1].astype(float))[1]
    assert width > 1.5 * transform_limit(blurred.voxel_mm[0])
    check_reflectors(scan_of(tmp_path, spectra, background="dark.txt", dispersion=[9.0, 3.0]))


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


# Bioptigen and Heidelberg


EYE = ScanOverrides(refractive_index=1.36, optical_depth=False)


def test_bioptigen_volume_comes_back(tmp_path: Path) -> None:
    found = read_scan(bioptigen(tmp_path / "s.OCT", counts()), OCT)
    np.testing.assert_array_equal(found.volume, counts())
    assert found.voxel_mm == pytest.approx((1.5 / 9, 3.0 / 8, 2.0 / 7))
    assert any("not verified" in note for note in found.notes)


@pytest.mark.parametrize("upwards", [False, True])
def test_heidelberg_volume_comes_back(tmp_path: Path, upwards: bool) -> None:
    volume = counts().astype(np.float32) / 1000
    found = read_scan(heidelberg(tmp_path / "s.vol", volume, upwards=upwards), EYE)
    np.testing.assert_array_equal(found.volume, volume[:, ::-1, :] if upwards else volume)
    assert found.voxel_mm == (0.004, 0.05, 0.011)
    assert found.scale == "linear"
    assert found.handedness == "right"
    assert ("mirrored" in " ".join(found.notes)) is upwards


@pytest.mark.parametrize(
    ("at", "number", "pattern", "reason"),
    [
        (100, (256,), 3, r"B-scan 1 of 8 isn't where .* version HSF-OCT-103"),
        (12, (2**31, 2**31, 2**31), 3, r"no scan is larger|truncated"),
        (100, (), 2, "isn't a volume"),
    ],
)
def test_heidelberg_files_that_are_no_volume_are_refused(tmp_path, at, number, pattern, reason):
    path = heidelberg(tmp_path / "s.vol", counts().astype(np.float32), pattern=pattern)
    data = bytearray(path.read_bytes())
    struct.pack_into(f"<{len(number)}I", data, at, *number)
    path.write_bytes(data)
    with pytest.raises(ScanFileError, match=reason):
        read_scan(path, EYE)
