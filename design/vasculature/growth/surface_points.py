"""Sample points uniformly on a tissue's surface, with inward normals, as possible roots."""

from __future__ import annotations

import numpy as np

from design.tissue import Tissue
from kernels.arrays import FloatArray


def surface_points(
    tissue: Tissue, count: int, random: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Points (count, 3), mm, uniform over the surface, and the inward unit normals there.

    Uniform in a triangle: Osada et al. 2002, doi 10.1145/571647.571648, equation 1.
    """
    corner = tissue.surface.vertices[tissue.surface.faces]
    across = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    size = np.linalg.norm(across, axis=1)
    face = random.choice(len(size), count, p=size / size.sum())
    u, v = np.sqrt(random.uniform(size=count)), random.uniform(size=count)
    mix = np.column_stack([1.0 - u, u * (1.0 - v), u * v])
    points: FloatArray = np.einsum("nk,nkx->nx", mix, corner[face])
    normals: FloatArray = -across[face] / size[face, None]
    return points, normals
