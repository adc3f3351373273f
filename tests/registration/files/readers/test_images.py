"""Readers of OME-TIFF, ImageJ, NIfTI, NRRD, raw, npz; grey values in dB; height maps; mosaics."""

import gzip
import json
import zlib
from pathlib import Path
from typing import Any

import cv2
import nibabel
import nrrd
import numpy as np
import pytest
import tifffile
import yaml
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

from registration import Scan, ScanOverrides, read_scan, write_scan_tiff
from registration.errors import ScanFileError
from registration.files.readers.decibels import speckle_of
from registration.files.readers.heights import read_heights
from registration.files.readers.mosaic import is_mosaic, read_mosaic
from tests.registration.files.readers.crafted import MODALITY, OCT, counts, scan


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


@pytest.mark.parametrize("unit", ["reference frame", "pixel", "Å", "furlong"])
def test_the_users_size_wins_over_an_ome_unit(tmp_path: Path, unit: str) -> None:
    sizes = {f"PhysicalSize{name}": by for name, by in zip("XYZ", (3e5, 2e5, 1e5), strict=True)}
    units = {f"PhysicalSize{name}Unit": unit for name in "XYZ"}
    path = tmp_path / "s.ome.tif"
    tifffile.imwrite(path, counts(), ome=True, metadata={"axes": "ZYX", **sizes, **units})
    same(path, (0.01, 0.02, 0.03), SIZED)
    if unit != "Å":
        with pytest.raises(ScanFileError, match="give --voxel-um"):
            read_scan(path, MODALITY)


SIZED = ScanOverrides(modality="microct", scale="linear", voxel_mm=(0.01, 0.02, 0.03))


@pytest.mark.parametrize("limit", [0, 1 << 20])
@pytest.mark.parametrize(("kind", "white"), [("u1", 255), (">u2", 65535), ("i2", -1)])
def test_white_is_zero_is_inverted(tmp_path, monkeypatch, kind, white, limit):
    """Of volumes that are read whole, and of such as are too large for it."""
    monkeypatch.setattr("registration.files.readers.volumes.tiff.IN_MEMORY_BYTES", limit)
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


@pytest.mark.parametrize("unit", ["µm", "μm", "um", "Micron", "microns", "micrometer", "Å", "pc"])
@pytest.mark.parametrize("coding", ["utf-8", "latin-1"])
def test_nrrd_units_mean_what_they_say_or_nothing(tmp_path: Path, unit: str, coding: str) -> None:
    path = tmp_path / "s.nrrd"
    by = 1e5 if unit == "Å" else 1
    head = [
        "NRRD0005", "# μ", "type: uint16", "dimension: 3", "sizes: 7 8 9", "endian: little",
        "encoding: raw", f"spacings: {30 * by} {20 * by} {10 * by}", "units:" + f' "{unit}"' * 3,
    ]  # fmt: skip
    text = "\n".join([*head, "", ""]).encode(coding, "replace")
    path.write_bytes(text + counts().astype("<u2").tobytes())
    if unit == "pc" or b"?" in text.rpartition(b"units")[2]:
        with pytest.raises(ScanFileError, match=r"give --voxel-um.* isn't known"):
            read_scan(path, MODALITY)
    else:
        same(path, (0.01, 0.02, 0.03) if unit != "Å" else (0.1, 0.2, 0.3))
    same(path, (0.01, 0.02, 0.03), SIZED)


PARTS = {"s07.raw": 0, "s05.raw": 3, "s03.raw": 6}


@pytest.mark.parametrize(
    "named", ["LIST\ns07.raw\ns05.raw\ns03.raw\n", "s%02d.raw 7 3 -2", "LIST 3\n{0}"]
)
@pytest.mark.parametrize("kind", ["nrrd", "mhd"])
@pytest.mark.parametrize("zipped", [False, True])
def test_data_in_several_files_are_read_in_order(tmp_path, named, kind, zipped):
    folder = tmp_path / "parts"
    folder.mkdir()
    for name, first in PARTS.items():
        data = counts()[first : first + 3].astype("<u2").tobytes()
        pack = gzip.compress if kind == "nrrd" else zlib.compress
        (folder / name).write_bytes(pack(data) if zipped else data)
    named = named.format("\n".join(PARTS)).replace("\ns", "\nparts/s").replace("s%", "parts/s%")
    path = tmp_path / f"s.{kind}"
    if kind == "nrrd":
        encoding = "gzip" if zipped else "raw"
        path.write_text(
            f"NRRD0004\ntype: uint16\ndimension: 3\nsizes: 7 8 9\nendian: little\n"
            f"encoding: {encoding}\ndata file: {named}"
        )
    else:
        path.write_text(meta(CompressedData=zipped, ElementDataFile=named))
    same(path, (0.01, 0.02, 0.03), SIZED)
    (folder / "s05.raw").unlink()
    with pytest.raises(ScanFileError, match=r"its data file 'parts/s05\.raw' isn't in its folder"):
        read_scan(path, SIZED)
    path.write_text(path.read_text().replace("3 -2", "4 -1").replace("parts/s05.raw\n", ""))
    with pytest.raises(ScanFileError, match=r"names [24] data files for 9 slices"):
        read_scan(path, SIZED)


def meta(**changes: object) -> str:
    """A header as ITK writes it."""
    fields = {
        "ObjectType": "Image", "NDims": 3, "BinaryData": True, "BinaryDataByteOrderMSB": False,
        "CompressedData": False, "TransformMatrix": "1 0 0 0 1 0 0 0 1", "Offset": "0 0 0",
        "CenterOfRotation": "0 0 0", "AnatomicalOrientation": "RAI",
        "ElementSpacing": "0.03 0.02 0.01", "DimSize": "7 8 9", "ElementType": "MET_USHORT",
        "ElementDataFile": "LOCAL",
    } | changes  # fmt: skip
    fields["ElementDataFile"] = fields.pop("ElementDataFile")
    return "".join(f"{name} = {value}\n" for name, value in fields.items())


def metaimage(path: Path, **changes: object) -> Path:
    data = counts().astype(">u2" if changes.get("BinaryDataByteOrderMSB") else "<u2").tobytes()
    path.write_bytes(meta(**changes).encode())
    data = zlib.compress(data) if changes.get("CompressedData") else data
    where = path.parent / str(changes.get("ElementDataFile", path.name))
    with where.open("ab") as handle:
        handle.write(bytes(max(int(str(changes.get("HeaderSize", 0))), 0)) + data)
    return path


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"BinaryDataByteOrderMSB": True},
        {"CompressedData": True, "CompressedDataSize": 100},
        {"ElementDataFile": "s one.raw", "HeaderSize": 12},
        {"ElementDataFile": "s one.zraw", "CompressedData": True},
        {"ElementDataFile": "s.raw", "HeaderSize": -1},
        {
            "NDims": 4,
            "DimSize": "7 8 9 1",
            "TransformMatrix": " ".join(map(str, np.eye(4).ravel())),
        },
    ],
)
def test_metaimages_come_back_with_the_size_that_the_user_states(tmp_path, changes):
    path = metaimage(tmp_path / "s.mha", **changes)
    same(path, (0.01, 0.02, 0.03), SIZED)
    assert read_scan(path, SIZED).handedness == "right"
    with pytest.raises(ScanFileError, match="if these are mm, as in ITK: --voxel-um 30,20,10"):
        read_scan(path, MODALITY)


def test_a_metaimage_that_is_mirrored_or_placed_is_told(tmp_path: Path) -> None:
    turned = {"TransformMatrix": "1 0 0 0 -1 0 0 0 1", "Offset": "4 5 6"}
    found = read_scan(metaimage(tmp_path / "s.mha", **turned), SIZED)
    np.testing.assert_array_equal(found.volume, counts()[:, ::-1])
    assert any("TransformMatrix and Offset aren't used" in note for note in found.notes)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"DimSize": "7 8 10"}, "truncated"),
        ({"DimSize": "7 8 10", "CompressedData": True}, "holds 1008 of 1120 bytes"),
        ({"DimSize": "9000000 9000000 9000000"}, "no scan is larger"),
        ({"DimSize": "7 8", "NDims": 2}, "has 2 axes"),
        ({"ElementNumberOfChannels": 3}, "3 values a voxel"),
        ({"BinaryData": False}, "in binary"),
        ({"ElementType": "MET_OTHER"}, "MET_OTHER aren't read"),
        ({"ElementDataFile": "../s.raw"}, "isn't in its folder"),
        ({"ElementSpacing": "a b c"}, "broken MetaImage"),
    ],
)
def test_a_metaimage_that_is_no_volume_is_refused(tmp_path, changes, reason):
    (tmp_path / "in").mkdir()
    with pytest.raises(ScanFileError, match=reason):
        read_scan(metaimage(tmp_path / "in" / "s.mha", **changes), SIZED)


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


def test_npz_of_python_objects_or_that_claims_more_than_it_holds_is_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "s.npz", volume=np.array([[[{"a": 1}]]]))
    with pytest.raises(ScanFileError, match="Python objects"):
        read_scan(tmp_path / "s.npz", OCT)
    path = tmp_path / "s.npz"
    np.savez(path, volume=counts(), voxel_mm=[0.1] * 3)
    path.write_bytes(path.read_bytes().replace(b"(9, 8, 7), ", b"(99999, 8, 7),"[:11]))
    with pytest.raises(ScanFileError):
        read_scan(path, MODALITY)


# Grey values that encode dB, saturation, confused scales


KNOWN: dict[str, Any] = {
    "axes": "zyx", "voxel_mm": [0.01, 0.02, 0.03], "modality": "oct", "optical_depth": True,
    "refractive_index": 1.34, "scale": "db",
}  # fmt: skip


def speckled(looks: int = 1, ratio: float = 100.0) -> NDArray[np.float64]:
    """Linear intensity of speckle (gamma law), dark liquid above bright gel, as z, y, x."""
    rng = np.random.default_rng(3)
    volume = rng.gamma(looks, 1 / looks, (40, 40, 40))
    volume[:20] /= ratio
    return volume


def in_db(volume: NDArray[np.float64]) -> NDArray[np.float64]:
    return 10 * np.log10(np.maximum(volume, 1e-9))


def raw_oct(path: Path, volume: NDArray[Any], **said: Any) -> Path:
    """A raw file with its sidecar."""
    beside = {**KNOWN, "shape": list(volume.shape), "dtype": volume.dtype.name, **said}
    if volume.dtype.itemsize > 1:
        beside["byte_order"] = "little"
    beside = {name: value for name, value in beside.items() if value is not None}
    path.with_suffix(".yaml").write_text(yaml.safe_dump(beside))
    path.write_bytes(volume.tobytes())
    return path


def to_counts(db: NDArray[np.float64], kind: str = "uint8") -> NDArray[Any]:
    """-40 to +20 dB over the range of a type, clipped."""
    info = np.iinfo(kind)
    share = np.clip((db + 40) / 60, 0, 1)
    return np.round(share * (int(info.max) - int(info.min)) + int(info.min)).astype(kind)


@pytest.mark.parametrize("kind", ["uint8", "int8", "uint16", "int16"])
def test_counts_of_a_window_become_decibels(tmp_path: Path, kind: str) -> None:
    db = in_db(speckled())
    path = raw_oct(tmp_path / "s.raw", to_counts(db, kind), db_range=[-40, 20])
    found = read_scan(path)
    assert (found.volume.dtype, found.scale) == (np.float32, "db")
    np.testing.assert_allclose(found.volume, np.clip(db, -40, 20), atol=0.51 * 60 / 255)


def test_a_window_over_other_counts_and_a_slope_say_the_same(tmp_path: Path) -> None:
    counts = np.round(np.clip((in_db(speckled()) + 40) / 60, 0, 1) * 4095).astype("<u2")
    window = raw_oct(tmp_path / "a.raw", counts, db_range=[-40, 20], count_range=[0, 4095])
    slope = raw_oct(tmp_path / "b.raw", counts, counts_per_db=4095 / 60, db_at_zero=-40)
    np.testing.assert_allclose(read_scan(window).volume, read_scan(slope).volume, atol=1e-4)
    # An option's description replaces the sidecar's.
    said = ScanOverrides(db_range=(0, 60), count_range=(0, 4095))
    moved = read_scan(slope, said).volume - read_scan(slope).volume
    np.testing.assert_allclose(moved, 40, atol=1e-4)


@pytest.mark.parametrize(
    ("said", "reason"),
    [
        ({}, "--db-range LOW,HIGH"),
        ({"db_range": [20, -40]}, "the lower one first"),
        ({"db_range": [-100, 101]}, r"spans 201 dB \(limit 200"),
        ({"db_range": [-40, 20], "counts_per_db": 4}, "not both"),
        ({"count_range": [0, 255]}, "without db_range"),
        ({"db_at_zero": 3}, "without counts_per_db"),
        ({"counts_per_db": 0}, "above 0"),
        ({"db_range": [-40, 20], "count_range": [0, 100]}, "beyond count_range"),
        ({"db_range": [-40, 20], "scale": "linear"}, "the scale is 'linear'"),
    ],
)
def test_counts_that_nobody_describes_are_refused(tmp_path, said, reason):
    with pytest.raises(ScanFileError, match=reason):
        read_scan(raw_oct(tmp_path / "s.raw", to_counts(in_db(speckled())), **said))


def test_whole_decibels_come_back_from_our_own_files(tmp_path: Path) -> None:
    volume = np.round(in_db(speckled())).astype(np.int16)
    scan = Scan(volume, (0.01, 0.02, 0.03), 1.34, True, "db", "oct", True, tmp_path)
    write_scan_tiff(tmp_path / "s.tif", scan)
    np.testing.assert_array_equal(read_scan(tmp_path / "s.tif").volume, volume)


@pytest.mark.parametrize("looks", [1, 4, 16])
@pytest.mark.parametrize("ratio", [3.0, 100.0])
def test_speckle_tells_the_scales_apart(looks: int, ratio: float) -> None:
    """Linear: spread grows as brightness, skewness 2 / √looks; dB: spread alike."""
    linear = speckled(looks, ratio).reshape(1000, 64)
    measured = speckle_of(linear)
    assert measured is not None
    assert measured.growth == pytest.approx(1, abs=0.1)
    assert measured.bright_spread / measured.bright == pytest.approx(looks**-0.5, rel=0.1)
    db = speckle_of(in_db(linear) + 60)
    assert db is not None
    assert (
        abs(np.log(db.bright_spread / db.dark_spread)) < 0.25
    )  # bright places are those without dark speckles
    assert db.skewness < 0.1
    if looks == 1:
        assert db.bright_spread == pytest.approx(5.57, rel=0.15)


@pytest.mark.parametrize("looks", [1, 4])
def test_decibels_given_as_linear_are_asked_about(tmp_path: Path, looks: int) -> None:
    counts = to_counts(in_db(speckled(looks)))
    path = raw_oct(tmp_path / "s.raw", counts, scale="linear")
    with pytest.raises(ScanFileError, match=r"looks like dB: it spreads by .* --db-range"):
        read_scan(path)
    insisted = read_scan(path, ScanOverrides(scale="linear"))
    assert "looks like dB" in insisted.notes[-1]
    np.testing.assert_array_equal(insisted.volume, counts)


@pytest.mark.parametrize("looks", [1, 4])
@pytest.mark.parametrize("factor", [1.0, 1e4])
def test_linear_given_as_decibels_is_asked_about(tmp_path: Path, looks: int, factor: float) -> None:
    path = raw_oct(tmp_path / "s.raw", (factor * speckled(looks)).astype("<f4"))
    with pytest.raises(ScanFileError, match=r"looks linear: .* --scale linear"):
        read_scan(path)
    assert "looks linear" in read_scan(path, ScanOverrides(scale="db")).notes[-1]


def test_saturated_voxels_are_told_with_their_share_and_refused_beyond_it(tmp_path: Path) -> None:
    """Exponential speckle cut at c times the gel's mean: exp(-c) of the gel, half the volume."""
    some = np.minimum(speckled(), -np.log(0.04))
    found = read_scan(raw_oct(tmp_path / "a.raw", some.astype("<f4"), scale="linear"))
    assert found.notes[0].startswith(f"{100 * (some == some.max()).mean():.1f}"[0])
    assert "saturated" in found.notes[0]
    many = np.minimum(speckled(), -np.log(0.3))
    with pytest.raises(ScanFileError, match=r"1[3-7] % of its voxels are saturated .*limit 10 %"):
        read_scan(raw_oct(tmp_path / "b.raw", many.astype("<f4"), scale="linear"))


@pytest.mark.parametrize(("scale", "share"), [("linear", 0.1), ("db", 0.8)])
def test_just_so_many_voxels_may_lie_at_an_end_of_the_numbers(tmp_path, scale, share):
    volume = (speckled() if scale == "linear" else in_db(speckled())).astype("<f4")
    ranked, most = np.sort(volume, axis=None), round(share * volume.size)
    at_end = (
        (lambda n: np.minimum(volume, ranked[-n]))
        if scale == "linear"
        else (lambda n: np.maximum(volume, ranked[n - 1]))
    )
    read_scan(raw_oct(tmp_path / "a.raw", at_end(most), scale=scale))
    with pytest.raises(ScanFileError, match=f"limit {100 * share:g} %"):
        read_scan(raw_oct(tmp_path / "b.raw", at_end(most + 1), scale=scale))


# Height maps and points of laser profilers


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


# Overlapping scans whose places are found


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
