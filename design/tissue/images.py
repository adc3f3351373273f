"""Read a volume image (NIfTI, NRRD, TIFF stack) with its position and orientation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.errors import TissueError
from design.tissue.tiff_stack import read_tiff
from design.units import MM_PER, LengthUnit
from kernels.arrays import FloatArray

IMAGE_SUFFIXES: Final = (".nii", ".nii.gz", ".nrrd", ".tif", ".tiff")

UNIT_NAMES: Final[dict[str, LengthUnit]] = {
    "um": "um",
    "\N{MICRO SIGN}m": "um",
    "\N{GREEK SMALL LETTER MU}m": "um",
    "micron": "um",
    "microns": "um",
    "mm": "mm",
    "millimeter": "mm",
    "millimeters": "mm",
    "cm": "cm",
    "centimeter": "cm",
    "m": "m",
    "meter": "m",
    "inch": "in",
}
"""How files spell units."""

_AGREE = 1e-3


@dataclass(frozen=True)
class VolumeImage:
    """Values on a lattice of voxels.

    Attributes
    ----------
    values : (a, b, c)
        Integers or floats, first index along x in a file's own axes.
    affine : (4, 4) float64
        From the index of a voxel to its centre in mm, in the file's frame (NIfTI: towards right,
        anterior, superior; NRRD: its ``space``; TIFF: the stack's corner is the origin).
    """

    values: NDArray[Any]
    affine: FloatArray

    @property
    def voxel_mm(self) -> FloatArray:
        """Length of a voxel along each index, (3,)."""
        lengths: FloatArray = np.linalg.norm(self.affine[:3, :3], axis=0)
        return lengths


@dataclass(frozen=True)
class _Raw:
    """What a file says: the affine in ``unit``, either unknown."""

    values: NDArray[Any]
    affine: FloatArray | None
    unit: LengthUnit | None


def read_image(
    path: Path,
    *,
    voxel_mm: tuple[float, float, float] | None = None,
    unit: LengthUnit | None = None,
) -> VolumeImage:
    """Read a volume image.

    Parameters
    ----------
    path : Path
        .nii, .nii.gz, .nrrd, .tif or .tiff.
    voxel_mm : (3,) float, optional
        Size of a voxel along x, y, z, for files that don't say; refused where the file says
        otherwise.
    unit : {"um", "mm", "cm", "m", "in"}, optional
        Of the file's own voxel size or affine, for files that don't say.

    Raises
    ------
    TissueError
        When the file can't be read, isn't one volume, or its voxel size is missing or in doubt.
    """
    path = Path(path)
    if not path.name.lower().endswith(IMAGE_SUFFIXES):
        raise TissueError(f"{path}: its name must end with one of {', '.join(IMAGE_SUFFIXES)}")
    if not path.is_file():
        raise TissueError(f"{path}: there is no such file")
    # The readers raise whatever their parsers do.
    try:
        raw = _read(path)
    except TissueError:
        raise
    except Exception as error:
        raise TissueError(
            f"{path}: can't be read as an image ({error}); export it again"
        ) from error
    raw = replace(raw, values=_one_channel(raw.values))
    if raw.values.ndim != 3:
        raise TissueError(
            f"{path}: holds {raw.values.shape} values; give one volume of one channel"
        )
    return VolumeImage(raw.values, _placed(path, raw, voxel_mm, unit))


def _one_channel(values: NDArray[Any]) -> NDArray[Any]:
    """Without axes of length 1 after the third."""
    if values.ndim > 3 and set(values.shape[3:]) == {1}:
        return values.reshape(values.shape[:3])
    return values


def _placed(
    path: Path,
    raw: _Raw,
    voxel_mm: tuple[float, float, float] | None,
    unit: LengthUnit | None,
) -> FloatArray:
    """Affine in mm, from the file or else from what the caller says."""
    if voxel_mm is not None and not all(np.isfinite(v) and v > 0 for v in voxel_mm):
        raise TissueError(f"{path}: voxel_mm is {voxel_mm}; give three sizes above 0")
    if raw.unit is not None and unit is not None and raw.unit != unit:
        raise TissueError(f"{path} declares its unit as {raw.unit}, not {unit}; state that unit")
    unit_name = raw.unit or unit
    if raw.affine is None:
        if voxel_mm is None:
            raise TissueError(f"{path} doesn't say how large a voxel is; give voxel_mm: [x, y, z]")
        return _stack_affine(voxel_mm)
    if unit_name is None:
        if voxel_mm is None:
            size = np.linalg.norm(raw.affine[:3, :3], axis=0)
            raise TissueError(
                f"{path} has voxels of {_by(size)} but doesn't say of which unit; give unit: mm "
                "(or um, cm, ...)"
            )
        unit_name = _fitting(path, raw.affine, voxel_mm)
    affine = raw.affine.copy()
    affine[:3] *= MM_PER[unit_name]
    if not (np.isfinite(affine).all() and abs(np.linalg.det(affine[:3, :3])) > 0):
        raise TissueError(f"{path}: its affine is singular; mend the header")
    size = np.linalg.norm(affine[:3, :3], axis=0)
    if voxel_mm is not None and not np.allclose(size, voxel_mm, rtol=_AGREE):
        raise TissueError(
            f"{path} says voxels are {_by(size)} mm, not voxel_mm {_by(np.array(voxel_mm))}; drop "
            "voxel_mm or mend the file"
        )
    return affine


def _fitting(path: Path, affine: FloatArray, voxel_mm: tuple[float, float, float]) -> LengthUnit:
    """The unit in which the file's affine has voxels of the size given."""
    size = np.linalg.norm(affine[:3, :3], axis=0)
    for unit, per in MM_PER.items():
        if np.allclose(size * per, voxel_mm, rtol=_AGREE):
            return unit
    raise TissueError(
        f"{path} has voxels of {_by(size)} of an unknown unit, which voxel_mm "
        f"{_by(np.array(voxel_mm))} doesn't fit in any; mend voxel_mm"
    )


def _by(size: FloatArray) -> str:
    return " x ".join(f"{value:.4g}" for value in size)


def _stack_affine(size: tuple[float, float, float]) -> FloatArray:
    """Voxels of ``size`` along the axes, the stack's corner at the origin."""
    affine = np.diag([*size, 1.0])
    affine[:3, 3] = 0.5 * np.array(size)
    return affine


def _read(path: Path) -> _Raw:
    name = path.name.lower()
    if name.endswith((".nii", ".nii.gz")):
        return _read_nifti(path)
    if name.endswith(".nrrd"):
        return _read_nrrd(path)
    values, size, unit = read_tiff(path)
    affine = None if size is None else _stack_affine(size)
    return _Raw(values, affine, UNIT_NAMES.get(unit.lower()) if unit else None)


def _read_nifti(path: Path) -> _Raw:
    import nibabel  # a fifth of a second that runs without such images don't pay

    image: Any = nibabel.load(path)
    unit = UNIT_NAMES.get(image.header.get_xyzt_units()[0])
    return _Raw(np.asanyarray(image.dataobj), np.asarray(image.affine, dtype=np.float64), unit)


def _read_nrrd(path: Path) -> _Raw:
    import nrrd  # as nibabel

    values, header = nrrd.read(str(path), index_order="F")
    # NRRD leaves out the directions of axes that aren't of space.
    directions = header.get("space directions")
    if directions is not None:
        spatial = np.array([d for d in np.atleast_2d(directions) if np.isfinite(d).all()])
        affine = np.eye(4)
        affine[:3, :3] = spatial.T
        affine[:3, 3] = header.get("space origin", np.zeros(3))
        units = header.get("space units")
    elif "spacings" in header:
        affine = _stack_affine(tuple(np.asarray(header["spacings"], dtype=float)[:3]))
        units = header.get("units")
    else:
        return _Raw(values, None, None)
    names = {str(name).strip('"').lower() for name in units or ()} - {""}
    if len(names) > 1:
        raise TissueError(f"{path}: its axes have different units ({', '.join(sorted(names))})")
    return _Raw(values, affine, UNIT_NAMES.get(names.pop()) if names else None)
