"""Convert one label of a segmented volume image to a smooth closed surface.

The label's voxels, 1 inside and 0 outside, are blurred by a Gaussian of one voxel; the surface is
where the blurred value passes a level, which is chosen such that the surface holds as much as the
voxels do. Whatever the blur says, the centres of all voxels stay on their side: walls one voxel
thick and gaps one voxel wide remain, and the surface is nowhere farther than a voxel from the
label's.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from manifold3d import Manifold
from numpy.typing import NDArray
from scipy.ndimage import find_objects, gaussian_filter
from scipy.ndimage import label as connected

from design.errors import TissueError
from design.geometry.surface import Surface
from design.tissue.closed import enclosed_volume
from design.tissue.images import VolumeImage, read_image
from design.tissue.isosurface import isosurface
from design.tissue.manifolds import distinct_manifold, surface_of
from design.units import LengthUnit

_BLUR_VOXELS = 1.0
_PAD = 4
_MARGIN = 0.05
"""Least distance of a voxel's value from the level."""

_LEVELS = (0.15, 0.85)
_SIMPLIFY_VOXELS = (0.03, 0.01, 0.003)
"""How far simplifying may move the surface: the first that changes the volume little enough."""

_SIMPLIFY_VOLUME = 2e-3
_MOST_VOXELS = 500_000_000
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
    shape = _smooth(np.pad(voxels, _PAD))
    place = shape.vertices - _PAD + first
    vertices = place @ image.affine[:3, :3].T + image.affine[:3, 3]
    turned = np.linalg.det(image.affine[:3, :3]) < 0
    faces = shape.faces[:, ::-1] if turned else shape.faces
    solid = distinct_manifold(Surface(vertices, faces), f"the surface of label {label}")
    fewer = _simplified(solid, float(image.voxel_mm.min()))
    return surface_of(fewer, f"the surface of label {label}"), notes


def _simplified(solid: Manifold, voxel_mm: float) -> Manifold:
    """With as few faces as keep the volume."""
    for share in _SIMPLIFY_VOXELS:
        fewer = solid.simplify(share * voxel_mm)
        if abs(fewer.volume() / solid.volume() - 1.0) < _SIMPLIFY_VOLUME:
            return fewer
    return solid


def _cropped(values: NDArray[Any], label: int) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """The box of the image that holds the label, as true and false, and its first index."""
    if values.size > _MOST_VOXELS:
        raise TissueError(
            f"image has {values.size:.3g} voxels, above {_MOST_VOXELS:.3g}; crop or bin it"
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

    blurred = gaussian_filter(voxels.astype(np.float64), _BLUR_VOXELS, truncate=_PAD - 0.5)
    target = float(np.count_nonzero(voxels))

    def excess(level: float) -> float:
        shape = isosurface(_held(blurred, voxels, level), level)
        return enclosed_volume(shape.vertices, shape.faces) / target - 1.0

    low, high = _LEVELS
    if excess(low) <= 0:
        level = low
    elif excess(high) >= 0:
        level = high
    else:
        level = float(brentq(excess, low, high, xtol=1e-4))
    return isosurface(_held(blurred, voxels, level), level)


def _held(
    blurred: NDArray[np.float64], voxels: NDArray[np.bool_], level: float
) -> NDArray[np.float64]:
    """Values kept on their voxel's side of the level."""
    held: NDArray[np.float64] = np.where(
        voxels, np.maximum(blurred, level + _MARGIN), np.minimum(blurred, level - _MARGIN)
    )
    return held
