"""NIfTI-1 and -2, plain or gzipped, by nibabel."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from registration.errors import ScanFileError
from registration.readers.broken import reading
from registration.readers.found import Array, Found
from registration.readers.limits import DEFLATE_RATIO, check_available
from registration.readers.orient import is_right_handed
from registration.readers.units import millimetres


def is_nifti(start: bytes) -> bool:
    """Whether a header (unzipped) is NIfTI: its length first, then a magic word."""
    one = start[:4] in (b"\x5c\x01\0\0", b"\0\0\x01\x5c") and start[344:347] in (b"n+1", b"ni1")
    two = start[:4] in (b"\x1c\x02\0\0", b"\0\0\x02\x1c") and start[4:7] in (b"n+2", b"ni2")
    return one or two


def read_nifti(path: Path) -> Found:
    """The volume; axes i, j, k become x, y, z, and the affine says whether they are mirrored.

    Raises
    ------
    ScanFileError
        When the file is broken, has a time axis, or a unit that isn't known.
    """
    with reading(path, "NIfTI"):
        image = _open(path)
        shape = tuple(int(size) for size in image.shape)
        while len(shape) > 3 and shape[-1] == 1:
            shape = shape[:-1]
        if len(shape) != 3:
            raise ScanFileError(f"{path}: has the axes {image.shape}; export one volume")
        return Found(_volume(image, shape, path), _known(image, path), _right_handed(image))


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


def _known(image: Any, path: Path) -> dict[str, Any]:
    unit = millimetres(image.header.get_xyzt_units()[0], path)
    known: dict[str, Any] = {"axes": "zyx"}
    if unit:
        known["voxel_mm"] = [float(size) * unit for size in image.header.get_zooms()[2::-1]]
    return known


def _right_handed(image: Any) -> bool | None:
    """From the affine, where the header carries one (a code above 0)."""
    header = image.header
    if int(header["sform_code"]) <= 0 and int(header["qform_code"]) <= 0:
        return None
    return is_right_handed(np.asarray(image.affine, dtype=np.float64)[:3, :3].T)
