"""Simulated camera of a dye video: light paths from lumen cells to pixels."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from scipy.sparse import coo_array, csr_array

from kernels.arrays import FloatArray
from sim.devices.dye.lumens import Stretch
from sim.devices.dye.transport import ANNULI, DyeFlow, Transport

_AXES: Final = {
    # To the right and downwards in the picture, seen from that side.
    "z": ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0)),
    "-z": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    "y": ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    "-y": ((1.0, 0.0, 0.0), (0.0, 0.0, -1.0)),
    "x": ((0.0, 1.0, 0.0), (0.0, 0.0, -1.0)),
    "-x": ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
}
_STEEPEST = 0.25


@dataclass(frozen=True)
class DyeCamera:
    """A camera: distant, or a pinhole at some distance, straight above or tilted.

    Attributes
    ----------
    width, height : int
        Pixels.
    px_per_mm : float
    centre_mm : (float, float, float)
        Part's point in the middle of the picture.
    turn_deg : float
        Clockwise turn of the picture.
    side : str
        The camera's side of the part: z, -z, x, -x, y or -y.
    mirrored : bool
        Filmed by way of a mirror.
    tilt_deg : float
        Of the line of sight from straight above: what is lower in the picture (before it is
        turned) comes nearer.
    distance_mm : float
        Pinhole to ``centre_mm``; without end by default, so that no perspective is seen.
    """

    width: int = 640
    height: int = 360
    px_per_mm: float = 36.0
    centre_mm: tuple[float, float, float] = (8.0, 4.0, 1.5)
    turn_deg: float = 0.0
    side: Literal["z", "-z", "x", "-x", "y", "-y"] = "z"
    mirrored: bool = False
    tilt_deg: float = 0.0
    distance_mm: float = np.inf

    def pixels(self, points: FloatArray) -> FloatArray:
        """Where points (n, 3), mm, are seen, (n, 2); (0, 0) is the first pixel's middle."""
        right, down, _ = self._axes()
        seen = points - np.array(self.centre_mm)
        flat = np.stack([seen @ right, seen @ down], axis=1) * self.scales(points)[:, None]
        angle = np.radians(self.turn_deg)
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        flat = flat @ turn.T
        if self.mirrored:
            flat[:, 0] *= -1.0
        placed: FloatArray = flat + [(self.width - 1) / 2.0, (self.height - 1) / 2.0]
        return placed

    def scales(self, points: FloatArray) -> FloatArray:
        """Size of things at points (n, 3), not foreshortened, (n,), px/mm."""
        farther = (points - np.array(self.centre_mm)) @ self._axes()[2]
        return np.asarray(self.px_per_mm / (1.0 + farther / self.distance_mm))

    def _axes(self) -> FloatArray:
        """Right, down and away from the camera, (3, 3)."""
        right, down = (np.array(axis) for axis in _AXES[self.side])
        away, tilt = np.cross(right, down), np.radians(self.tilt_deg)
        lower = np.cos(tilt) * down + np.sin(tilt) * away
        return np.array([right, lower, np.cross(right, lower)])


def light_paths(camera: DyeCamera, flow: DyeFlow, transport: Transport) -> csr_array:
    """Length of each pixel's ray within each cell's annuli, (pixels, cells · ANNULI), mm.

    A piece is a straight tube; its ends are cut off square, so that joints are neither rounded nor
    counted twice.
    """
    rows, columns, values = [], [], []
    for index, part in enumerate(flow.parts):
        cells = (int(transport.first[index]), int(transport.first[index + 1]))
        for pixel, cell, chords in _pieces(camera, part, cells):
            rows.append(np.repeat(pixel, ANNULI))
            columns.append((cell[:, None] * ANNULI + np.arange(ANNULI)).ravel())
            values.append(chords.ravel())
    shape = (camera.width * camera.height, len(transport.dye) * ANNULI)
    if not rows:
        return csr_array(shape)
    joined = (np.concatenate(rows), np.concatenate(columns))
    return coo_array((np.concatenate(values), joined), shape=shape).tocsr()


def _pieces(
    camera: DyeCamera, part: Stretch, cells: tuple[int, int]
) -> Iterator[tuple[FloatArray, FloatArray, FloatArray]]:
    seen, volumes, along = camera.pixels(part.points), part.volumes(), part.along()
    scales = camera.scales(part.points)
    for k in range(len(seen) - 1):
        start, way = seen[k], seen[k + 1] - seen[k]
        length = float(np.hypot(*way))
        real = float(along[k + 1] - along[k]) * float(scales[k : k + 2].mean())
        if length < 1e-6 or real < 1e-9:
            continue
        reach = float((part.radius * scales)[k : k + 2].max())
        pixel, points = _near(camera, start, start + way, reach)
        share = (points - start) @ way / length**2
        # Half way in space isn't half way in the picture: what is far is seen small.
        share = share * scales[k + 1] / (scales[k] + share * (scales[k + 1] - scales[k]))
        scale = 1.0 / ((1.0 - share) / scales[k] + share / scales[k + 1])
        aside = np.abs((points - start) @ np.array([-way[1], way[0]])) / length / scale
        radius = part.radius[k] + share * (part.radius[k + 1] - part.radius[k])
        hit = (share >= 0.0) & (share < 1.0) & (aside < radius)
        volume = volumes[k] + share[hit] * (volumes[k + 1] - volumes[k])
        cell = cells[0] + (volume / volumes[-1] * (cells[1] - cells[0])).astype(np.int64)
        chords = _chords(aside[hit], radius[hit]) / max(length / real, _STEEPEST)
        yield pixel[hit], np.minimum(cell, cells[1] - 1), chords


def _near(
    camera: DyeCamera, start: FloatArray, end: FloatArray, reach_px: float
) -> tuple[FloatArray, FloatArray]:
    """Pixels about a piece: their numbers and places."""
    size = np.array([camera.width, camera.height])
    margin = reach_px + 1.0
    low = np.clip(np.floor(np.minimum(start, end) - margin), 0, size).astype(int)
    high = np.clip(np.ceil(np.maximum(start, end) + margin) + 1, 0, size).astype(int)
    u, v = np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]))
    points = np.stack([u.ravel(), v.ravel()], axis=1).astype(np.float64)
    return (v * camera.width + u).ravel(), points


def _chords(aside: FloatArray, radius: FloatArray) -> FloatArray:
    """Length of a ray at a distance from the axis within each annulus, (n, ANNULI), mm."""
    edge = radius[:, None] * np.sqrt(np.arange(ANNULI + 1) / ANNULI)
    within = 2.0 * np.sqrt(np.maximum(edge**2 - aside[:, None] ** 2, 0.0))
    return np.diff(within, axis=1)
