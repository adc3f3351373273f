"""Surfaces of a tube along z for tests: of facets, and as voxels."""

import numpy as np

from design.network import VesselNetwork
from kernels.arrays import FloatArray, IntArray
from tests.design.networks import polyline


def straight(radius: float, length: float) -> VesselNetwork:
    """A vessel from node 0 at the origin to node 1 up z."""
    return polyline([[0.0, 0.0, 0.0], [0.0, 0.0, length]], radius)


def faceted_tube(
    radius: float, length: float, sides: int, beyond: float
) -> tuple[FloatArray, IntArray]:
    """A closed tube whose corners lie on the circle, ``beyond`` mm longer at either end."""
    angle = 2.0 * np.pi * np.arange(sides) / sides
    rows = 8
    heights = np.linspace(-beyond, length + beyond, rows + 1)
    ring = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    side = [np.column_stack([ring, np.full(sides, height)]) for height in heights]
    points = np.concatenate([*side, [[0.0, 0.0, heights[0]], [0.0, 0.0, heights[-1]]]])
    here, there = np.arange(sides), (np.arange(sides) + 1) % sides
    faces = []
    for low in range(0, rows * sides, sides):
        high = low + sides
        faces += [np.column_stack([low + here, low + there, high + there])]
        faces += [np.column_stack([low + here, high + there, high + here])]
    bottom, top = np.full(sides, len(points) - 2), np.full(sides, len(points) - 1)
    faces += [np.column_stack([bottom, there, here])]
    faces += [np.column_stack([top, rows * sides + here, rows * sides + there])]
    return points, np.concatenate(faces)


def voxels_of_tube(
    radius: float, length: float, step: float, noise: float, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, float]:
    """Share of each voxel that lies in the tube, with noise; first voxel's centre; spacing.

    The tube goes on 0.2 mm beyond its ends, and lies off the voxels' middles.
    """
    fine = 4
    across = np.arange(-radius - 0.15, radius + 0.15 + step / 2, step)
    up = np.arange(-0.2, length + 0.2 + step / 2, step)
    sub = (across[:, None] + ((np.arange(fine) + 0.5) / fine - 0.5) * step).ravel()
    inside = (sub[:, None] + 0.007) ** 2 + (sub[None] - 0.003) ** 2 < radius**2
    share = inside.reshape(len(across), fine, len(across), fine).mean(axis=(1, 3))
    volume = np.repeat(share[..., None], len(up), axis=2)
    volume = volume + noise * rng.standard_normal(volume.shape)
    for axis in range(3):
        for end in (0, -1):
            np.moveaxis(volume, axis, 0)[end] = 0.0
    return volume, np.array([across[0], across[0], up[0]]), step
