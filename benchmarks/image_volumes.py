"""Processing of labelled volumes: Euler number, level surfaces."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from skimage.measure import euler_number as skimage_euler
from skimage.measure import marching_cubes

from benchmarks.image_timing import against, cpu_ms
from design.tissue.isosurface import isosurface
from registration.measuring.topology.compare import euler_number
from registration.segmentation.mesh import surface

FloatArray = NDArray[np.float64]


def volume_rows(quick: bool) -> Iterator[dict[str, Any]]:
    """Rows of all volumes."""
    side = 100 if quick else 200
    voxels = np.pad(gaussian_filter(np.random.default_rng(1).normal(size=(side,) * 3), 3) > 0.02, 1)
    yield euler(voxels)
    yield level_surface(side)
    yield tissue_surface(side // 2)


def euler(voxels: NDArray[np.bool_]) -> dict[str, Any]:
    """Euler number of 26-connected voxels: difference."""
    ours = euler_number(voxels)
    peer = skimage_euler(voxels, connectivity=3)
    return against(
        "Euler number", "difference", (0.0, cpu_ms(lambda: euler_number(voxels), 2)),
        **{
            "skimage.euler_number": (
                float(peer - ours),
                cpu_ms(lambda: skimage_euler(voxels, connectivity=3), 2),
            )
        },
    )  # fmt: skip


def ball(side: int) -> tuple[NDArray[np.float32], FloatArray, float]:
    """Return a smooth ball's grey values, its centre (z, y, x) and its radius, voxels."""
    centre, radius = np.full(3, side / 2) + (0.2, 0.37, -0.41), side * 0.37
    z, y, x = np.ogrid[:side, :side, :side]
    away = np.sqrt((z - centre[0]) ** 2 + (y - centre[1]) ** 2 + (x - centre[2]) ** 2)
    return np.tanh((radius - away) / 2).astype(np.float32), centre, radius


def level_surface(side: int) -> dict[str, Any]:
    """Distance of a ball's vertices from it: RMS, 1e-3 voxels."""
    values, centre, radius = ball(side)

    def off(vertices: FloatArray) -> float:
        away = np.linalg.norm(vertices - centre, axis=1) - radius
        return 1e3 * float(np.sqrt(np.mean(away**2)))

    def ours() -> Any:
        return surface(values, 0.0, 1.0)

    def library() -> Any:
        return marching_cubes(values, 0.0)

    return against(
        "surface of a level", "1e-3 voxels", (off(ours()[0][:, ::-1]), cpu_ms(ours, 2)),
        **{"skimage.marching_cubes": (off(library()[0]), cpu_ms(library, 2))},
    )  # fmt: skip


def tissue_surface(side: int) -> dict[str, Any]:
    """Edges of a noisy label's surface that don't join two faces, of 1e6 edges."""
    noise = np.random.default_rng(2).normal(size=(side,) * 3)
    values = np.pad(noise, 2, constant_values=-1)

    def broken(vertices: FloatArray, faces: FloatArray) -> float:
        mesh = trimesh.Trimesh(vertices, faces, process=False)
        _, count = np.unique(mesh.edges_sorted, axis=0, return_counts=True)
        return 1e6 * float((count != 2).mean())

    def ours() -> Any:
        return isosurface(values, 0.0)

    def library() -> Any:
        return marching_cubes(values, 0.0)

    found = ours()
    return against(
        "closed surface of noise",
        "bad edges of 1e6",
        (broken(found.vertices, found.faces), cpu_ms(ours, 1)),
        **{"skimage.marching_cubes": (broken(*library()[:2]), cpu_ms(library, 1))},
    )
