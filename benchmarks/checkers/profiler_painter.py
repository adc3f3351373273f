"""Height maps of a laser line profiler over lines in layers, painted by formulas of their own.

Nothing of the product is imported. Lines are half ellipses on an upright foot; they sag between the
lines below, waver in height and width, and end round. A camera that looks at the laser's sheet from
one side doesn't see what is in the shadow; steep flanks, wet crests (streaks along a line), single
profiles and spots are lost; a few points are far off. The whole is turned, tilted and bowed, lies
off its height, and has speckle that is correlated along the sheet.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Kind = Literal["plate", "lattice", "solid"]
Bare = tuple[int, float, float]
"""Line of the top layer; from, to along it, mm."""


@dataclass
class Profiled:
    """A painted map; all lengths in mm.

    ``heights``: NaN where lost; ``to_map`` (4, 4) takes the printer's places to the map's;
    ``start``, ``end`` (n, 3) of the lines' tips in the printer's frame; ``surface``: true heights
    over the plate.
    """

    heights: NDArray[np.float32]
    px: float
    to_map: FloatArray
    start: FloatArray
    end: FloatArray
    layer: NDArray[np.int64]
    width: float
    thickness: float
    surface: FloatArray

    @property
    def middle_z(self) -> float:
        """Of the top layer."""
        return float(self.start[-1, 2]) - self.thickness / 2


def profiled(
    seed: int,
    kind: Kind,
    bare: tuple[Bare, ...] = (),
    size: float | None = None,
    px: float | None = None,
    hard: float = 1.0,
) -> Profiled:
    """Paint the top layer of ``kind`` with ``bare`` stretches; ``hard`` scales what isn't ideal."""
    rng = np.random.default_rng((seed, 5))
    width = float(rng.uniform(0.2, 0.45))
    thickness = float(rng.uniform(0.4, 0.7)) * width
    step = float(rng.uniform(0.012, 0.035))
    foot = float(rng.uniform(0.3, 0.6))
    side = float(rng.uniform(4.0, 8.0))
    px, side = px or step, size or side
    pitch = width * {"plate": float(rng.uniform(1.6, 3.0)), "lattice": 2.2, "solid": 0.92}[kind]
    layers = {"plate": 1, "lattice": int(rng.integers(2, 5)), "solid": 3}[kind]
    margin = 2.0
    count = int((side + 2 * margin) / px)
    at = np.asarray((np.arange(count) + 0.5) * px - margin, dtype=np.float64)
    surface = np.zeros((count, count))
    begins, ends, number = [], [], []
    for layer in range(layers):
        along_x = (layers - 1 - layer) % 2 == 0
        top = (layer + 1) * thickness
        own = surface if along_x else surface.T
        below = own.copy()
        for k, middle in enumerate(np.arange(width / 2, side - width / 2 + 1e-9, pitch)):
            holes = [one[1:] for one in bare if one[0] == k] if layer == layers - 1 else []
            _lay(own, below, at, middle, side, width, thickness, top, holes, rng, hard, foot)
            ways = [(0.0, middle), (side, middle)]
            if k % 2:
                ways.reverse()
            flat = [way if along_x else way[::-1] for way in ways]
            begins.append((*flat[0], top))
            ends.append((*flat[1], top))
            number.append(layer)
    heights = _looked_at(surface, px, rng, hard)
    # The map is turned against the printer by some angle, and lies beside it.
    turn = float(rng.uniform(-np.pi, np.pi))
    c, s = np.cos(turn), np.sin(turn)
    place = rng.uniform(50, 150, 2)
    z = float(rng.uniform(1, 20))
    turned = np.array([[c, -s], [s, c]])
    start, end = (
        np.column_stack([np.array(one)[:, :2] @ turned.T + place, np.array(one)[:, 2] + z])
        for one in (begins, ends)
    )
    to_map = np.eye(4)
    to_map[:2, :2] = turned.T
    to_map[:2, 3] = -turned.T @ place - at[0]
    to_map[2, 3] = -z + 3.0
    heights += 3.0
    return Profiled(
        heights.astype(np.float32), px, to_map, start, end, np.array(number), width, thickness,
        surface,
    )  # fmt: skip


def _lay(
    surface: FloatArray,
    below: FloatArray,
    at: FloatArray,
    middle: float,
    side: float,
    width: float,
    thickness: float,
    top: float,
    holes: list[tuple[float, float]],
    rng: np.random.Generator,
    hard: float,
    foot: float,
) -> None:
    """Lay one line along x onto a surface (y, x); ``below`` is what the layer is laid on."""
    rows = np.flatnonzero(np.abs(at - middle) < width)
    if len(rows) == 0:
        return
    slow = np.interp(at, np.linspace(-3, side + 3, 12), rng.normal(size=12))
    wide = width * (1 + 0.03 * hard * slow)
    crest = top + 0.04 * hard * thickness * np.interp(
        at, np.linspace(-3, side + 3, 20), rng.normal(size=20)
    )
    spans = cv2.blur((below[rows[len(rows) // 2]] < top - 1.5 * thickness).astype(float), (9, 1))
    crest = crest - 0.25 * hard * thickness * spans.ravel() * (top > 1.5 * thickness)
    # Distance along the line to the nearest end of ink; round ends.
    beyond = np.maximum(width / 2 - at, at - (side - width / 2))
    for low, high in holes:
        beyond = np.maximum(beyond, np.minimum(at - (low - width / 2), high + width / 2 - at))
    beyond = np.maximum(beyond, 0.0)
    off = np.hypot((at[rows] - middle)[:, None], beyond[None, :]) / (wide / 2)
    inside = off < 1
    dome = np.sqrt(np.clip(1 - off**2, 0, 1))
    height = crest - thickness * (1 - foot) * (1 - dome)
    surface[rows] = np.where(inside, np.maximum(surface[rows], height), surface[rows])


def _looked_at(surface: FloatArray, px: float, rng: np.random.Generator, hard: float) -> FloatArray:
    """What a profiler makes of a surface."""
    count = len(surface)
    seen = cv2.GaussianBlur(surface, (0, 0), 0.5)
    angle = np.deg2rad(rng.uniform(25, 45))
    down = bool(rng.integers(2))
    lost = _shadow(surface if down else surface[::-1], px, float(angle))
    lost = lost if down else lost[::-1]
    gy, gx = np.gradient(surface, px)
    lost |= (np.hypot(gx, gy) > np.tan(np.deg2rad(72))) & (rng.random(surface.shape) < 0.5)
    # Streaks on wet flanks that mirror the sheet into the camera.
    towards = np.arctan(gy if down else -gy) - angle / 2
    wet = cv2.GaussianBlur(rng.normal(size=surface.shape), (0, 0), 0.4 / px, sigmaY=0.05 / px)
    lost |= (np.abs(towards) < np.deg2rad(4)) & (wet > 1.3 * wet.std())
    spots = cv2.GaussianBlur(rng.normal(size=surface.shape), (0, 0), 0.05 / px)
    lost |= spots > np.quantile(spots, 1 - 0.002 * hard)
    for row in rng.integers(0, count, rng.poisson(0.7 * hard)):
        lost[row : row + int(rng.integers(1, 3))] = True
    speckle = cv2.GaussianBlur(rng.normal(size=surface.shape), (0, 0), 0.8, sigmaY=0.3)
    seen = seen + speckle / speckle.std() * rng.uniform(0.001, 0.005)
    far = rng.random(surface.shape) < 2e-4 * hard
    seen[far] += rng.normal(0, 0.5, int(far.sum()))
    u = np.linspace(-1, 1, count)
    tilt = rng.normal(0, 0.006 * hard, 3)
    seen += tilt[0] * u + tilt[1] * u[:, None] + tilt[2] * u * u + rng.normal(0, 0.005 * hard)
    seen[lost] = np.nan
    return np.asarray(seen)


def _shadow(surface: FloatArray, px: float, angle: float) -> BoolArray:
    """Places from which a ray that leans by an angle towards the first row meets the surface."""
    out = np.zeros(surface.shape, dtype=np.bool_)
    steps = int(np.ceil((surface.max() - surface.min()) * np.tan(angle) / px)) + 1
    for k in range(1, min(steps, len(surface) - 1)):
        out[k:] |= surface[:-k] > surface[k:] + k * px / np.tan(angle)
    return out
