"""Shapes that no organ's mesh was taken from."""

import numpy as np

from design.geometry.surface import Surface


def bean(length_mm: float = 44.0, notch: float = 0.45, steps: int = 48) -> Surface:
    """A closed bean along y whose notch is at its -x side."""
    u = np.linspace(0, 2 * np.pi, 2 * steps, endpoint=False)
    v = np.linspace(-np.pi / 2, np.pi / 2, steps + 1)[1:-1]
    uu, vv = np.meshgrid(u, v)
    half = length_mm / 2
    y = half * np.sin(vv)
    x = 0.5 * half * np.cos(vv) * np.cos(uu)
    z = 0.4 * half * np.cos(vv) * np.sin(uu)
    left = np.clip(-np.cos(uu), 0, 1) ** 2 * np.exp(-((y / (0.28 * half)) ** 2))
    x = x + notch * half * left * np.exp(-((z / (0.3 * half)) ** 2)) - 0.12 * half * (y / half) ** 2
    rows, columns = x.shape
    points = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    bottom = [-0.12 * half, -half, 0.0]
    top = [-0.12 * half, half, 0.0]
    points = np.concatenate([points, [bottom, top]])
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b = number[:-1], np.roll(number, -1, axis=1)[:-1]
    c, d = number[1:], np.roll(number, -1, axis=1)[1:]
    sides = np.concatenate(
        [np.stack([a, c, b], -1).reshape(-1, 3), np.stack([b, c, d], -1).reshape(-1, 3)]
    )
    first, last = number[0], number[-1]
    caps = np.concatenate(
        [
            np.column_stack([first, np.roll(first, -1), np.full(columns, rows * columns)]),
            np.column_stack([np.roll(last, -1), last, np.full(columns, rows * columns + 1)]),
        ]
    )
    faces = np.concatenate([sides, caps]).astype(np.int32)
    surface = Surface(points, faces)
    return surface if surface.volume_mm3 > 0 else Surface(points, faces[:, ::-1].copy())
