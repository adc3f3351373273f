"""Readers of DICOM, HDF5, MATLAB and OME-Zarr, with and without the extra `scans`."""

from __future__ import annotations

import importlib
import json
import math
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from registration import ScanOverrides, read_scan
from registration.errors import ScanFileError
from registration.files.readers.common import import_extra
from tests.registration.files.readers.crafted import MODALITY, counts

h5py = pytest.importorskip("h5py")
zarr = pytest.importorskip("zarr")
numcodecs = pytest.importorskip("numcodecs")
pydicom = pytest.importorskip("pydicom")


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


def test_matlab_array_comes_back(tmp_path: Path) -> None:
    known = {"voxel_mm": [0.01, 0.02, 0.03], "axes": "zyx"}
    for compress in (False, True):
        savemat(tmp_path / "s.mat", {"V": counts(), **known}, do_compression=compress)
        found = read_scan(tmp_path / "s.mat", MODALITY)
        np.testing.assert_array_equal(found.volume, counts())
        assert found.voxel_mm == (0.01, 0.02, 0.03)


@pytest.mark.parametrize("compress", [False, True])
@pytest.mark.parametrize("kind", ["uint8", "int16", "float32", "float64"])
def test_matlab_types_and_a_named_volume(tmp_path: Path, compress: bool, kind: str) -> None:
    volume = (counts() % 200).astype(kind)
    beside = {"other": counts(), "scale": "linear", "note": "x", "cell": np.array([1, "a"], object)}
    known = {"volume": volume, "axes": "zyx", "voxel_mm": [1.0, 2.0, 3.0], **beside}
    savemat(tmp_path / "s.mat", known, do_compression=compress)
    found = read_scan(tmp_path / "s.mat", ScanOverrides(modality="microct"))
    np.testing.assert_array_equal(found.volume, volume)
    assert found.volume.dtype == np.dtype(kind)
    assert found.voxel_mm == (1.0, 2.0, 3.0)


def test_broken_matlab_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "s.mat"
    savemat(path, {"V": counts()})
    path.write_bytes(path.read_bytes()[:400])
    with pytest.raises(ScanFileError, match="broken MATLAB"):
        read_scan(path, MODALITY)
    savemat(path, {"V": np.zeros((3, 3))})
    with pytest.raises(ScanFileError, match="0 arrays of three axes"):
        read_scan(path, MODALITY)


def test_matlab_sizes_beyond_the_file_are_refused_before_memory_is_taken(tmp_path: Path) -> None:
    path = tmp_path / "s.mat"
    savemat(path, {"V": counts()})
    sizes = struct.pack("<3i", *counts().shape)
    for size in (2**30, 2**10):
        path.write_bytes(path.read_bytes().replace(sizes, struct.pack("<3i", size, size, size)))
        with pytest.raises(ScanFileError, match=r"no scan is larger|holds at most"):
            read_scan(path, MODALITY)
        savemat(path, {"V": counts()})


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
    write_chunks(path / "0", "", encode)
    return path


def write_chunks(folder: Path, prefix: str, encode: Any) -> None:
    for z, y, x in np.ndindex(3, 2, 2):
        whole = np.zeros((4, 4, 4), "<u2")
        part = counts()[4 * z : 4 * z + 4, 4 * y : 4 * y + 4, 4 * x : 4 * x + 4]
        whole[tuple(slice(0, n) for n in part.shape)] = part
        place = folder / prefix / "0" / "0" / str(z) / str(y) / str(x)
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(encode(whole.tobytes()))


CODECS: list[dict[str, Any] | None] = [
    None, {"id": "zlib", "level": 1}, {"id": "gzip", "level": 1}, {"id": "blosc", "cname": "lz4"},
    {"id": "blosc", "cname": "zstd"}, {"id": "zstd", "level": 1}, {"id": "lz4"},
]  # fmt: skip


@pytest.mark.parametrize("codec", CODECS)
def test_ome_zarr_comes_back(tmp_path: Path, codec: dict[str, Any] | None) -> None:
    found = read_scan(zarr_2(tmp_path / "s.zarr", codec), MODALITY)
    np.testing.assert_array_equal(found.volume, counts())
    assert found.voxel_mm == pytest.approx((0.01, 0.02, 0.03))


def test_ome_zarr_of_version_3_comes_back(tmp_path: Path) -> None:
    path = zarr_2(tmp_path / "s.zarr", None)
    image = json.loads((path / ".zattrs").read_text())["multiscales"][0]
    for name in (".zattrs", ".zgroup", "0/.zarray"):
        (path / name).unlink()
    group = {"zarr_format": 3, "node_type": "group"}
    group["attributes"] = {"ome": {"version": "0.5", "multiscales": [image]}}
    (path / "zarr.json").write_text(json.dumps(group))
    array = {
        "zarr_format": 3, "node_type": "array", "shape": [1, 1, 9, 8, 7], "data_type": "uint16",
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [1, 1, 4, 4, 4]}},
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
        "fill_value": 0,
        "codecs": [
            {"name": "bytes", "configuration": {"endian": "little"}},
            {"name": "gzip", "configuration": {"level": 1}},
        ],
    }  # fmt: skip
    (path / "0" / "zarr.json").write_text(json.dumps(array))
    write_chunks(path / "0", "c", numcodecs.GZip(1).encode)
    np.testing.assert_array_equal(read_scan(path, MODALITY).volume, counts())
    array["codecs"] = [{"name": "sharding_indexed"}]
    (path / "0" / "zarr.json").write_text(json.dumps(array))
    with pytest.raises(ScanFileError, match="sharding_indexed"):
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


@pytest.mark.parametrize("version", [2, 3])
def test_stores_of_zarr_itself_come_back_with_shards_and_filters(tmp_path, version):
    path = zarr_2(tmp_path / "s.zarr", None)
    image = json.loads((path / ".zattrs").read_text())["multiscales"][0]
    axes = {"axes": image["axes"][2:]}
    image["datasets"][0]["coordinateTransformations"][0]["scale"] = [10, 20, 30]
    said = {"multiscales": [image | axes]}
    group = zarr.open_group(tmp_path / "new.zarr", mode="w", zarr_format=version)
    group.attrs.update(said if version == 2 else {"ome": said})
    more: dict[str, Any] = {"shards": (8, 8, 8)}
    if version == 2:
        more = {"filters": [numcodecs.Delta("<u2")], "order": "F"}
    array = group.create_array("0", shape=counts().shape, dtype="u2", chunks=(4, 4, 4), **more)
    array[:] = counts()
    found = read_scan(tmp_path / "new.zarr", MODALITY)
    np.testing.assert_array_equal(found.volume, counts())
    assert found.voxel_mm == pytest.approx((0.01, 0.02, 0.03))


def test_a_chunk_that_unpacks_without_end_is_refused(tmp_path: Path) -> None:
    path = zarr_2(tmp_path / "s.zarr", {"id": "zlib", "level": 9})
    chunk = path / "0" / "0" / "0" / "0" / "0" / "0"
    chunk.write_bytes(zlib.compress(bytes(300_000), 9))
    with pytest.raises(ScanFileError, match="size 150000"):
        read_scan(path, MODALITY)
    chunk.write_bytes(b"\0" * 20)
    with pytest.raises(ScanFileError, match="broken OME-Zarr"):
        read_scan(path, MODALITY)


def dicom_slice(path: Path, index: int, **changes: Any) -> Path:
    """Slice `index` of counts(): rows along +y, columns along +x, slices along +z."""
    data = pydicom.Dataset()
    data.file_meta = pydicom.dataset.FileMetaDataset()
    data.file_meta.TransferSyntaxUID = pydicom.uid.ExplicitVRLittleEndian
    data.file_meta.MediaStorageSOPClassUID = pydicom.uid.CTImageStorage
    data.file_meta.MediaStorageSOPInstanceUID = f"1.2.3.{index + 1}"
    data.SOPClassUID = pydicom.uid.CTImageStorage
    data.SOPInstanceUID = f"1.2.3.{index + 1}"
    data.SeriesInstanceUID, data.Modality = "1.2.3", "CT"
    data.Rows, data.Columns, data.SamplesPerPixel = 8, 7, 1
    data.BitsAllocated, data.BitsStored, data.HighBit, data.PixelRepresentation = 16, 16, 15, 0
    data.PhotometricInterpretation = "MONOCHROME2"
    data.PixelSpacing, data.ImageOrientationPatient = [0.02, 0.03], [1, 0, 0, 0, 1, 0]
    data.ImagePositionPatient = [0, 0, 0.01 * index]
    for name, value in changes.items():
        setattr(data, name, value)
    data.PixelData = counts()[index].astype("<u2").tobytes()
    data.save_as(path, enforce_file_format=True)
    return path


def folder(path: Path, order: Any = range(9), **changes: Any) -> Path:
    path.mkdir(exist_ok=True)
    for name, index in enumerate(order):
        dicom_slice(path / f"{name}.dcm", index, **changes)
    return path


def test_a_folder_of_slices_is_stacked_by_position(tmp_path: Path) -> None:
    found = read_scan(folder(tmp_path / "a", [3, 1, 4, 0, 5, 8, 2, 6, 7]))
    np.testing.assert_array_equal(found.volume, counts())
    assert found.voxel_mm == pytest.approx((0.01, 0.02, 0.03))
    assert (found.modality, found.handedness) == ("microct", "right")


def test_a_missing_slice_or_a_second_series_is_noticed(tmp_path: Path) -> None:
    path = folder(tmp_path / "a")
    (path / "4.dcm").unlink()
    with pytest.raises(ScanFileError, match="evenly spaced"):
        read_scan(path)
    dicom_slice(path / "4.dcm", 4, SeriesInstanceUID="1.2.4")
    with pytest.raises(ScanFileError, match="2 series"):
        read_scan(path)
    dicom_slice(path / "4.dcm", 4, FrameOfReferenceUID="1.2.9")
    with pytest.raises(ScanFileError, match="2 frames of reference"):
        read_scan(path)


def multiframe(path: Path, frames: int = 9, down: bool = False) -> Path:
    data = pydicom.dcmread(dicom_slice(path, 0))
    del data.PixelSpacing, data.ImageOrientationPatient, data.ImagePositionPatient

    def group(**values: Any) -> Any:
        item = pydicom.Dataset()
        for name, value in values.items():
            setattr(item, name, value)
        return pydicom.Sequence([item])

    shared = pydicom.Dataset()
    shared.PixelMeasuresSequence = group(PixelSpacing=[0.02, 0.03], SliceThickness=0.01)
    shared.PlaneOrientationSequence = group(ImageOrientationPatient=[1, 0, 0, 0, 1, 0])
    data.SharedFunctionalGroupsSequence = pydicom.Sequence([shared])
    each = []
    for index in range(frames):
        item = pydicom.Dataset()
        height = -0.01 * index if down else 0.01 * index
        item.PlanePositionSequence = group(ImagePositionPatient=[0, 0, height])
        each.append(item)
    data.PerFrameFunctionalGroupsSequence = pydicom.Sequence(each)
    data.NumberOfFrames = frames
    data.PixelData = counts().astype("<u2").tobytes()
    data.save_as(path, enforce_file_format=True)
    return path


@pytest.mark.parametrize("down", [False, True])
def test_enhanced_multiframe_is_stacked_by_position(tmp_path: Path, down: bool) -> None:
    found = read_scan(multiframe(tmp_path / "s.dcm", down=down))
    np.testing.assert_array_equal(found.volume, counts()[::-1] if down else counts())
    assert found.voxel_mm == pytest.approx((0.01, 0.02, 0.03))
    assert found.handedness == "right"


def test_frames_of_ophthalmic_tomography_are_b_scans(tmp_path: Path) -> None:
    path = multiframe(tmp_path / "s.dcm")
    data = pydicom.dcmread(path)
    data.Modality = "OPT"
    data.save_as(path)
    with pytest.raises(ScanFileError, match="--refractive-index, --optical-depth, --scale"):
        read_scan(path)
    said = ScanOverrides(refractive_index=1.36, optical_depth=False, scale="linear")
    found = read_scan(path, said)
    # Columns x, rows down, frames along their normal: left-handed, so that y is reversed.
    np.testing.assert_array_equal(found.volume, counts().transpose(1, 0, 2)[:, ::-1])
    assert found.voxel_mm == pytest.approx((0.02, 0.01, 0.03))
    assert (found.modality, found.handedness) == ("oct", "right")
    assert "mirrored" in found.notes[0]


def test_frames_beyond_the_file_are_refused(tmp_path: Path) -> None:
    path = multiframe(tmp_path / "s.dcm")
    data = pydicom.dcmread(path)
    data.NumberOfFrames = math.floor(1e9)
    data.save_as(path)
    with pytest.raises(ScanFileError, match="truncated"):
        read_scan(path)
