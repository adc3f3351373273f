"""Paint what spoils pictures of layers: soft shadow bars, ink whose density adds, dark crumbs.

Each works on the plane that `layer_painter.paint` paints (its ``overlay``), before the camera.
"""

from dataclasses import dataclass, field

import cv2
import numpy as np


@dataclass(frozen=True)
class Bar:
    """A shadow with parallel edges: a camera's arm, a syringe.

    Its edges rise as a cosine over ``soft_mm``, beyond ``half_mm`` to either side of the middle.
    """

    at_mm: tuple[float, float]
    angle: float
    half_mm: float
    soft_mm: float
    depth: float

    def light(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Factor of the light, 1 beside the bar."""
        across = (x - self.at_mm[0]) * np.cos(self.angle) + (y - self.at_mm[1]) * np.sin(self.angle)
        out = np.clip((np.abs(across) - self.half_mm) / self.soft_mm, 0.0, 1.0)
        return 1 - self.depth * 0.5 * (1 + np.cos(np.pi * out))


@dataclass(frozen=True)
class Crumb:
    """A dark convex crumb: corners (k, 2) mm; its brightness over the bath's, per channel."""

    corners_mm: np.ndarray
    tint: np.ndarray


@dataclass
class Troubles:
    """All of them; call it with a plane (h, w, 3) and places (h, w) in mm."""

    bars: list[Bar] = field(default_factory=list)
    crumbs: list[Crumb] = field(default_factory=list)
    extra: np.ndarray | None = None
    """Factor by which ink of further lines darkens or lightens each cell, (h, w, 3)."""

    def __call__(self, plane: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Paint them over it."""
        out = plane if self.extra is None else plane * self.extra
        cell = float(x[0, 1] - x[0, 0])
        for crumb in self.crumbs:
            place = (crumb.corners_mm - (x[0, 0], y[0, 0])) / cell
            cover = np.zeros(x.shape, np.float32)
            cv2.fillPoly(cover, [np.rint(place * 16).astype(np.int32)], 1.0, cv2.LINE_AA, 4)
            cover = cv2.GaussianBlur(cover, (0, 0), 0.7)[..., None]
            out = out * (1 - cover) + crumb.tint * np.median(plane, axis=(0, 1)) * cover
        for bar in self.bars:
            out = out * bar.light(x, y)[..., None]
        return out
