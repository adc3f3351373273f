"""Test pictures of lines with known widths, painted pixel by pixel."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np


@dataclass(frozen=True)
class Painted:
    """A line: corners (k, 2), mm, and its width at each, mm; its ends are round, or cut straight.

    Pieces of one line whose widths differ are cut straight, or a thick one's end would cover the
    thin one beside it.
    """

    corners: np.ndarray
    width_mm: np.ndarray
    round_ends: bool = True


@dataclass(frozen=True)
class Camera:
    """How it is seen.

    ``per_mm``: what the ink takes away per mm; None for opaque. ``light`` falls off by that share
    from one side to the other.
    """

    um_per_px: float = 20.0
    turn_deg: float = 4.0
    tilt: float = 0.0
    mirrored: bool = False
    blur_px: float = 1.2
    noise: float = 0.02
    light: float = 0.3
    per_mm: float | None = None
    bright: bool = False


def view_of(camera: Camera, size_mm: tuple[float, float]) -> tuple[np.ndarray, tuple[int, int]]:
    """Homography from mm to pixels, and (height, width) of the picture."""
    side = round(1.25 * float(np.hypot(*size_mm)) * 1e3 / camera.um_per_px)
    scale = 1e3 / camera.um_per_px
    angle = np.radians(camera.turn_deg)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    linear = scale * turn @ np.diag([-1.0 if camera.mirrored else 1.0, 1.0])
    linear = np.diag([1.0, -1.0]) @ linear  # pixels count downwards
    shift = np.array([side / 2, side / 2]) - linear @ (np.array(size_mm) / 2)
    affine = np.array([[*linear[0], shift[0]], [*linear[1], shift[1]], [0, 0, 1]])
    middle = np.array([[1, 0, side / 2], [0, 1, side / 2], [0, 0, 1]])
    tilt = np.array([[1, 0, 0], [0, 1, 0], [camera.tilt / side, 0.6 * camera.tilt / side, 1]])
    return middle @ tilt @ np.linalg.inv(middle) @ affine, (side, side)


def paint(
    lines: Sequence[Painted], camera: Camera, size_mm: tuple[float, float], seed: int = 0
) -> np.ndarray:
    """Grey picture, 8 bits."""
    matrix, (high, wide) = view_of(camera, size_mm)
    back = np.linalg.inv(matrix)
    px = camera.um_per_px * 1e-3
    thick = np.zeros((high, wide))
    for line in lines:
        for (a, b), (wa, wb) in zip(
            zip(line.corners[:-1], line.corners[1:], strict=True),
            zip(line.width_mm[:-1], line.width_mm[1:], strict=True),
            strict=True,
        ):
            ends = np.array([a, b]) @ matrix[:, :2].T + matrix[:, 2]
            ends = ends[:, :2] / ends[:, 2:]
            room = max(wa, wb) / px + 3
            u0, v0 = np.maximum(np.floor(ends.min(axis=0) - room).astype(int), 0)
            u1, v1 = np.ceil(ends.max(axis=0) + room).astype(int)
            u, v = np.meshgrid(np.arange(u0, min(u1, wide)), np.arange(v0, min(v1, high)))
            w = back[2, 0] * u + back[2, 1] * v + back[2, 2]
            x = (back[0, 0] * u + back[0, 1] * v + back[0, 2]) / w
            y = (back[1, 0] * u + back[1, 1] * v + back[1, 2]) / w
            way = b - a
            beyond = ((x - a[0]) * way[0] + (y - a[1]) * way[1]) / (way @ way)
            share = np.clip(beyond, 0, 1)
            away = np.hypot(x - a[0] - share * way[0], y - a[1] - share * way[1])
            radius = (wa + share * (wb - wa)) / 2
            if camera.per_mm is None:
                own = np.clip((radius - away) / px + 0.5, 0, 1)
            else:
                own = 2 * np.sqrt(np.maximum(radius**2 - away**2, 0))
            if not line.round_ends:
                own = np.where(np.abs(beyond - 0.5) <= 0.5, own, 0.0)
            part = thick[v0 : v0 + own.shape[0], u0 : u0 + own.shape[1]]
            np.maximum(part, own, out=part)
    shade = thick if camera.per_mm is None else 1 - np.exp(-camera.per_mm * thick)
    shade = cv2.GaussianBlur(shade, (0, 0), camera.blur_px)
    level = 40 + 150 * shade if camera.bright else 200 - 150 * shade
    u, v = np.meshgrid(np.linspace(0, 1, wide), np.linspace(0, 1, high))
    lit = level * (1 - camera.light * (0.7 * u + 0.3 * v**2))
    lit += np.random.default_rng(seed).normal(0, camera.noise * 150, lit.shape)
    return np.clip(np.round(lit), 0, 255).astype(np.uint8)
