"""Draw the needle, from its tip up towards the camera, into a simulated picture."""

from __future__ import annotations

import itertools
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from sim.devices.camera.optics import Camera
from sim.devices.camera.scene import Light, NeedleLook

SingleArray = NDArray[np.float32]

_NEAREST: Final = 0.02
"""Of the way from the pinhole to the tip: what is nearer is out of the picture."""
_KNOTS: Final = 60
_SHIFT: Final = 4
_FINE: Final = 4
"""Dots of the drawing along a pixel."""
_STRIPES: Final = ((1.0, 0.45), (0.85, 0.8), (0.55, 1.0), (0.18, 1.7))
"""Share of the needle's width, and brightness over its own: round steel has a bright line."""
_AROUND: Final = 32


def add_needle(
    taken: SingleArray, camera: Camera, needle: NeedleLook, tip_mm: FloatArray, light: Light
) -> None:
    """Draw a needle into the light that falls on the sensor, in place.

    Notes
    -----
    Its axis is vertical, and it is the outline of circles up the axis. Its end looks downwards, so
    a camera above sees no more of it than the near half of its rim. It is blurred as a whole,
    though less near its tip in truth.
    """
    height, width = taken.shape[:2]
    high = camera.eye_mm[2] - tip_mm[2]
    if high <= 0:
        return
    z = camera.eye_mm[2] - high * np.geomspace(1, _NEAREST, _KNOTS)
    rings = _rings(camera, tip_mm, z, needle.outer_mm / 2)
    if not _in_view(rings.reshape(-1, 2), width, height):
        return
    for number, (share, bright) in enumerate(_STRIPES):
        shaft = _rings(camera, tip_mm, z, share * needle.outer_mm / 2)
        hulls = [np.concatenate(pair) for pair in itertools.pairwise(shaft)]
        mask = _filled(hulls, (height, width))
        _blend(taken, mask, needle.brightness * bright, needle.defocus_px if number == 0 else 1.0)


def _rings(camera: Camera, tip_mm: FloatArray, z_mm: FloatArray, radius_mm: float) -> FloatArray:
    """Pixels of circles about the axis at heights (n,), (n, _AROUND, 2)."""
    angle = np.linspace(0, 2 * np.pi, _AROUND, endpoint=False)
    places = np.empty((len(z_mm), _AROUND, 3))
    places[..., 0] = tip_mm[0] + radius_mm * np.cos(angle)
    places[..., 1] = tip_mm[1] + radius_mm * np.sin(angle)
    places[..., 2] = z_mm[:, None]
    return camera.pixels(places.reshape(-1, 3)).reshape(len(z_mm), _AROUND, 2)


def _in_view(pixels: FloatArray, width: int, height: int) -> bool:
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    return bool((high > 0).all() and low[0] < width and low[1] < height)


def _filled(hulls: list[FloatArray], shape: tuple[int, int]) -> NDArray[np.uint8]:
    """Share of each pixel that lies in a hull of pixels; what lies far outside isn't drawn.

    OpenCV fills the pixels that an outline touches, too, which would make a needle a pixel wider:
    it is drawn finer.
    """
    mask = np.zeros(shape, np.uint8)
    limit = 3.0 * max(shape)
    near = [one for one in hulls if np.isfinite(one).all() and np.abs(one).max() <= limit]
    if not near:
        return mask
    reach = np.concatenate(near)
    low = np.clip(np.floor(reach.min(axis=0)).astype(int) - 1, 0, None)
    high = np.clip(np.ceil(reach.max(axis=0)).astype(int) + 2, None, shape[::-1])
    columns, rows = high - low
    if columns <= 0 or rows <= 0:
        return mask
    fine = np.zeros((_FINE * rows, _FINE * columns), np.uint8)
    for pixels in near:
        corners = (pixels - low + 0.5) * _FINE - 0.5
        hull = cv2.convexHull(np.round(corners * 2**_SHIFT).astype(np.int32))
        cv2.fillConvexPoly(fine, hull, 255, cv2.LINE_8, _SHIFT)
    box = cv2.resize(fine, (int(columns), int(rows)), interpolation=cv2.INTER_AREA)
    mask[low[1] : high[1], low[0] : high[0]] = box
    return mask


def _blend(taken: SingleArray, mask: NDArray[np.uint8], grey: float, blur_px: float) -> None:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return
    pad = int(4 * blur_px) + 2
    box = (
        slice(max(0, rows[0] - pad), rows[-1] + pad + 1),
        slice(max(0, columns[0] - pad), columns[-1] + pad + 1),
    )
    share = mask[box].astype(np.float32) / 255
    if blur_px > 0:
        share = cv2.GaussianBlur(share, (0, 0), blur_px)
    taken[box] += share[..., None] * (np.float32(grey) - taken[box])
