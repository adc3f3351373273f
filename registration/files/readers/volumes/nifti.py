"""Read a scan volume from NIfTI-1 or -2, plain or gzipped, by nibabel."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from kernels.arrays import FloatArray
from registration.errors import ScanFileError
from registration.files.readers.common import (
    DEFLATE_RATIO,
    LPS,
    Array,
    FileSpace,
    FileVolume,
    check_available,
    file_space,
    known_voxel,
    millimetres,
    scan_file_errors,
)

_TO_LPS = np.diag([-1.0, -1.0, 1.0, 1.0])


def is_nifti(start: bytes) -> bool:
    """Whether a header (unzipped) is NIfTI: its length first, then a magic word."""
    one = start[:4] in (b"\x5c\x01\0\0", b"\0\0\x01\x5c") and start[344:347] in (b"n+1", b"ni1")
    two = start[:4] in (b"\x1c\x02\0\0", b"\0\0\x02\x1c") and start[4:7] in (b"n+2", b"ni2")
    return one or two


def read_nifti(path: Path) -> FileVolume:
    """The volume; axes i, j, k become x, y, z, and the affine says whether they are mirrored.

    Raises
    ------
    ScanFileError
        When the file is broken or has a time axis.
    """
    with scan_file_errors(path, "NIfTI"):
        image = _open(path)
        shape = tuple(int(size) for size in image.shape)
        while len(shape) > 3 and shape[-1] == 1:
            shape = shape[:-1]
        if len(shape) != 3:
            raise ScanFileError(f"{path}: has the axes {image.shape}; export one volume")
        space = _space(image, path)
        return FileVolume(_volume(image, shape, path), _known(image), space, _notes(image, shape))


def _open(path: Path) -> Any:
    import nibabel  # a fifth of a second that other scans don't pay
    from nibabel.spatialimages import HeaderDataError
    from nibabel.wrapstruct import WrapStructError

    with path.open("rb") as handle:
        zipped = handle.read(2) == b"\x1f\x8b"
    kinds = (nibabel.Nifti1Image, nibabel.Nifti2Image)
    for kind in kinds:
        name = nibabel.fileholders.FileHolder(filename=str(path))
        if zipped and path.suffix != ".gz":
            raise ScanFileError(f"{path}: is gzipped; name it {path.name}.gz")
        try:
            return kind.from_file_map({"image": name, "header": name})
        except (WrapStructError, HeaderDataError):
            continue
    raise ScanFileError(f"{path}: broken NIfTI header; export it again")


def _volume(image: Any, shape: tuple[int, ...], path: Path) -> Array:
    """Slices k as they come, scaled where the header has a slope."""
    stored = np.dtype(image.get_data_dtype())
    zipped = path.suffix == ".gz"
    size = path.stat().st_size * (DEFLATE_RATIO if zipped else 1)
    check_available(shape, stored, size, path)
    proxy = image.dataobj
    plain = (float(proxy.slope), float(proxy.inter)) == (1.0, 0.0)
    # Unscaled and unzipped, this is a view of the file.
    whole = proxy.get_unscaled() if plain else np.asarray(proxy, dtype=np.float32)
    volume: Array = whole.reshape(shape, order="F").T
    return volume


def _known(image: Any) -> dict[str, object]:
    known, _ = known_voxel(image.header.get_zooms()[2::-1], [_unit(image.header)] * 3)
    return {"axes": "zyx", **known}


def _unit(header: Any) -> str:
    """The unit of length; of a code that NIfTI doesn't have, nothing."""
    try:
        return str(header.get_xyzt_units()[0])
    except KeyError:
        return ""


def _space(image: Any, path: Path) -> FileSpace | None:
    """From the affine, where the header carries one (a code above 0); RAS becomes LPS.

    Raises
    ------
    ScanFileError
        When sform and qform contradict each other, or sform the sizes of the voxels.
    """
    header = image.header
    forms = {
        name: np.asarray(matrix, dtype=np.float64)
        for name, matrix in (
            ("sform", header.get_sform(coded=True)[0]),
            ("qform", header.get_qform(coded=True)[0]),
        )
        if matrix is not None
    }
    if not forms:
        return None
    _check_forms(forms, [float(size) for size in header.get_zooms()[:3]], path)
    unit = millimetres(_unit(header)) or 1.0
    affine = _TO_LPS @ next(iter(forms.values()))
    return file_space(LPS, affine[:3, 2::-1].T, affine[:3, 3] * unit, path)


def _notes(image: Any, shape: tuple[int, ...]) -> tuple[str, ...]:
    """Say where sform and qform put a corner of the volume in places half a voxel apart."""
    both = [get(coded=True)[0] for get in (image.header.get_sform, image.header.get_qform)]
    if any(form is None for form in both):
        return ()
    corners = np.array([[*at, 1] for at in np.ndindex(2, 2, 2)]) * [*shape, 1]
    apart = np.linalg.norm((corners @ (both[0] - both[1]).T)[:, :3], axis=1).max()
    if apart <= 0.5 * min(image.header.get_zooms()[:3]):
        return ()
    return (f"its sform and qform differ by up to {apart:.3g} (in its unit); the sform was used",)


def _check_forms(forms: dict[str, FloatArray], zooms: list[float], path: Path) -> None:
    signs = {name: bool(np.linalg.det(form[:3, :3]) > 0) for name, form in forms.items()}
    if len(set(signs.values())) > 1:
        raise ScanFileError(
            f"{path}: of its two orientations one is mirrored and one isn't (sform right-handed: "
            f"{signs['sform']}, qform: {signs['qform']}); keep one of them (its code 0 else)"
        )
    if "sform" not in forms:
        return
    lengths = np.linalg.norm(forms["sform"][:3, :3], axis=0)
    if not np.allclose(lengths, zooms, rtol=0.01):
        raise ScanFileError(
            f"{path}: its sform makes voxels of {np.round(lengths, 6).tolist()}, its pixdim of "
            f"{np.round(zooms, 6).tolist()} (i, j, k; limit 1 %); write it again with one size"
        )
