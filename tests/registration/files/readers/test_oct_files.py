"""Readers of OCT files: Thorlabs, Bioptigen, Heidelberg."""

import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest

from registration import ScanOverrides, read_scan
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
