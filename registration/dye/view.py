"""Where the design's points are seen in the picture: a similarity through the user's marks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from design.network import VesselNetwork
from registration.dye.marks import FloatArray, Marks, marked_points
from registration.errors import DyeError

_RIGHT_AND_UP: Final = {
    # Seen from that side of the part: axis to the right, axis upwards.
    "z": ((1, 0, 0), (0, 1, 0)),
    "-z": ((1, 0, 0), (0, -1, 0)),
    "y": ((1, 0, 0), (0, 0, -1)),
    "-y": ((1, 0, 0), (0, 0, 1)),
    "x": ((0, 1, 0), (0, 0, 1)),
    "-x": ((0, 1, 0), (0, 0, -1)),
}
_LEAST_PX = 2.0


@dataclass(frozen=True)
class View:
    """A distant camera.

    Attributes
    ----------
    right, down : (3,) float64
        Axes of the part along the picture's before it is turned.
    factor, shift : complex, px/mm and px
        u + iv = factor · (right + i·down) + shift, of the conjugate where mirrored.
    mirrored : bool
    residual_mm : float, mm
        Root mean square over the marks; 0 with two of them, which always fit.
    either_way : bool
        The marks fit a mirrored picture as well.
    """

    right: FloatArray
    down: FloatArray
    factor: complex
    shift: complex
    mirrored: bool
    residual_mm: float
    either_way: bool = False

    @property
    def px_per_mm(self) -> float:
        """Scale of the picture."""
        return abs(self.factor)

    def pixels(self, points: FloatArray) -> FloatArray:
        """Where points (n, 3), mm, are seen, (n, 2); (0, 0) is the first pixel's middle."""
        seen = points @ self.right + 1j * (points @ self.down)
        placed = self.factor * (np.conj(seen) if self.mirrored else seen) + self.shift
        return np.stack([placed.real, placed.imag], axis=1)


def find_view(marks: Marks, network: VesselNetwork) -> View:
    """Fit a similarity (turn, scale, shift) to the marks.

    Raises
    ------
    DyeError
        Marks on one point, mirrored ones that don't say so, or ones that don't fit: further off
        than the median lumen's radius, or two pixels if that is more.
    """
    points, pixels = marked_points(marks, network)
    view, other = (_fitted(points, pixels, marks, marks.mirrored ^ flip) for flip in (False, True))
    limit = max(float(np.median(network.radius)), _LEAST_PX / max(view.px_per_mm, 1e-9))
    if view.residual_mm <= limit:
        return replace(view, either_way=other.residual_mm <= limit)
    off = f"marks are off by {view.residual_mm:.3g} mm, above {limit:.3g}"
    if len(points) > 2 and other.residual_mm <= limit:
        said = "mirrored: false" if marks.mirrored else "mirrored: true, if a mirror was used,"
        raise DyeError(
            f"{off}; they fit a mirrored picture to {other.residual_mm:.2g} mm: put {said} or the "
            f"other side than side: {marks.side} into the marks"
        )
    raise DyeError(f"{off}; check each mark's pixel (column, row from the top left) and side")


def _fitted(points: FloatArray, pixels: FloatArray, marks: Marks, mirrored: bool) -> View:
    right, up = (np.array(axis, dtype=np.float64) for axis in _RIGHT_AND_UP[marks.side])
    seen = points @ right - 1j * (points @ up)
    seen = np.conj(seen) if mirrored else seen
    placed = pixels[:, 0] + 1j * pixels[:, 1]
    a, b = seen - seen.mean(), placed - placed.mean()
    spread = float(np.sum(np.abs(a) ** 2))
    if spread < 1e-6 or float(np.sum(np.abs(b) ** 2)) < 1.0:
        raise DyeError(
            f"marks lie on one point, seen from side {marks.side}; take two far from each other"
        )
    factor = complex(np.sum(np.conj(a) * b) / spread)
    scale = max(abs(factor), 1e-9)
    residual = float(np.sqrt(np.mean(np.abs(b - factor * a) ** 2))) / scale
    shift = complex(placed.mean() - factor * seen.mean())
    return View(right, -up, factor, shift, mirrored, residual)
