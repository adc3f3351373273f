"""Labelled phantom written to files in any orientation, by the libraries' own writers."""

import json
from dataclasses import dataclass
from itertools import permutations, product
from pathlib import Path
from typing import Any

import nibabel
import nrrd
import numpy as np
import pydicom
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from registration import Scan
from tests.registration.files.readers.crafted import counts

SIZES = np.array([0.03, 0.02, 0.01])
"""Voxels along left, posterior, superior, mm."""

OBLIQUE = Rotation.from_euler("xyz", [12, -31, 55], degrees=True).as_matrix()
CORNER = np.array([-3.0, 2.0, 7.5])


@dataclass(frozen=True)
class Laid:
    """The phantom as an array, and how its axes run in LPS.

    Attributes
    ----------
    array : (n0, n1, n2) uint16
        Labels.
    steps : (3, 3), mm
        Rows: from a voxel to the next along each array axis.
    origin : (3,), mm
        Of voxel (0, 0, 0).
    """

    array: NDArray[np.uint16]
    steps: NDArray[np.float64]
    origin: NDArray[np.float64]

    @property
    def mirrored(self) -> bool:
        """Whether array axes 2, 1, 0 as x, y, z are left-handed."""
        return float(np.linalg.det(self.steps[::-1])) < 0


ORIENTATIONS = list(product(permutations(range(3)), product((1, -1), repeat=3)))
"""Which of L, P, S (0, 1, 2) an array axis is, and whether it runs backwards: all 48."""


def laid(order: Any, signs: Any, turn: NDArray[np.float64] | None = None) -> Laid:
    """The phantom in one of the orientations, its axes then turned."""
    turn = np.eye(3) if turn is None else turn
    labels = counts().transpose(2, 1, 0).transpose(order)
    axes = (turn * SIZES).T[list(order)]
    origin = CORNER.copy()
    for axis, sign in enumerate(signs):
        if sign < 0:
            labels = np.flip(labels, axis)
            origin = origin + (labels.shape[axis] - 1) * axes[axis]
            axes[axis] *= -1
    return Laid(np.ascontiguousarray(labels), axes, origin)


def check_in_space(found: Scan, turn: NDArray[np.float64] | None = None) -> None:
    """Hold every voxel's place in space against where the phantom has its label."""
    turn = np.eye(3) if turn is None else turn
    assert found.space is not None
    assert found.space.name == "LPS"
    assert found.handedness == "right"
    assert np.linalg.det(found.space.from_scan[:3, :3]) > 0
    z, y, x = np.indices(found.volume.shape).reshape(3, -1)
    dz, dy, dx = found.voxel_mm
    points = np.column_stack([x * dx, y * dy, z * dz, np.ones(x.size)])
    seen = (points @ found.space.from_scan.T)[:, :3]
    k, j, i = np.unravel_index(found.volume.ravel().astype(int), counts().shape)
    true = CORNER + (np.column_stack([i, j, k]) * SIZES) @ turn.T
    np.testing.assert_allclose(seen, true, atol=2e-5)


def write_nifti(path: Path, part: Laid, form: str = "sform") -> Path:
    affine = np.eye(4)
    affine[:3, :3], affine[:3, 3] = part.steps[::-1].T, part.origin
    affine = np.diag([-1.0, -1.0, 1.0, 1.0]) @ affine
    image = nibabel.Nifti1Image(np.asfortranarray(part.array.T), None)
    image.header.set_zooms(np.linalg.norm(part.steps[::-1], axis=1))
    image.header.set_xyzt_units("mm")
    image.set_sform(affine, code=1 if form in ("sform", "both") else 0)
    image.set_qform(affine, code=1 if form in ("qform", "both") else 0)
    nibabel.save(image, path)
    return path


NRRD_SIGNS = {
    "left-posterior-superior": [1, 1, 1],
    "right-anterior-superior": [-1, -1, 1],
    "left-anterior-superior": [1, -1, 1],
}


def write_nrrd(path: Path, part: Laid, space: str) -> Path:
    signs = np.array(NRRD_SIGNS[space])
    header = {
        "space": space, "space directions": part.steps[::-1] * signs,
        "space origin": part.origin * signs, "space units": ["mm"] * 3, "encoding": "raw",
    }  # fmt: skip
    nrrd.write(str(path), part.array, header, index_order="C")
    return path


def numbers(values: Any) -> list[Any]:
    return [pydicom.valuerep.DSfloat(float(v), auto_format=True) for v in values]


def cosines(part: Laid) -> list[Any]:
    units = part.steps / np.linalg.norm(part.steps, axis=1)[:, None]
    return numbers([*units[2], *units[1]])


def bare(part: Laid, modality: str, uid: int) -> Any:
    """A data set with pixels' type and size."""
    data = pydicom.Dataset()
    data.file_meta = pydicom.dataset.FileMetaDataset()
    data.file_meta.TransferSyntaxUID = pydicom.uid.ExplicitVRLittleEndian
    data.file_meta.MediaStorageSOPClassUID = pydicom.uid.CTImageStorage
    data.file_meta.MediaStorageSOPInstanceUID = f"1.2.3.{uid}"
    data.SOPClassUID, data.SOPInstanceUID = pydicom.uid.CTImageStorage, f"1.2.3.{uid}"
    data.SeriesInstanceUID, data.Modality = "1.2.3", modality
    data.Rows, data.Columns, data.SamplesPerPixel = *part.array.shape[1:], 1
    data.BitsAllocated, data.BitsStored, data.HighBit, data.PixelRepresentation = 16, 16, 15, 0
    data.PhotometricInterpretation = "MONOCHROME2"
    return data


def write_folder(path: Path, part: Laid) -> Path:
    """Single slices, named against their order, with a SliceLocation that means nothing."""
    path.mkdir()
    for index, page in enumerate(part.array):
        data = bare(part, "CT", index + 1)
        data.PixelSpacing = numbers(np.linalg.norm(part.steps[1:], axis=1))
        data.ImageOrientationPatient = cosines(part)
        data.ImagePositionPatient = numbers(part.origin + index * part.steps[0])
        data.SliceLocation, data.PixelData = f"{-index}", page.astype("<u2").tobytes()
        data.save_as(path / f"{90 - index}.dcm", enforce_file_format=True)
    return path


def group(**values: Any) -> Any:
    item = pydicom.Dataset()
    for name, value in values.items():
        setattr(item, name, value)
    return pydicom.Sequence([item])


def write_enhanced(
    path: Path, part: Laid, modality: str = "CT", *, per_frame: bool = False, order: Any = None
) -> Path:
    """Functional groups; the orientation shared or in each frame, the frames in any order."""
    data, shared, each = bare(part, modality, 1), pydicom.Dataset(), []
    sizes = np.linalg.norm(part.steps, axis=1)
    shared.PixelMeasuresSequence = group(PixelSpacing=numbers(sizes[1:]), SliceThickness=9.0)
    if not per_frame:
        shared.PlaneOrientationSequence = group(ImageOrientationPatient=cosines(part))
    order = range(len(part.array)) if order is None else order
    for index in order:
        item = pydicom.Dataset()
        place = numbers(part.origin + index * part.steps[0])
        item.PlanePositionSequence = group(ImagePositionPatient=place)
        if per_frame:
            item.PlaneOrientationSequence = group(ImageOrientationPatient=cosines(part))
        each.append(item)
    data.SharedFunctionalGroupsSequence = pydicom.Sequence([shared])
    data.PerFrameFunctionalGroupsSequence = pydicom.Sequence(each)
    data.NumberOfFrames = len(each)
    data.PixelData = part.array[list(order)].astype("<u2").tobytes()
    data.save_as(path, enforce_file_format=True)
    return path


_WORDS = (("right", "left"), ("anterior", "posterior"), ("inferior", "superior"))


def write_zarr(path: Path, part: Laid, version: str, names: str = "zyx") -> Path:
    """OME-Zarr 0.4 or 0.5 after the published layout, one chunk, with RFC-4's orientation."""
    axes = []
    for name, step in zip(names, part.steps, strict=True):
        along = int(np.argmax(np.abs(step)))
        start, end = _WORDS[along] if step[along] > 0 else _WORDS[along][::-1]
        said = {"type": "anatomical", "value": f"{start}-to-{end}"}
        axes.append({"name": name, "type": "space", "unit": "millimeter", "orientation": said})
    scale = {"type": "scale", "scale": np.linalg.norm(part.steps, axis=1).tolist()}
    shift = (part.steps / np.linalg.norm(part.steps, axis=1)[:, None]) @ part.origin
    moved = {"type": "translation", "translation": shift.tolist()}
    sets = [{"path": "0", "coordinateTransformations": [scale, moved]}]
    image = {"version": version, "axes": axes, "datasets": sets}
    shape = list(part.array.shape)
    if version == "0.4":
        chunk = path / "0" / "0" / "0" / "0"
        chunk.parent.mkdir(parents=True)
        (path / ".zgroup").write_text('{"zarr_format": 2}')
        (path / ".zattrs").write_text(json.dumps({"multiscales": [image]}))
        array = {
            "zarr_format": 2, "shape": shape, "chunks": shape, "dtype": "<u2", "compressor": None,
            "fill_value": 0, "order": "C", "filters": None, "dimension_separator": "/",
        }  # fmt: skip
        (path / "0" / ".zarray").write_text(json.dumps(array))
    else:
        chunk = path / "0" / "c" / "0" / "0" / "0"
        chunk.parent.mkdir(parents=True)
        ome = {"ome": {"version": "0.5", "multiscales": [image]}}
        root = {"zarr_format": 3, "node_type": "group", "attributes": ome}
        (path / "zarr.json").write_text(json.dumps(root))
        grid = {"name": "regular", "configuration": {"chunk_shape": shape}}
        key = {"name": "default", "configuration": {"separator": "/"}}
        array = {
            "zarr_format": 3, "node_type": "array", "shape": shape, "data_type": "uint16",
            "chunk_grid": grid, "chunk_key_encoding": key, "fill_value": 0,
            "codecs": [{"name": "bytes", "configuration": {"endian": "little"}}],
        }  # fmt: skip
        (path / "0" / "zarr.json").write_text(json.dumps(array))
    chunk.write_bytes(part.array.astype("<u2").tobytes())
    return path
