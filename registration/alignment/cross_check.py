"""Cross-check the pose with an independent program, small_gicp, where it is installed.

It gets points of the design and points of the scan, stretched as the scaled fit says, and starts
from a pose that is off on purpose. Point-to-plane ICP with normals of its own (Koide 2024,
10.21105/joss.06948) then has to come back to where our fit is.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from kernels.arrays import FloatArray
from registration.alignment.distance import ModelSurface
from registration.alignment.fit import Fit

OFF_DEG, OFF_MM = 1.0, np.array([0.1, -0.1, 0.05])
"""Where it starts from, from our pose: about the part's middle, and along x, y, z."""
POINTS = 40_000
"""Of the scan that are used."""
GRID_MM = 0.02
"""Points nearer to each other than this are merged."""
REACH_MM = 0.5
"""Points further apart than this aren't each other's."""


def cross_check(
    surface: ModelSurface, spread: FloatArray, points: FloatArray, fit: Fit
) -> float | None:
    """How far small_gicp's pose moves the design's surface out of itself, µm; 95 % of it.

    A motion that leaves the surface where it is, as a turn of a straight channel about its axis,
    is no difference: a scan can't tell it. The few places that move farthest, as the far end of a
    thin channel, tell a turn that nothing else shows.

    Parameters
    ----------
    surface : ModelSurface
    spread : (m, 3) float64, mm
        Points all over it.
    points : (n, 3) float64, mm
        The scanned surface, in the scan's frame.
    fit : Fit
        Scan to part, with its stretch.

    Returns
    -------
    float or None
        None where small_gicp isn't installed (extra ``crosscheck``).
    """
    try:
        import small_gicp
    except ImportError:
        return None
    every = max(1, len(points) // POINTS)
    pose = small_gicp.align(
        spread,
        fit.apply(points[::every]),
        _off(surface.bounds.mean(axis=0)),
        registration_type="PLANE_ICP",
        downsampling_resolution=GRID_MM,
        max_correspondence_distance=REACH_MM,
        num_threads=1,  # several would add up in another order each time
        max_iterations=100,
        rotation_epsilon=1e-6,
        translation_epsilon=1e-6,
    ).T_target_source
    moved = spread @ pose[:3, :3].T + pose[:3, 3]
    return 1e3 * float(np.percentile(np.abs(surface.query(moved).distance), 95))


def _off(middle: FloatArray) -> FloatArray:
    axis = np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0)
    start = np.eye(4)
    start[:3, :3] = Rotation.from_rotvec(np.deg2rad(OFF_DEG) * axis).as_matrix()
    start[:3, 3] = middle - start[:3, :3] @ middle + OFF_MM
    return start
