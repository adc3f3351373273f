"""Orthographic camera: maps the part's frame to pixels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from kernels.arrays import FloatArray

View = Literal["oblique", "top", "front", "side", "back", "below"]

DIRECTIONS: Final[dict[View, tuple[float, float, float]]] = {
    "oblique": (-0.55, -1.0, 0.85),
    "top": (0.0, -1e-4, 1.0),
    "front": (0.0, -1.0, 0.0),
    "side": (1.0, 0.0, 0.0),
    "back": (0.0, 1.0, 0.0),
    "below": (0.0, -1e-4, -1.0),
}
"""From the scene towards the eye; the same in the page's 3D view."""


@dataclass(frozen=True, eq=False)
class Camera:
    """An orthographic camera.

    Attributes
    ----------
    turn : (3, 3) float64
        Rows: right, down and towards the eye, in the part's frame.
    centre : (3,) float64, mm
        What is in the middle of the picture.
    pixels_per_mm : float
    width, height : int
        Pixels.
    """

    turn: FloatArray
    centre: FloatArray
    pixels_per_mm: float
    width: int
    height: int

    def project(self, points: FloatArray) -> FloatArray:
        """Points (n, 3), mm, to pixels: x to the right, y downwards, z towards the eye."""
        seen: FloatArray = (points - self.centre) @ self.turn.T * self.pixels_per_mm
        seen[:, :2] += [(self.width - 1) / 2.0, (self.height - 1) / 2.0]
        return seen


def fitted_camera(points: FloatArray, view: View, width: int, height: int, margin: int) -> Camera:
    """A camera that sees all of ``points`` (n, 3), mm, ``margin`` pixels from the rim."""
    eye = np.array(DIRECTIONS[view])
    eye /= np.linalg.norm(eye)
    right = np.cross([0.0, 0.0, 1.0], eye)
    right /= np.linalg.norm(right)
    turn = np.stack([right, -np.cross(eye, right), eye])
    seen = points @ turn.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    extent = np.maximum(high - low, 1e-9)
    room = np.array([width - 2 * margin, height - 2 * margin])
    scale = float((room / extent[:2]).min())
    return Camera(turn, 0.5 * (low + high) @ turn, scale, width, height)
