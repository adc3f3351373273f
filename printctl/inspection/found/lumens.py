"""Measure narrowest free width and open area of lumens in a picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.special import ndtr

from kernels.arrays import BoolArray, FloatArray
from printctl.inspection.pictures.picture import Mask
from printctl.inspection.values import FloatImage, Frame, Lumen, LumenFinding

_MIN_SLICED_ASPECT = 1.5
"""Aspect ratio of an outline from which on it is measured slice by slice."""
_MAX_UNSEEN_SHARE = 0.15
"""Largest unseen share of a lumen's area."""
_MAX_OLD_INK_SHARE = 0.3
"""Largest share of a lumen's area over older ink."""
_MAX_CELLS = 600
"""Largest number of resampled cells along a lumen."""
_U_EDGE_PX = 0.35
"""Standard uncertainty of either edge, in working pixels."""
_U_EDGE_LEVEL = 0.03
"""Relative standard uncertainty of the width by the level at which edges are taken."""


@dataclass(frozen=True)
class _Patch:
    """Resampled lumen, its long axis downwards: inside, ink, unseen and old-ink masks."""

    inside: BoolArray
    ink: FloatImage
    unseen: BoolArray
    old: BoolArray
    step_mm: float


def measure_lumens(
    lumens: Sequence[Lumen],
    image: FloatImage | None,
    unseen: BoolArray,
    old: Mask,
    frame: Frame,
    shift_mm: FloatArray,
    px_mm: float,
    noise: float,
    u_line_mm: float,
) -> tuple[LumenFinding, ...]:
    """Measure lumens; unseen where there is no image of ink, older ink below, or glare.

    Parameters
    ----------
    lumens : sequence of Lumen
    image : (h, w) float32 or None
        Bath 0, ink 1.
    unseen : (h, w) bool
    old : (h, w) uint8
    frame : Frame
        Counting working pixels.
    shift_mm : (2,) float64, mm
        Of the layer.
    px_mm : float, mm
    noise : float
        Scatter of the bath's single values.
    u_line_mm : float, mm
        Standard uncertainty of lines' widths: either side of a lumen may be off by half of it.
    """
    found = []
    for lumen in lumens:
        patch = None
        if image is not None:
            patch = _sample_patch(lumen, image, unseen, old, frame, shift_mm, px_mm)
        found.append(_measure_lumen(lumen, patch, px_mm, noise, u_line_mm))
    return tuple(found)


def _sample_patch(
    lumen: Lumen,
    image: FloatImage,
    unseen: BoolArray,
    old: Mask,
    frame: Frame,
    shift_mm: FloatArray,
    px_mm: float,
) -> _Patch | None:
    outline = np.asarray(lumen.outline, dtype=np.float64)
    flat = outline[:, :2] + shift_mm
    middle, sides, turn = cv2.minAreaRect(flat.astype(np.float32))
    angle = np.deg2rad(turn if sides[0] >= sides[1] else turn + 90)
    axis = np.array([np.cos(angle), np.sin(angle)])
    across = np.array([-axis[1], axis[0]])
    place = (flat - middle) @ np.column_stack([across, axis])
    low, high = place.min(axis=0), place.max(axis=0)
    step = max(0.5 * px_mm, float((high - low).max()) / _MAX_CELLS)
    count = np.ceil((high - low) / step).astype(int) + 1
    corners = np.rint((place - low) / step * 16).astype(np.int32)
    inside = np.zeros((count[1], count[0]), dtype=np.uint8)
    cv2.fillPoly(inside, [corners], 1, cv2.LINE_8, 4)
    v, s = np.meshgrid(np.arange(count[0]) * step + low[0], np.arange(count[1]) * step + low[1])
    points = np.empty((v.size, 3))
    points[:, :2] = v.reshape(-1, 1) * across + s.reshape(-1, 1) * axis + middle
    points[:, 2] = outline[:, 2].mean()
    seen = frame.to_pixels(points)
    if (
        not np.isfinite(seen).all()
        or (seen < 0).any()
        or (seen > (image.shape[1] - 1, image.shape[0] - 1)).any()
    ):
        return None
    x, y = (seen[:, k].reshape(v.shape).astype(np.float32) for k in range(2))
    soft = cv2.GaussianBlur(image, (0, 0), 0.7)
    return _Patch(
        inside > 0,
        cv2.remap(soft, x, y, cv2.INTER_LINEAR),
        cv2.remap(unseen.astype(np.uint8), x, y, cv2.INTER_NEAREST) > 0,
        cv2.remap(old, x, y, cv2.INTER_NEAREST) > 0,
        step,
    )


def _measure_lumen(
    lumen: Lumen, patch: _Patch | None, px_mm: float, noise: float, u_line_mm: float
) -> LumenFinding:
    nothing = LumenFinding(lumen.name, lumen.width_mm, np.nan, np.nan, np.nan, False, 1.0)
    if patch is None or not patch.inside.any():
        return nothing
    inside = patch.inside
    if (
        patch.unseen[inside].mean() > _MAX_UNSEEN_SHARE
        or patch.old[inside].mean() > _MAX_OLD_INK_SHARE
    ):
        return nothing
    clear = cv2.medianBlur((inside & (patch.ink < 0.5)).astype(np.uint8), 5) > 0
    share = float((clear & inside).sum() / inside.sum())
    ratio, scatter = _narrowest(clear & inside, inside, lumen.width_mm / patch.step_mm)
    edge = np.sqrt(2.0) * _U_EDGE_PX * px_mm / lumen.width_mm
    sides = u_line_mm / lumen.width_mm
    square = edge**2 + sides**2 + _U_EDGE_LEVEL**2 + scatter**2 + (0.1 * min(noise, 1.0)) ** 2
    u = float(np.sqrt(square))
    p_value = float(ndtr((ratio - 1.0) / u))
    return LumenFinding(
        lumen.name, lumen.width_mm, ratio * lumen.width_mm, u * lumen.width_mm, share, True, p_value
    )


def _narrowest(clear: BoolArray, inside: BoolArray, width_cells: float) -> tuple[float, float]:
    """Return the narrowest free width over the expected one, and its scatter."""
    if inside.shape[0] > _MIN_SLICED_ASPECT * inside.shape[1]:
        wide = inside.sum(axis=1)
        rows = wide > 0.9 * wide.max()
        share = clear[rows].sum(axis=1) / wide[rows]
        size = max(1, round(0.25 * width_cells))
        mean = uniform_filter1d(share, size, mode="nearest")
        usual = np.abs(np.diff(mean[::size])) if len(mean) > 4 * size else np.zeros(1)
        return float(mean.min()), 1.4826 * float(np.median(usual)) / np.sqrt(2)
    radius = [
        float(
            cv2.distanceTransform(
                cv2.copyMakeBorder(each.astype(np.uint8), 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0),
                cv2.DIST_L2,
                cv2.DIST_MASK_PRECISE,
            ).max()
        )
        for each in (clear, inside)
    ]
    return radius[0] / max(radius[1], 1e-9), 0.0
