"""Readers of OME-TIFF, ImageJ, NIfTI, NRRD, raw and npz: axes, units, broken files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import nibabel
import nrrd
import numpy as np
import pytest
import tifffile

from registration import ScanOverrides, read_scan
from registration.errors import ScanFileError
from tests.registration.files.readers.crafted import MODALITY, OCT, counts


def same(path: Path, voxel: tuple[float, float, float], said: ScanOverrides = MODALITY) -> None:
    found = read_scan(path, said)
    np.testing.assert_array_equal(found.volume, counts())
    assert found.voxel_mm == pytest.approx(voxel)
    assert found.volume.flags.c_contiguous
    assert found.volume.dtype.isnative


@pytest.mark.parametrize("byteorder", ["<", ">"])
def test_ome_tiff_says_its_sizes(tmp_path: Path, byteorder: Any) -> None:
    sizes = {
        "PhysicalSizeX": 1.5, "PhysicalSizeXUnit": "µm", "PhysicalSizeY": 2500.0,
        "PhysicalSizeYUnit": "nm", "PhysicalSizeZ": 0.003, "PhysicalSizeZUnit": "mm",
    }  # fmt: skip
    path = tmp_path / "s.ome.tif"
    tifffile.imwrite(path, counts(), byteorder=byteorder, metadata={"axes": "ZYX", **sizes})
    same(path, (0.003, 0.0025, 0.0015))


def test_ome_tiff_with_channels_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "s.ome.tif"
    tifffile.imwrite(path, np.stack([counts()] * 2), metadata={"axes": "CZYX"})
    with pytest.raises(ScanFileError, match="2 channels"):
        read_scan(path, MODALITY)


@pytest.mark.parametrize(
    ("said", "across", "spacing"),
    [
        ({"unit": "micron", "zunit": "mm"}, (4, 5), 0.01),
        ({"unit": "mm", "zunit": "um"}, (0.004, 0.005), 10),
        ({"unit": "um", "yunit": "mm", "zunit": "mm"}, (4, 0.005), 0.01),
        ({"unit": "\\u00B5m"}, (4, 5), 10),
        ({"unit": "inch", "zunit": "um"}, (0.004 / 25.4, 0.005 / 25.4), -10),
    ],
)
def test_imagej_has_a_unit_for_each_axis(tmp_path, said, across, spacing):
    path = tmp_path / "s.tif"
    per_unit = (1 / across[0], 1 / across[1])
    more = {"spacing": spacing, "axes": "ZYX", **said}
    tifffile.imwrite(path, counts(), imagej=True, resolution=per_unit, metadata=more)
    same(path, (0.01, 0.005, 0.004))


def test_an_imagej_unit_that_isnt_known_is_named_and_the_users_size_taken(tmp_path: Path) -> None:
    path = tmp_path / "s.tif"
    said = {"spacing": 1.0, "unit": "furlong", "axes": "ZYX"}
    tifffile.imwrite(path, counts(), imagej=True, resolution=(1, 1), metadata=said)
    with pytest.raises(ScanFileError, match=r"give --voxel-um.*'furlong' isn't known"):
        read_scan(path, MODALITY)
    same(path, (0.01, 0.02, 0.03), SIZED)


SIZED = ScanOverrides(modality="microct", scale="linear", voxel_mm=(0.01, 0.02, 0.03))


@pytest.mark.parametrize("limit", [0, 1 << 20])
@pytest.mark.parametrize(("kind", "white"), [("u1", 255), (">u2", 65535), ("i2", -1)])
def test_white_is_zero_is_inverted(tmp_path, monkeypatch, kind, white, limit):
    """Of volumes that are read whole, and of such as are too large for it."""
    monkeypatch.setattr("registration.files.readers.tiff.IN_MEMORY_BYTES", limit)
    path, dark = tmp_path / "s.tif", (counts() % 100).astype(kind)
    tifffile.imwrite(path, dark, photometric="miniswhite", metadata=None)
    found = read_scan(path, SIZED)
    np.testing.assert_array_equal(found.volume.astype(int), white - dark.astype(int))
    assert "WhiteIsZero" in found.notes[0]


def test_a_palette_of_greys_is_looked_up_and_one_of_colours_refused(tmp_path: Path) -> None:
    path, values = tmp_path / "s.tif", (counts() % 256).astype(np.uint8)
    greys = np.tile(65535 - 257 * np.arange(256), (3, 1)).astype(np.uint16)
    tifffile.imwrite(path, values, photometric="palette", colormap=greys, metadata=None)
    found = read_scan(path, SIZED).volume
    np.testing.assert_array_equal(found, 65535 - 257 * values.astype(int))
    greys[0] = 0
    tifffile.imwrite(path, values, photometric="palette", colormap=greys, metadata=None)
    with pytest.raises(ScanFileError, match="colours of a palette"):
        read_scan(path, SIZED)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("images=80\nslices=80", "80 images, it holds 9"),
        ("images=18\nslices=9\nframes=2", "18 images, it holds 9"),
        ("images=9\nframes=9", "points in time"),
        ("images=6\nslices=6", None),
        ("images=9\nslices=9", None),
    ],
)
def test_imagej_images_are_counted(tmp_path: Path, text: str, why: str | None) -> None:
    path, words = tmp_path / "s.tif", f"ImageJ=1.53t\n{text}\n"
    tifffile.imwrite(
        path, counts(), photometric="minisblack", description=words, metadata=None, software=False
    )
    if why is None:
        found = read_scan(path, SIZED)
        np.testing.assert_array_equal(found.volume, counts())
        assert ("names 6 images, it holds 9" in " ".join(found.notes)) == ("6" in text)
        return
    with pytest.raises(ScanFileError, match=why):
        read_scan(path, SIZED)


def test_a_compression_that_isnt_read_is_named(tmp_path: Path) -> None:
    path = tmp_path / "s.tif"
    tifffile.imwrite(path, counts(), metadata=None)
    data = path.read_bytes()
    tag = b"\x03\x01\x03\x00\x01\x00\x00\x00"
    path.write_bytes(data.replace(tag + b"\x01\x00", tag + b"\x05\x00"))
    with pytest.raises(ScanFileError, match="compressed by LZW, which isn't read"):
        read_scan(path, SIZED)


def slices(folder: Path, **names: Any) -> Path:
    folder.mkdir()
    for name, image in names.items():
        tifffile.imwrite(folder / f"{name}.tif", image, metadata=None, photometric="minisblack")
    return folder


def test_numbered_slices_in_a_folder_are_a_stack(tmp_path: Path) -> None:
    """In the order of their numbers; whatever else is there is left and told."""
    folder = slices(tmp_path / "ct", **{f"rec{n + 1}": page for n, page in enumerate(counts())})
    (folder / "rec.log").write_text("x")
    (folder / "._rec1.tif").write_bytes(b"x")
    (folder / "overview.tif").write_bytes(b"x")
    same(folder, (0.01, 0.02, 0.03), SIZED)
    assert "3 other files" in " ".join(read_scan(folder, SIZED).notes)
    with pytest.raises(ScanFileError, match="--voxel-um"):
        read_scan(folder, MODALITY)


@pytest.mark.parametrize("name", ["scan2_s{}_x10", "t000_z{:03}_c001", "{}_of_9"])
def test_the_number_that_varies_orders_the_slices(tmp_path: Path, name: str) -> None:
    pages = np.concatenate([counts(), counts()[::-1] + 1])
    folder = slices(tmp_path / "ct", **{name.format(n): page for n, page in enumerate(pages)})
    np.testing.assert_array_equal(read_scan(folder, SIZED).volume, pages)


def test_slices_that_are_missing_are_told(tmp_path: Path) -> None:
    page = counts()[0]
    folder = slices(tmp_path / "ct", slice2=page, slice10=page + 1, slice1=page)
    found = read_scan(folder, SIZED)
    np.testing.assert_array_equal(found.volume, [page, page, page + 1])
    assert "missing between slice2.tif and slice10.tif" in " ".join(found.notes)
    even = slices(tmp_path / "even", s0010=page, s0020=page, s0030=page)
    assert "missing" not in " ".join(read_scan(even, SIZED).notes)


@pytest.mark.parametrize(
    ("second", "image", "why"),
    [
        ("a2", counts()[0, :-1], r"differ in size or type \(a1.tif: .*; a2.tif"),
        ("a2", counts()[0].astype("f4"), "a2.tif: .* of float32"),
        ("a01", counts()[0], "have one number"),
        ("b2", counts()[0], "several series"),
        ("a2", counts(), "a2.tif: holds 9 images"),
        ("about", counts()[0], "one slice"),
    ],
)
def test_slices_that_are_no_stack_are_refused_by_name(tmp_path, second, image, why):
    folder = slices(tmp_path / "ct", a1=counts()[0], **{second: image})
    with pytest.raises(ScanFileError, match=why):
        read_scan(folder, SIZED)


def test_bare_oct_stack_is_asked_for_the_order_of_its_axes(tmp_path: Path) -> None:
    path = tmp_path / "s.tif"
    pages_of_b_scans = np.ascontiguousarray(counts().transpose(1, 0, 2))
    tifffile.imwrite(path, pages_of_b_scans, photometric="minisblack", metadata=None)
    size = {"voxel_mm": (0.01, 0.02, 0.03), "scale": "linear", "modality": "oct"}
    size |= {"refractive_index": 1.34, "optical_depth": True}
    with pytest.raises(ScanFileError, match="--axes"):
        read_scan(path, ScanOverrides(**size))  # type: ignore[arg-type]
    same(path, (0.01, 0.02, 0.03), ScanOverrides(**size, axes="yzx"))  # type: ignore[arg-type]
    with pytest.raises(ScanFileError, match="order of x, y and z"):
        read_scan(path, ScanOverrides(**size, axes="zzx"))  # type: ignore[arg-type]


def nifti(path: Path, affine: Any, volume: Any = None) -> Path:
    data = counts() if volume is None else volume
    image = nibabel.Nifti1Image(np.asfortranarray(data.T), affine)
    image.header.set_xyzt_units("mm")
    nibabel.save(image, path)
    return path


@pytest.mark.parametrize("name", ["s.nii", "s.nii.gz"])
def test_nifti_comes_back(tmp_path: Path, name: str) -> None:
    path = nifti(tmp_path / name, np.diag([0.03, 0.02, 0.01, 1]))
    same(path, (0.01, 0.02, 0.03))
    assert read_scan(path, MODALITY).handedness == "right"


def test_mirrored_nifti_is_recognised(tmp_path: Path) -> None:
    path = nifti(tmp_path / "s.nii", np.diag([-0.03, 0.02, 0.01, 1]))
    found = read_scan(path, MODALITY)
    np.testing.assert_array_equal(found.volume, counts()[:, ::-1, :])
    assert "mirrored" in found.notes[0]
    # The user knows better.
    np.testing.assert_array_equal(
        read_scan(path, ScanOverrides(modality="microct", scale="linear", mirrored=False)).volume,
        counts(),
    )


def test_giant_nifti_header_is_refused(tmp_path: Path) -> None:
    path = nifti(tmp_path / "s.nii", np.eye(4))
    data = bytearray(path.read_bytes())
    data[40:48] = np.array([3, 32000, 32000, 32000], "<i2").tobytes()
    path.write_bytes(data)
    with pytest.raises(ScanFileError, match=r"truncated|no scan is larger"):
        read_scan(path, MODALITY)


def write_nrrd(path: Path, **changes: Any) -> Path:
    header = {
        "space": "right-anterior-superior", "space directions": np.diag([0.03, 0.02, 0.01]),
        "space units": ["mm"] * 3, "encoding": "raw",
    }  # fmt: skip
    nrrd.write(str(path), counts(), {**header, **changes}, index_order="C")
    return path


@pytest.mark.parametrize("encoding", ["raw", "gzip"])
@pytest.mark.parametrize("name", ["s.nrrd", "s.nhdr"])
def test_nrrd_comes_back(tmp_path: Path, encoding: str, name: str) -> None:
    same(write_nrrd(tmp_path / name, encoding=encoding), (0.01, 0.02, 0.03))


@pytest.mark.parametrize(
    ("space", "first", "mirrored"),
    [
        ("left-posterior-superior", 0.03, False),
        ("left-posterior-superior", -0.03, True),
        ("left-anterior-superior", 0.03, True),
    ],
)
def test_nrrd_orientation_is_heeded(tmp_path, space, first, mirrored):
    directions = np.diag([first, 0.02, 0.01])
    path = write_nrrd(tmp_path / "s.nrrd", **{"space": space, "space directions": directions})
    found = read_scan(path, MODALITY)
    expected = counts()[:, ::-1] if mirrored else counts()
    np.testing.assert_array_equal(found.volume, expected)
    assert found.handedness == "right"


def test_nrrd_data_elsewhere_is_refused(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    path = write_nrrd(tmp_path / "in" / "s.nhdr")
    (tmp_path / "in" / "s.raw").rename(tmp_path / "s.raw")
    path.write_text(path.read_text().replace("s.raw", "../s.raw"))
    with pytest.raises(ScanFileError, match="isn't in its folder"):
        read_scan(path, MODALITY)


RAW = {
    "shape": [8, 7, 9], "axes": "yxz", "dtype": "uint16", "byte_order": "big",
    "offset_bytes": 5, "voxel_mm": [0.01, 0.02, 0.03], "modality": "microct", "scale": "linear",
}  # fmt: skip


def raw(path: Path, **changes: Any) -> Path:
    path.write_bytes(b"12345" + counts().transpose(1, 2, 0).astype(">u2").tobytes())
    path.with_suffix(".yaml").write_text(json.dumps(RAW | changes))
    return path


def test_raw_numbers_are_read_by_their_sidecar(tmp_path: Path) -> None:
    same(raw(tmp_path / "s.raw"), (0.01, 0.02, 0.03), ScanOverrides())


@pytest.mark.parametrize("axes", ["zyx", "zxy", "yzx", "yxz", "xzy", "xyz"])
def test_every_order_of_axes_comes_back(tmp_path: Path, axes: str) -> None:
    volume = counts().transpose(["zyx".index(name) for name in axes])
    (tmp_path / "s.raw").write_bytes(np.ascontiguousarray(volume).tobytes())
    said = {"shape": list(volume.shape), "axes": axes, "byte_order": "little", "offset_bytes": 0}
    (tmp_path / "s.json").write_text(json.dumps(RAW | said))
    same(tmp_path / "s.raw", (0.01, 0.02, 0.03), ScanOverrides())


@pytest.mark.parametrize(("axes", "mirrored"), [("yzx", True), ("yxz", False), ("zyx", False)])
def test_axes_named_otherwise_keep_their_handedness(tmp_path, axes, mirrored):
    path = nifti(tmp_path / "s.nii", np.diag([0.03, 0.02, 0.01, 1]))
    found = read_scan(path, ScanOverrides(modality="microct", scale="linear", axes=axes))
    named = counts().transpose([axes.index(name) for name in "zyx"])
    np.testing.assert_array_equal(found.volume, named[:, ::-1] if mirrored else named)
    # Each size stays with its axis, whatever that is called.
    sizes = dict(zip(axes, (0.01, 0.02, 0.03), strict=True))
    assert found.voxel_mm == pytest.approx([sizes[name] for name in "zyx"])


@pytest.mark.parametrize(
    ("key", "value", "reason"),
    [
        ("shape", [8, 7, 10], "holds 1008 bytes"),
        ("shape", [8, 7], "three whole numbers"),
        ("shape", [8, 7, -9], "three whole numbers"),
        ("shape", [10**9, 10**9, 10**9], "no scan is larger"),
        ("dtype", "float16", "known are"),
        ("dtype", "object", "known are"),
        ("byte_order", None, "little or big"),
        ("axes", "yx", "order of x, y and z"),
        ("colour", "red", "unknown key"),
    ],
)
def test_a_sidecar_that_doesnt_fit_is_refused(tmp_path, key, value, reason):
    with pytest.raises(ScanFileError, match=reason):
        read_scan(raw(tmp_path / "s.raw", **{key: value}))


def test_npz_that_claims_more_than_it_holds_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "s.npz"
    np.savez(path, volume=counts(), voxel_mm=[0.1] * 3)
    path.write_bytes(path.read_bytes().replace(b"(9, 8, 7), ", b"(99999, 8, 7),"[:11]))
    with pytest.raises(ScanFileError):
        read_scan(path, MODALITY)


def test_npz_of_python_objects_is_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "s.npz", volume=np.array([[[{"a": 1}]]]))
    with pytest.raises(ScanFileError, match="Python objects"):
        read_scan(tmp_path / "s.npz", OCT)
