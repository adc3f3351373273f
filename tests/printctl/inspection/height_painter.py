"""Height maps of a solid layer over a solid one, painted by formulas of their own.

A zigzag of touching lines; its surface has ridges, bows, tilts, droops at the part's rim, swells
as a whole; heights carry noise that is correlated over some pixels, and a few drop out.
"""

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass
class SolidLayer:
    """One drawn layer; all lengths in mm.

    Attributes
    ----------
    width, thickness, size, px : float
    start, end : (n, 2) float64
        Of the zigzag's pieces, one unbroken path.
    picture : (h, w, 2) float32
        Brightness, and height over the layer's middle.
    """

    width: float
    thickness: float
    size: float
    px: float
    start: FloatArray
    end: FloatArray
    picture: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 0, 2), np.float32))

    def to_pixels(self, points_mm: FloatArray) -> FloatArray:
        """Column and row of places (n, 3), mm; a margin of 1 mm lies around the part."""
        return (np.asarray(points_mm)[:, :2] + 1.0) / self.px - 0.5


def solid_layer(
    rng: np.random.Generator, gaps: tuple[tuple[float, float], ...] = (), hard: float = 1.0
) -> SolidLayer:
    """Paint one; ``gaps`` are (from, to) mm along its path, ``hard`` scales what isn't flat."""
    width = float(rng.uniform(0.15, 0.3))
    thickness = float(rng.uniform(0.4, 0.6)) * width
    px = float(rng.uniform(0.02, 0.04))
    size = float(rng.uniform(3.0, 6.0))
    rows = np.arange(width / 2, size - width / 2, width)
    ends = np.array(
        [(width / 2, size - width / 2)[:: 1 if k % 2 == 0 else -1] for k in range(len(rows))]
    )
    corners = np.column_stack([ends.ravel(), np.repeat(rows, 2)])
    layer = SolidLayer(width, thickness, size, px, corners[:-1], corners[1:])
    count = int((size + 2.0) / px)
    x, y = np.meshgrid(*2 * ((np.arange(count) + 0.5) * px - 1.0,))
    inside = (x > 0) & (x < size) & (y > 0) & (y < rows[-1] + width / 2)
    rim = np.minimum(np.minimum(x, size - x), np.minimum(y, rows[-1] + width / 2 - y))
    u, v = 2 * x / size - 1, 2 * y / size - 1
    shape = rng.uniform(-0.12, 0.12, 6) * hard
    relief = shape[0] + shape[1] * u + shape[2] * v + shape[3] * u * u + shape[4] * u * v
    relief += shape[5] * np.sin(2.5 * u + rng.uniform(0, 6)) * np.sin(2.5 * v)
    relief += rng.uniform(0, 0.2) * hard * (np.cos(2 * np.pi * (y / width - 0.5)) - 1)
    droop = float(rng.uniform(0, 0.9) * hard)
    relief -= droop * np.exp(-((rim / (0.6 * width)) ** 2))
    present = np.ones_like(x)
    for begin, end in gaps:
        present = np.minimum(present, 1.0 - _covered(layer, x, y, begin, end))
    relief = 0.5 + relief - (1.0 - cv2.GaussianBlur(present, (0, 0), 0.02 / px))
    noise = cv2.GaussianBlur(rng.normal(size=x.shape), (0, 0), rng.uniform(0.5, 1.5))
    relief += noise / noise.std() * rng.uniform(0.03, 0.15)
    height = np.where(inside, relief * thickness, -2.0)
    bright = np.where(inside, 9.0, 6.0) + 0.2 * rng.normal(size=x.shape)
    layer.picture = np.stack([bright, height], axis=2).astype(np.float32)
    return layer


def _covered(
    layer: SolidLayer, x: FloatArray, y: FloatArray, begin: float, end: float
) -> FloatArray:
    """1 within half a width of the path between two places along it."""
    out, at = np.zeros_like(x), 0.0
    for a, b in zip(layer.start, layer.end, strict=True):
        length = float(np.linalg.norm(b - a))
        low, high = max(begin, at), min(end, at + length)
        if high > low:
            p, q = (a + (b - a) * (s - at) / length for s in (low, high))
            near = np.clip(
                ((x - p[0]) * (q - p)[0] + (y - p[1]) * (q - p)[1]) / ((q - p) @ (q - p)), 0, 1
            )
            off = np.hypot(x - p[0] - near * (q - p)[0], y - p[1] - near * (q - p)[1])
            square = (near > 0) & (near < 1)
            out[(off <= layer.width / 2) & square] = 1.0
        at += length
    return out
