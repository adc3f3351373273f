"""Readers of DICOM, HDF5, MATLAB and OME-Zarr; every orientation in every format."""

import importlib
import json
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import nibabel
import numcodecs
import numpy as np
import pydicom
import pytest
import tifffile
import zarr
from scipy.io import savemat

from registration import ScanOverrides, read_scan
from registration.errors import ScanFileError
from registration.files.readers.common import import_extra
from tests.registration.files.readers.crafted import MODALITY, counts
from tests.registration.files.readers.oriented import (
    NRRD_SIGNS,
    OBLIQUE,
    ORIENTATIONS,
    Laid,
    bare,
    check_in_space,
    cosines,
    group,
    laid,
    numbers,
    write_enhanced,
    write_folder,
    write_nifti,
    write_nrrd,
    write_zarr,
)

UPRIGHT = laid((2, 1, 0), (1, 1, 1))
OPT = ScanOverrides(scale="linear", refractive_index=1.36, optical_depth=False)


def test_a_missing_library_names_its_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(importlib, "import_module", absent)
    with pytest.raises(ScanFileError, match=r"printctl\[scans\]"):
        import_extra("h5py", tmp_path)


def hdf5(path: Path, **attributes: Any) -> Path:
    with h5py.File(path, "w") as file:
        chunks = {"chunks": (4, 4, 4), "compression": "gzip"}
        data = file.create_dataset("scan/grey", data=counts(), **chunks)
        data.attrs.update({"axes": "zyx", "voxel_mm": [0.01, 0.02, 0.03], **attributes})
    return path


def test_hdf5_with_two_volumes_asks_which(tmp_path: Path) -> None:
    path = hdf5(tmp_path / "s.h5")
    with h5py.File(path, "a") as file:
        file["other"] = counts()
    with pytest.raises(ScanFileError, match="name the scan 'volume'"):
        read_scan(path, MODALITY)
    with h5py.File(path, "a") as file:
        file.move("scan/grey", "scan/volume")
    np.testing.assert_array_equal(read_scan(path, MODALITY).volume, counts())


def test_hdf5_that_links_elsewhere_or_promises_too_much_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "s.h5"
    with h5py.File(path, "w") as file:
        file.create_dataset("volume", (4, 4, 4), "u2", external=[("/etc/passwd", 0, 128)])
    with pytest.raises(ScanFileError, match="other files"):
        read_scan(path, MODALITY)
    for size in (10**7, 2000):
        with h5py.File(path, "w") as file:
            file.create_dataset("volume", (size, size, size), "u2", chunks=(8, 8, 8))
        with pytest.raises(ScanFileError, match=r"no scan is larger|never written"):
            read_scan(path, MODALITY)


@pytest.mark.parametrize("compress", [False, True])
@pytest.mark.parametrize("kind", ["uint8", "int16", "float32", "float64"])
def test_matlab_array_comes_back(tmp_path: Path, compress: bool, kind: str) -> None:
    volume = (counts() % 200).astype(kind)
    known = {"axes": "zyx", "voxel_mm": [1.0, 2.0, 3.0], "scale": "linear"}
    beside = {"other": counts(), "note": "x", "cell": np.array([1, "a"], object)}
    for held in ({"V": volume}, {"volume": volume, **beside}):
        savemat(tmp_path / "s.mat", held | known, do_compression=compress)
        found = read_scan(tmp_path / "s.mat", ScanOverrides(modality="microct"))
        np.testing.assert_array_equal(found.volume, volume)
        assert found.volume.dtype == np.dtype(kind)
        assert found.voxel_mm == (1.0, 2.0, 3.0)


def test_matlab_logical_volumes_are_read_and_complex_ones_refused(tmp_path: Path) -> None:
    path, known = tmp_path / "s.mat", {"axes": "zyx", "voxel_mm": [1.0, 2.0, 3.0]}
    savemat(path, {"V": counts() > 100, "scale": "linear", **known})
    found = read_scan(path, ScanOverrides(modality="microct"))
    np.testing.assert_array_equal(found.volume, counts() > 100)
    savemat(path, {"V": counts() * (1 + 1j), **known})
    with pytest.raises(ScanFileError, match=r"V holds complex numbers; save abs\(V\)"):
        read_scan(path, MODALITY)


def test_broken_matlab_file_is_refused_before_memory_is_taken(tmp_path: Path) -> None:
    path = tmp_path / "s.mat"
    savemat(path, {"V": counts()})
    good, sizes = path.read_bytes(), struct.pack("<3i", *counts().shape)
    path.write_bytes(good[:400])
    with pytest.raises(ScanFileError, match="broken MATLAB"):
        read_scan(path, MODALITY)
    for size in (2**30, 2**10):
        path.write_bytes(good.replace(sizes, struct.pack("<3i", size, size, size)))
        with pytest.raises(ScanFileError, match=r"no scan is larger|holds at most"):
            read_scan(path, MODALITY)
    savemat(path, {"V": np.zeros((3, 3))})
    with pytest.raises(ScanFileError, match="0 arrays of three axes"):
        read_scan(path, MODALITY)


def zarr_2(path: Path, codec: dict[str, Any] | None, **changes: Any) -> Path:
    """An OME-Zarr 0.4 of 1 × 1 × 9 × 8 × 7 in chunks of 4."""
    array = {
        "zarr_format": 2, "shape": [1, 1, 9, 8, 7], "chunks": [1, 1, 4, 4, 4], "dtype": "<u2",
        "compressor": codec, "fill_value": 0, "order": "C", "filters": None,
        "dimension_separator": "/",
    } | changes  # fmt: skip
    axes = [{"name": "t", "type": "time"}, {"name": "c", "type": "channel"}]
    axes += [{"name": n, "type": "space", "unit": "micrometer"} for n in "zyx"]
    scale = {"type": "scale", "scale": [1, 1, 10, 20, 30]}
    image = {
        "version": "0.4", "axes": axes,
        "datasets": [{"path": "0", "coordinateTransformations": [scale]}],
    }  # fmt: skip
    (path / "0").mkdir(parents=True, exist_ok=True)
    (path / ".zgroup").write_text('{"zarr_format": 2}')
    (path / ".zattrs").write_text(json.dumps({"multiscales": [image]}))
    (path / "0" / ".zarray").write_text(json.dumps(array))
    encode = numcodecs.get_codec(dict(codec)).encode if codec else bytes
    for z, y, x in np.ndindex(3, 2, 2):
        whole = np.zeros((4, 4, 4), "<u2")
        part = counts()[4 * z : 4 * z + 4, 4 * y : 4 * y + 4, 4 * x : 4 * x + 4]
        whole[tuple(slice(0, n) for n in part.shape)] = part
        place = path / "0" / "0" / "0" / str(z) / str(y) / str(x)
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(encode(whole.tobytes()))
    return path


CODECS: list[dict[str, Any] | None] = [
    None, {"id": "zlib", "level": 1}, {"id": "gzip", "level": 1}, {"id": "blosc", "cname": "lz4"},
    {"id": "blosc", "cname": "zstd"}, {"id": "zstd", "level": 1}, {"id": "lz4"},
]  # fmt: skip


@pytest.mark.parametrize("codec", CODECS)
def test_ome_zarr_comes_back(tmp_path: Path, codec: dict[str, Any] | None) -> None:
    path = zarr_2(tmp_path / "s.zarr", codec)
    for _ in range(2):
        found = read_scan(path, MODALITY)
        np.testing.assert_array_equal(found.volume, counts())
        assert found.voxel_mm == pytest.approx((0.01, 0.02, 0.03))
        (path / ".zgroup").unlink(missing_ok=True)  # some programs write none
    (path / ".zattrs").write_text("{}")
    with pytest.raises(ScanFileError, match="no image metadata"):
        read_scan(path, MODALITY)


def test_the_only_image_of_a_group_is_read_and_of_several_one_is_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "b2r.zarr"
    zarr_2(path / "0", None)
    (path / ".zgroup").write_text('{"zarr_format": 2}')
    (path / ".zattrs").write_text('{"bioformats2raw.layout": 3}')
    found = read_scan(path, MODALITY)
    np.testing.assert_array_equal(found.volume, counts())
    assert "image 0 of it was read" in found.notes
    zarr_2(path / "10", None)
    with pytest.raises(ScanFileError, match=r"2 images; give one of them: .*zarr/0, .*zarr/10"):
        read_scan(path, MODALITY)
    (path / ".zattrs").write_text('{"plate": {"wells": [{"path": "A/1"}]}}')
    with pytest.raises(ScanFileError, match=r"plate of wells; give .* like .*A/1/0"):
        read_scan(path, MODALITY)


@pytest.mark.parametrize("unit", ["furlong", None])
def test_the_users_size_wins_over_a_zarr_unit(tmp_path: Path, unit: str | None) -> None:
    path = zarr_2(tmp_path / "s.zarr", None)
    text = (path / ".zattrs").read_text()
    (path / ".zattrs").write_text(text.replace('"micrometer"', json.dumps(unit)))
    sized = ScanOverrides(modality="microct", scale="linear", voxel_mm=(0.01, 0.02, 0.03))
    assert read_scan(path, sized).voxel_mm == (0.01, 0.02, 0.03)
    with pytest.raises(ScanFileError, match="give --voxel-um"):
        read_scan(path, MODALITY)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"shape": [1, 1, 10**6, 10**6, 10**6]}, "no scan is larger"),
        ({"chunks": [1, 1, 2**12, 2**12, 2**12]}, "smaller ones"),
        ({"shape": [1, 1, 2000, 2000, 2000], "chunks": [1, 1, 1, 1, 1]}, "larger ones"),
        ({"shape": [1, 1, 60, 60, 60]}, "12 of its 3375 chunks"),
        ({"shape": [2, 1, 9, 8, 7]}, "export one volume"),
        ({"compressor": {"id": "magic"}}, "magic"),
        ({"chunks": [1, 1, 4, 4, 5]}, "size 64"),
        ({"dtype": "<c8", "fill_value": None}, "real numbers"),
    ],
)
def test_zarr_metadata_that_lies_is_refused(tmp_path, changes, reason):
    with pytest.raises(ScanFileError, match=reason):
        read_scan(zarr_2(tmp_path / "s.zarr", None, **changes), MODALITY)


def test_zarr_path_that_leaves_the_folder_is_refused(tmp_path: Path) -> None:
    path = zarr_2(tmp_path / "s.zarr", None)
    text = (path / ".zattrs").read_text()
    for name in ("../s.zarr/0", "/etc", "..\\\\x"):
        (path / ".zattrs").write_text(text.replace('"path": "0"', f'"path": "{name}"'))
        with pytest.raises(ScanFileError, match="leaves the folder"):
            read_scan(path, MODALITY)


@pytest.mark.parametrize(
    ("version", "more"),
    [
        (2, {"filters": [numcodecs.Delta("<u2")], "order": "F"}),
        (3, {"shards": (8, 8, 8)}),
        (3, {"compressors": zarr.codecs.GzipCodec(level=1)}),
    ],
)
def test_stores_of_zarr_itself_come_back(tmp_path, version, more):
    path = zarr_2(tmp_path / "s.zarr", None)
    image = json.loads((path / ".zattrs").read_text())["multiscales"][0]
    image["axes"] = image["axes"][2:]
    image["datasets"][0]["coordinateTransformations"][0]["scale"] = [10, 20, 30]
    said = {"multiscales": [image]}
    group = zarr.open_group(tmp_path / "new.zarr", mode="w", zarr_format=version)
    group.attrs.update(said if version == 2 else {"ome": said})
    array = group.create_array("0", shape=counts().shape, dtype="u2", chunks=(4, 4, 4), **more)
    array[:] = counts()
    found = read_scan(tmp_path / "new.zarr", MODALITY)
    np.testing.assert_array_equal(found.volume, counts())
    assert found.voxel_mm == pytest.approx((0.01, 0.02, 0.03))


def test_a_shard_that_says_nothing_is_refused(tmp_path: Path) -> None:
    path = write_zarr(tmp_path / "s.zarr", UPRIGHT, "0.5")
    array = path / "0" / "zarr.json"
    lone = {"codecs": [{"name": "sharding_indexed"}]}
    array.write_text(json.dumps(json.loads(array.read_text()) | lone))
    with pytest.raises(ScanFileError, match="sharding_indexed"):
        read_scan(path, MODALITY)


def test_a_chunk_that_unpacks_without_end_is_refused(tmp_path: Path) -> None:
    path = zarr_2(tmp_path / "s.zarr", {"id": "zlib", "level": 9})
    chunk = path / "0" / "0" / "0" / "0" / "0" / "0"
    chunk.write_bytes(zlib.compress(bytes(300_000), 9))
    with pytest.raises(ScanFileError, match="size 150000"):
        read_scan(path, MODALITY)
    chunk.write_bytes(b"\0" * 20)
    with pytest.raises(ScanFileError, match="broken OME-Zarr"):
        read_scan(path, MODALITY)


def test_frames_of_ophthalmic_tomography_are_b_scans(tmp_path: Path) -> None:
    path = write_enhanced(tmp_path / "s.dcm", UPRIGHT, "OPT")
    with pytest.raises(ScanFileError, match="--refractive-index, --optical-depth, --scale"):
        read_scan(path)
    found = read_scan(path, OPT)
    # Columns x, rows down, frames along their normal: left-handed, so that y is reversed.
    np.testing.assert_array_equal(found.volume, counts().transpose(1, 0, 2)[:, ::-1])
    assert found.voxel_mm == pytest.approx((0.02, 0.01, 0.03))
    assert (found.modality, found.handedness) == ("oct", "right")
    assert "mirrored" in found.notes[0]


SHUFFLED = {9: [3, 1, 4, 0, 5, 8, 2, 6, 7], 8: [3, 1, 4, 0, 5, 7, 2, 6], 7: [3, 1, 4, 0, 5, 2, 6]}


def shuffled(path: Path, part: Laid, **changes: Any) -> Path:
    return write_enhanced(path, part, order=SHUFFLED[len(part.array)], **changes)


WRITERS: dict[str, Callable[[Path, Laid], Path]] = {
    "sform": lambda p, part: write_nifti(p / "s.nii", part, "sform"),
    "qform": lambda p, part: write_nifti(p / "s.nii", part, "qform"),
    "both": lambda p, part: write_nifti(p / "s.nii.gz", part, "both"),
    **{
        space: lambda p, part, space=space: write_nrrd(p / "s.nrrd", part, space)  # type: ignore[misc]
        for space in NRRD_SIGNS
    },
    "slices": lambda p, part: write_folder(p / "s", part),
    "shared": lambda p, part: write_enhanced(p / "s.dcm", part),
    "per frame": lambda p, part: shuffled(p / "s.dcm", part, per_frame=True),
    "ophthalmic": lambda p, part: shuffled(p / "s.dcm", part, modality="OPT"),
}
STRAIGHT: dict[str, Callable[[Path, Laid], Path]] = {
    "zarr 0.4": lambda p, part: write_zarr(p / "s.zarr", part, "0.4"),
    "zarr 0.5": lambda p, part: write_zarr(p / "s.zarr", part, "0.5"),
    "zarr 0.4, permuted": lambda p, part: write_zarr(p / "s.zarr", part, "0.4", "yzx"),
}
"""These can't say an oblique orientation."""


def every_orientation() -> list[Any]:
    """Each kind of file in each orientation; in CI each kind in eight, and each of the 48."""
    kinds = [*WRITERS, *STRAIGHT]
    return [
        pytest.param(kind, *way, marks=[] if (n + k) % 6 == 0 else pytest.mark.slow)
        for n, way in enumerate(ORIENTATIONS)
        for k, kind in enumerate(kinds)
    ]


@pytest.mark.parametrize(("kind", "order", "signs"), every_orientation())
def test_every_orientation_comes_back_in_space(tmp_path, kind, order, signs):
    part = laid(order, signs)
    said = OPT if kind == "ophthalmic" else MODALITY
    found = read_scan({**WRITERS, **STRAIGHT}[kind](tmp_path, part), said)
    check_in_space(found)
    # B-scans and an odd order of names (y, z, x) turn the handedness round; slices of a series
    # are sorted along their normal, so that none is ever mirrored.
    odd = kind in ("ophthalmic", "zarr 0.4, permuted")
    sorted_slices = kind in ("slices", "shared", "per frame")
    mirrored = kind == "ophthalmic" or (not sorted_slices and part.mirrored is not odd)
    assert any("mirrored" in note for note in found.notes) is mirrored


@pytest.mark.parametrize("kind", WRITERS)
@pytest.mark.parametrize(("order", "signs"), ORIENTATIONS[::5])
def test_oblique_orientations_come_back_in_space(tmp_path, kind, order, signs):
    said = OPT if kind == "ophthalmic" else MODALITY
    found = read_scan(WRITERS[kind](tmp_path, laid(order, signs, OBLIQUE)), said)
    check_in_space(found, OBLIQUE)


@pytest.mark.parametrize("mirrored", [False, True])
def test_who_contradicts_the_file_loses_its_space(tmp_path: Path, mirrored: bool) -> None:
    path = write_nifti(tmp_path / "s.nii", UPRIGHT)
    said = ScanOverrides(modality="microct", scale="linear", mirrored=mirrored)
    assert (read_scan(path, said).space is None) is mirrored


SHEAR = np.array([[1, 0, 0], [0, 1, 0], [0.0, 0.05, 1]])


@pytest.mark.parametrize("kind", [*list(WRITERS)[:1], *NRRD_SIGNS, "slices", "shared"])
def test_sheared_volumes_are_refused(tmp_path: Path, kind: str) -> None:
    sheared = Laid(UPRIGHT.array, UPRIGHT.steps @ SHEAR, UPRIGHT.origin)
    with pytest.raises(ScanFileError, match=r"meet at 9?[28]\d?\.\d+°.*resample"):
        read_scan(WRITERS[kind](tmp_path, sheared), MODALITY)


def test_nifti_whose_two_orientations_differ_is_refused(tmp_path: Path) -> None:
    path = write_nifti(tmp_path / "s.nii", UPRIGHT, "both")
    image = nibabel.load(path)
    turned = image.affine @ np.diag([1, -1, 1, 1])
    image.set_sform(turned, code=1)
    nibabel.save(image, tmp_path / "t.nii")
    with pytest.raises(ScanFileError, match="one is mirrored and one isn't"):
        read_scan(tmp_path / "t.nii", MODALITY)
    image.set_sform(image.get_qform() + np.eye(4, k=3), code=1)
    nibabel.save(image, tmp_path / "v.nii")
    moved = read_scan(tmp_path / "v.nii", MODALITY)
    assert any("sform and qform differ by up to 1 " in one for one in moved.notes)
    image.set_sform(image.get_qform() * 2, code=1)
    nibabel.save(image, tmp_path / "u.nii")
    with pytest.raises(ScanFileError, match="its pixdim"):
        read_scan(tmp_path / "u.nii", MODALITY)


def edited(path: Path, change: Callable[[Any], Any] | None = None, **values: Any) -> Path:
    data = pydicom.dcmread(path)
    for name, value in values.items():
        setattr(data, name, value)
    if change is not None:
        change(data)
    data.save_as(path)
    return path


def unplaced(data: Any) -> None:
    del data.ImagePositionPatient


@pytest.mark.parametrize(
    ("change", "values", "reason"),
    [
        (None, {"PixelSpacing": [0.02, 0.04]}, r"88\.dcm: has pixels"),
        (unplaced, {}, r"88\.dcm: doesn't say ImagePositionPatient"),
        (None, {"SeriesInstanceUID": "1.2.4"}, "2 series"),
        (None, {"FrameOfReferenceUID": "1.2.9"}, "2 frames of reference"),
    ],
)
def test_a_slice_that_doesnt_belong_or_is_missing_is_noticed(tmp_path, change, values, reason):
    path = write_folder(tmp_path / "s", UPRIGHT)
    assert read_scan(path).modality == "microct"
    edited(path / "88.dcm", change, **values)
    with pytest.raises(ScanFileError, match=reason):
        read_scan(path)
    (path / "88.dcm").unlink()
    with pytest.raises(ScanFileError, match="evenly spaced"):
        read_scan(path)


@pytest.mark.parametrize("way", [1, -1])
def test_offsets_of_a_grid_are_followed(tmp_path: Path, way: int) -> None:
    """GridFrameOffsetVector: offsets along the normal, from the one position that is given."""
    part = laid((2, 1, 0), (way, 1, 1))
    data = bare(part, "CT", 1)
    data.PixelSpacing = numbers(np.linalg.norm(part.steps[1:], axis=1))
    data.ImageOrientationPatient, data.ImagePositionPatient = cosines(part), numbers(part.origin)
    data.GridFrameOffsetVector = numbers(way * 0.01 * np.arange(9))
    data.NumberOfFrames, data.PixelData = 9, part.array.astype("<u2").tobytes()
    data.save_as(tmp_path / "s.dcm", enforce_file_format=True)
    check_in_space(read_scan(tmp_path / "s.dcm"))


def test_slopes_of_each_slice_and_frame_are_applied(tmp_path: Path) -> None:
    path = write_folder(tmp_path / "s", UPRIGHT)
    edited(path / "88.dcm", RescaleSlope=3, RescaleIntercept=-5)
    expected = counts().astype(np.float32)
    expected[2] = expected[2] * 3 - 5
    np.testing.assert_array_equal(read_scan(path).volume, expected)

    def slope(data: Any) -> None:
        values = group(RescaleSlope=2, RescaleIntercept=-1000)
        data.SharedFunctionalGroupsSequence[0].PixelValueTransformationSequence = values

    enhanced = edited(shuffled(tmp_path / "e.dcm", UPRIGHT), slope)
    found = read_scan(enhanced).volume
    np.testing.assert_array_equal(found, counts().astype(np.float32) * 2 - 1000)


@pytest.mark.parametrize("tag", range(2, 9))
def test_turned_tiff_pages_are_refused(tmp_path: Path, tag: int) -> None:
    path = tmp_path / "s.tif"
    tifffile.imwrite(path, counts(), extratags=[(274, "H", 1, tag, True)], metadata=None)
    with pytest.raises(ScanFileError, match=f"Orientation tag {tag}"):
        read_scan(path, MODALITY)


def test_matlab_axes_mean_the_same_in_both_levels(tmp_path: Path) -> None:
    """MATLAB 7.3 stores V(z, y, x) as HDF5 of x, y, z, with text as codes."""
    with h5py.File(tmp_path / "s.mat", "w", userblock_size=512) as file:
        data = file.create_dataset("V", data=counts().T)
        data.attrs["MATLAB_class"] = np.bytes_("uint16")
        axes = file.create_dataset("axes", data=np.array([[ord(c)] for c in "zyx"], "u2"))
        axes.attrs["MATLAB_class"] = np.bytes_("char")
        file["voxel_mm"] = [[0.01], [0.02], [0.03]]
    found = read_scan(tmp_path / "s.mat", MODALITY)
    np.testing.assert_array_equal(found.volume, counts())
    assert found.voxel_mm == (0.01, 0.02, 0.03)


def turn_one(data: Any) -> None:
    frame = data.PerFrameFunctionalGroupsSequence[4]
    frame.PlaneOrientationSequence[0].ImageOrientationPatient = [0, 1, 0, 0, 0, 1]


@pytest.mark.parametrize(
    ("change", "values", "reason"),
    [
        (turn_one, {}, "slice 5 of 9 has the orientation"),
        (None, {"NumberOfFrames": 10**9}, "truncated"),
        (None, {"PhotometricInterpretation": "PALETTE COLOR"}, "aren't a scan"),
        (None, {"PhotometricInterpretation": "RGB"}, "aren't a scan"),
    ],
)
def test_frames_that_are_no_volume_are_refused(tmp_path, change, values, reason):
    path = write_enhanced(tmp_path / "s.dcm", UPRIGHT, per_frame=True)
    with pytest.raises(ScanFileError, match=reason):
        read_scan(edited(path, change, **values), MODALITY)


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ('"scale", "scale": [', '"scale", "scale": [-', "runs backwards"),
        ('"scale", "scale": [', '"affine", "scale": [', "'affine'"),
        ("inferior-to-superior", "inferior-to-left", "orientation 'inferior-to-left'"),
    ],
)
def test_zarr_axes_that_turn_or_are_half_told_are_refused(tmp_path, old, new, reason):
    path = write_zarr(tmp_path / "s.zarr", UPRIGHT, "0.4")
    text = (path / ".zattrs").read_text()
    assert old in text
    (path / ".zattrs").write_text(text.replace(old, new))
    with pytest.raises(ScanFileError, match=reason):
        read_scan(path, MODALITY)
