"""Read volume images (NIfTI, NRRD, TIFF stack); convert a label to a smooth closed surface."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple
from xml.etree import ElementTree

import numpy as np
from manifold3d import Manifold
from numpy.typing import NDArray
from scipy.ndimage import find_objects, gaussian_filter
from scipy.ndimage import label as connected

from design.errors import TissueError
from design.geometry.surface import Surface
from design.tissue.closed import enclosed_volume, isosurface
from design.tissue.zones import distinct_manifold, surface_of
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
    "centimeters": "cm",
    "m": "m",
    "meter": "m",
    "meters": "m",
    "inch": "in",
    "inches": "in",
}
"""How files spell units."""
VOXEL_SIZE_TOLERANCE = 1e-3
"""Relative, between a file's voxel size and one given: files round theirs to float32 or a few
digits."""


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


class _Raw(NamedTuple):
    """A file's content; the affine, in ``unit``, and the unit are None where it has none."""

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
        Size of a voxel along x, y, z, for files without one; refused where the file has
        another.
    unit : {"um", "mm", "cm", "m", "in"}, optional
        Of the file's own voxel size or affine, for files without one.

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
    values = raw.values
    if values.ndim > 3 and set(values.shape[3:]) == {1}:
        values = values.reshape(values.shape[:3])
    if values.ndim != 3:
        raise TissueError(f"{path}: holds {values.shape} values; give one volume of one channel")
    return VolumeImage(values, _placed(path, raw, voxel_mm, unit))


def _placed(
    path: Path,
    raw: _Raw,
    voxel_mm: tuple[float, float, float] | None,
    unit: LengthUnit | None,
) -> FloatArray:
    """Return the affine in mm, from the file or else from the caller's voxel size."""
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
    if voxel_mm is not None and not np.allclose(size, voxel_mm, rtol=VOXEL_SIZE_TOLERANCE):
        raise TissueError(
            f"{path} says voxels are {_by(size)} mm, not voxel_mm {_by(np.array(voxel_mm))}; drop "
            "voxel_mm or mend the file"
        )
    return affine


def _fitting(path: Path, affine: FloatArray, voxel_mm: tuple[float, float, float]) -> LengthUnit:
    """The unit in which the file's affine has voxels of the size given."""
    size = np.linalg.norm(affine[:3, :3], axis=0)
    for unit, per in MM_PER.items():
        if np.allclose(size * per, voxel_mm, rtol=VOXEL_SIZE_TOLERANCE):
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
    return _read_tiff(path)


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


Size = tuple[float, float, float]


def _read_tiff(path: Path) -> _Raw:
    """Read a TIFF stack; ImageJ and OME files hold a voxel size, plain TIFF has none along z."""
    import tifffile  # a tenth of a second that runs without such images don't pay

    with tifffile.TiffFile(path) as file:
        series = file.series[0]
        values = series.asarray()
        axes = [axis for axis, size in zip(series.axes, values.shape, strict=True) if size > 1]
        size, unit = _size(file)
    stack = np.squeeze(values)
    if stack.ndim != 3 or "".join(axes)[1:] != "YX":
        raise TissueError(
            f"{path}: has axes {series.axes} of {values.shape}; give one stack of pictures of one "
            "channel"
        )
    affine = None if size is None else _stack_affine(size)
    values = np.ascontiguousarray(stack.transpose(2, 1, 0))
    return _Raw(values, affine, UNIT_NAMES.get(unit.lower()) if unit else None)


def _size(file: Any) -> tuple[Size | None, str | None]:
    if file.ome_metadata:
        return _ome_size(file.ome_metadata)
    metadata = file.imagej_metadata or {}
    tags = file.pages[0].tags
    if "spacing" not in metadata or "unit" not in metadata or "XResolution" not in tags:
        return None, None
    names = {str(metadata.get(key, metadata["unit"])) for key in ("unit", "yunit", "zunit")}
    units = {name.replace("\\u00B5", "µ") for name in names}
    if len(units) > 1:
        raise TissueError(
            f"{file.filename}: counts its axes in {' and '.join(sorted(units))}; export it with "
            "one unit, or take the units out and give voxel_mm"
        )
    # Pixels per unit, as a fraction.
    across = [tags[name].value for name in ("XResolution", "YResolution")]
    x, y = (bottom / top for top, bottom in across)
    return (x, y, abs(float(metadata["spacing"]))), units.pop()


def _ome_size(text: str) -> tuple[Size | None, str | None]:
    for element in ElementTree.fromstring(text).iter():
        if element.tag.endswith("}Pixels"):
            sizes = [element.get(f"PhysicalSize{axis}") for axis in "XYZ"]
            units = {element.get(f"PhysicalSize{axis}Unit", "µm") for axis in "XYZ"}
            if None in sizes or len(units) != 1:
                return None, None
            x, y, z = (float(str(value)) for value in sizes)
            return (x, y, z), units.pop()
    return None, None


class LabelSmoothing(NamedTuple):
    """How a label's voxels become a surface.

    The label's voxels, 1 inside and 0 outside, are blurred by a Gaussian of one voxel; the surface
    is where the blurred value passes a level, which is chosen such that the surface holds as much
    as the voxels do. Whatever the blur, the centres of all voxels stay on their side: walls one
    voxel thick and gaps one voxel wide remain, and the surface is nowhere farther than a voxel from
    the label's.
    """

    blur: float = 1.0  # voxels: standard deviation
    pad: int = 4  # voxels: around the label: as far as the blur reaches
    # Lowest and highest level tried: beyond, thin walls or gaps decide alone.
    levels: tuple[float, float] = (0.15, 0.85)
    margin: float = 0.05  # Least difference of a voxel's value from the level
    # voxels: how far simplifying may move the surface: the first that changes the volume
    # little enough.
    simplify: tuple[float, ...] = (0.03, 0.01, 0.003)
    volume_change: float = 2e-3  # By simplifying, at most
    max_voxels: int = 500_000_000  # Of an image: the mask takes 0.5 GB


SMOOTHING = LabelSmoothing()
_EVERY_VOXEL = np.ones((3, 3, 3))


def load_label_surface(
    path: Path,
    label: int,
    *,
    voxel_mm: tuple[float, float, float] | None = None,
    unit: LengthUnit | None = None,
) -> tuple[Surface, tuple[str, ...]]:
    """Read one label of an image as a surface in mm, in the file's frame.

    Parameters
    ----------
    path : Path
        NIfTI, NRRD or TIFF stack.
    label : int
        Value of the tissue's voxels.
    voxel_mm, unit
        As in `read_image`.

    Returns
    -------
    Surface
    notes : tuple of str
        Parts, and borders of the image that cut the label.

    Raises
    ------
    TissueError
        When the image can't be read, isn't one of labels, or doesn't hold the label.
    """
    path = Path(path)
    image = read_image(path, voxel_mm=voxel_mm, unit=unit)
    try:
        surface, notes = label_surface(image, label)
    except TissueError as error:
        raise TissueError(f"{path}: {error}") from error
    return surface, tuple(f"{path.name}: {note}" for note in notes)


def label_surface(image: VolumeImage, label: int) -> tuple[Surface, tuple[str, ...]]:
    """The surface of a label; see `load_label_surface`."""
    voxels, first = _cropped(image.values, label)
    notes = _remarks(image.values.shape, voxels, first, label)
    shape = _smooth(np.pad(voxels, SMOOTHING.pad))
    place = shape.vertices - SMOOTHING.pad + first
    vertices = place @ image.affine[:3, :3].T + image.affine[:3, 3]
    turned = np.linalg.det(image.affine[:3, :3]) < 0
    faces = shape.faces[:, ::-1] if turned else shape.faces
    solid = distinct_manifold(Surface(vertices, faces), f"the surface of label {label}")
    fewer = _simplified(solid, float(image.voxel_mm.min()))
    return surface_of(fewer, f"the surface of label {label}"), notes


def _simplified(solid: Manifold, voxel_mm: float) -> Manifold:
    """With as few faces as keep the volume."""
    for share in SMOOTHING.simplify:
        fewer = solid.simplify(share * voxel_mm)
        if abs(fewer.volume() / solid.volume() - 1.0) < SMOOTHING.volume_change:
            return fewer
    return solid


def _cropped(values: NDArray[Any], label: int) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """The box of the image that holds the label, as true and false, and its first index."""
    if values.size > SMOOTHING.max_voxels:
        raise TissueError(
            f"image has {values.size:.3g} voxels, above {SMOOTHING.max_voxels:.3g}; crop or bin it"
        )
    mask = values == label
    box = find_objects(mask.astype(np.int8))
    if not box:
        raise TissueError(f"no voxel has label {label}; {_labels(values)}")
    if not np.issubdtype(values.dtype, np.integer):
        inside = values[box[0]]
        if not (np.isfinite(inside).all() and (inside == np.round(inside)).all()):
            raise TissueError(
                "image holds values that aren't whole numbers: intensities, or labels that were "
                "interpolated; give a label image"
            )
    first = np.array([part.start for part in box[0]], dtype=np.int64)
    return mask[box[0]], first


def _labels(values: NDArray[Any]) -> str:
    labels, count = np.unique(values, return_counts=True)
    if len(labels) > 1000:
        return f"it has {len(labels)} different values, from {labels[0]:g} to {labels[-1]:g}"
    shown = ", ".join(f"{v:g} ({n} voxels)" for v, n in zip(labels[:12], count[:12], strict=True))
    return f"it has {shown}" + (", …" if len(labels) > 12 else "")


def _remarks(
    shape: tuple[int, ...], voxels: NDArray[np.bool_], first: NDArray[np.int64], label: int
) -> tuple[str, ...]:
    notes = []
    last = first + voxels.shape
    sides = [f"low {axis}" for axis, at in zip("xyz", first, strict=True) if at == 0]
    sides += [f"high {a}" for a, at, n in zip("xyz", last, shape, strict=True) if at == n]
    if sides:
        notes.append(
            f"label {label} reaches the image's border ({', '.join(sides)}); it is closed there"
        )
    parts, count = connected(voxels, _EVERY_VOXEL)
    if count > 1:
        size = np.sort(np.bincount(parts.ravel())[1:])[::-1]
        notes.append(
            f"label {label} is in {count} parts, of {', '.join(map(str, size[:5]))}"
            f"{', …' if count > 5 else ''} voxels; all were kept"
        )
    return tuple(notes)


def _smooth(voxels: NDArray[np.bool_]) -> Surface:
    """Surface in voxel indices that holds as much as the voxels."""
    from scipy.optimize import brentq  # heavy: other tissues do without

    blurred = gaussian_filter(
        voxels.astype(np.float64), SMOOTHING.blur, truncate=SMOOTHING.pad - 0.5
    )
    target = float(np.count_nonzero(voxels))

    def excess(level: float) -> float:
        shape = isosurface(_clipped(blurred, voxels, level), level)
        return enclosed_volume(shape.vertices, shape.faces) / target - 1.0

    low, high = SMOOTHING.levels
    if excess(low) <= 0:
        level = low
    elif excess(high) >= 0:
        level = high
    else:
        level = float(brentq(excess, low, high, xtol=1e-4))
    return isosurface(_clipped(blurred, voxels, level), level)


def _clipped(
    blurred: NDArray[np.float64], voxels: NDArray[np.bool_], level: float
) -> NDArray[np.float64]:
    """Return the values kept on their voxel's side of the level."""
    clipped: NDArray[np.float64] = np.where(
        voxels,
        np.maximum(blurred, level + SMOOTHING.margin),
        np.minimum(blurred, level - SMOOTHING.margin),
    )
    return clipped
