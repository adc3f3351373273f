"""Connected patches of a mask above a minimum area and width."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, find_objects, label

from registration.overlay.raster import Raster

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class PixelPatch:
    """A connected patch of pixels.

    Attributes
    ----------
    area_mm2 : float, mm²
    width_mm : float, mm
        Diameter of the largest circle within it.
    at_mm : (float, float), mm
        Middle of that circle, x and y, part frame; within the patch, however bent it is.
    low_mm, high_mm : (float, float), mm
        Its bounding box.
    box : (slice, slice)
        Rows and columns of the raster that hold it.
    mask : bool
        Its pixels within the box.
    """

    area_mm2: float
    width_mm: float
    at_mm: tuple[float, float]
    low_mm: tuple[float, float]
    high_mm: tuple[float, float]
    box: tuple[slice, slice]
    mask: Mask


def spots(mask: Mask, raster: Raster, least_mm2: float, least_width_mm: float) -> list[PixelPatch]:
    """Patches of at least this area and width, the largest first; a shared corner joins pixels."""
    labels, count = label(mask, np.ones((3, 3)))
    if count == 0:
        return []
    areas = np.bincount(labels.ravel(), minlength=count + 1)[1:] * raster.pixel_mm**2
    boxes = find_objects(labels)
    chosen = [k for k in np.argsort(-areas, kind="stable").tolist() if areas[k] >= least_mm2]
    patches = [_spot(labels[boxes[k]] == k + 1, boxes[k], float(areas[k]), raster) for k in chosen]
    return [one for one in patches if one.width_mm >= least_width_mm]


def _spot(mask: Mask, box: tuple[slice, slice], area: float, raster: Raster) -> PixelPatch:
    rows, columns = box
    deep = distance_transform_edt(np.pad(mask, 1))[1:-1, 1:-1]
    j, i = np.unravel_index(int(np.argmax(deep)), deep.shape)
    x, y, half = raster.x_mm, raster.y_mm, raster.pixel_mm / 2
    return PixelPatch(
        area_mm2=area,
        width_mm=(2 * float(deep[j, i]) - 1) * raster.pixel_mm,
        at_mm=(float(x[columns.start + i]), float(y[rows.start + j])),
        low_mm=(float(x[columns.start]) - half, float(y[rows.start]) - half),
        high_mm=(float(x[columns.stop - 1]) + half, float(y[rows.stop - 1]) + half),
        box=box,
        mask=mask,
    )
