"""Orientation in every format: all 48 recovered, or refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import nibabel
import numpy as np
import pytest
import tifffile

from registration import ScanOverrides, read_scan
from registration.errors import ScanFileError
from tests.registration.files.readers.crafted import MODALITY, counts

pydicom = pytest.importorskip("pydicom")
h5py = pytest.importorskip("h5py")

from tests.registration.files.readers.oriented import (  # noqa: E402
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

OPT = ScanOverrides(scale="linear", refractive_index=1.36, optical_depth=False)
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
    path = write_nifti(tmp_path / "s.nii", laid((2, 1, 0), (1, 1, 1)))
    said = ScanOverrides(modality="microct", scale="linear", mirrored=mirrored)
    assert (read_scan(path, said).space is None) is mirrored


SHEAR = np.array([[1, 0, 0], [0, 1, 0], [0.0, 0.05, 1]])


@pytest.mark.parametrize("kind", [*list(WRITERS)[:1], *NRRD_SIGNS, "slices", "shared"])
def test_sheared_volumes_are_refused(tmp_path: Path, kind: str) -> None:
    part = laid((2, 1, 0), (1, 1, 1))
    sheared = Laid(part.array, part.steps @ SHEAR, part.origin)
    with pytest.raises(ScanFileError, match=r"meet at 9?[28]\d?\.\d+°.*resample"):
        read_scan(WRITERS[kind](tmp_path, sheared), MODALITY)


def test_nifti_whose_two_orientations_differ_is_refused(tmp_path: Path) -> None:
    path = write_nifti(tmp_path / "s.nii", laid((2, 1, 0), (1, 1, 1)), "both")
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


def edited(path: Path, change: Callable[[Any], None]) -> Path:
    data = pydicom.dcmread(path)
    change(data)
    data.save_as(path)
    return path


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


def test_slices_without_place_or_of_two_pixel_sizes_are_refused(tmp_path: Path) -> None:
    path = write_folder(tmp_path / "s", laid((2, 1, 0), (1, 1, 1)))
    edited(path / "88.dcm", lambda data: setattr(data, "PixelSpacing", [0.02, 0.04]))
    with pytest.raises(ScanFileError, match=r"88\.dcm: has pixels"):
        read_scan(path)
    edited(path / "88.dcm", lambda data: data.__delattr__("ImagePositionPatient"))
    with pytest.raises(ScanFileError, match=r"88\.dcm: doesn't say ImagePositionPatient"):
        read_scan(path)


def test_slopes_of_each_slice_and_frame_are_applied(tmp_path: Path) -> None:
    part = laid((2, 1, 0), (1, 1, 1))
    path = write_folder(tmp_path / "s", part)
    edited(path / "88.dcm", lambda d: (setattr(d, "RescaleSlope", 3), None)[1])
    edited(path / "88.dcm", lambda d: setattr(d, "RescaleIntercept", -5))
    expected = counts().astype(np.float32)
    expected[2] = expected[2] * 3 - 5
    np.testing.assert_array_equal(read_scan(path).volume, expected)

    def slope(data: Any) -> None:
        values = group(RescaleSlope=2, RescaleIntercept=-1000)
        data.SharedFunctionalGroupsSequence[0].PixelValueTransformationSequence = values

    enhanced = edited(shuffled(tmp_path / "e.dcm", part), slope)
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


def test_frames_of_several_orientations_are_refused(tmp_path: Path) -> None:
    def turn(data: Any) -> None:
        frame = data.PerFrameFunctionalGroupsSequence[4]
        frame.PlaneOrientationSequence[0].ImageOrientationPatient = [0, 1, 0, 0, 0, 1]

    path = write_enhanced(tmp_path / "s.dcm", laid((2, 1, 0), (1, 1, 1)), per_frame=True)
    with pytest.raises(ScanFileError, match="slice 5 of 9 has the orientation"):
        read_scan(edited(path, turn), MODALITY)


@pytest.mark.parametrize("kind", ["PALETTE COLOR", "RGB"])
def test_palettes_are_refused(tmp_path: Path, kind: str) -> None:
    path = write_enhanced(tmp_path / "s.dcm", laid((2, 1, 0), (1, 1, 1)))
    edited(path, lambda data: setattr(data, "PhotometricInterpretation", kind))
    with pytest.raises(ScanFileError, match="aren't a scan"):
        read_scan(path)


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ('"scale", "scale": [', '"scale", "scale": [-', "runs backwards"),
        ('"scale", "scale": [', '"affine", "scale": [', "'affine'"),
        ("inferior-to-superior", "inferior-to-left", "orientation 'inferior-to-left'"),
    ],
)
def test_zarr_axes_that_turn_or_are_half_told_are_refused(tmp_path, old, new, reason):
    path = write_zarr(tmp_path / "s.zarr", laid((2, 1, 0), (1, 1, 1)), "0.4")
    text = (path / ".zattrs").read_text()
    assert old in text
    (path / ".zattrs").write_text(text.replace(old, new))
    with pytest.raises(ScanFileError, match=reason):
        read_scan(path, MODALITY)
