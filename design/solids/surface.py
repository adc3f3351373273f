"""Make a solid of a closed surface from a file, unrepaired, only to be cut into sections."""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold
from numpy.typing import NDArray

from design.errors import SolidError
from design.solids.manifolds import to_manifold
from design.solids.merge import merge_equal
from design.solids.solid import Solid
from design.solids.topology import is_closed

_WHAT = "the tissue's surface"


def sections_solid(vertices: NDArray[np.floating], faces: NDArray[np.integer]) -> Solid:
    """Make a solid for sections alone of a closed, oriented surface: with the file's own vertices.

    Sheets that touch, or faces that cross, are left: sections don't mind them, files that are
    written do. Parameters and errors are those of `design.solids.construct.solid_from_surface`.
    """
    merged, triangles = _merged(vertices, faces)
    if not is_closed(triangles, touching=True):
        to_manifold(merged, triangles, _WHAT)  # says what is wrong
    solid = Solid(merged, triangles.astype(np.int32))
    _check_volume(solid.volume_mm3)
    return solid


def checked_surface(
    vertices: NDArray[np.floating], faces: NDArray[np.integer]
) -> tuple[NDArray[np.float64], NDArray[np.int64], Manifold]:
    """Equal vertices merged, collapsed faces dropped; and the manifold that it is."""
    merged, triangles = _merged(vertices, faces)
    manifold = to_manifold(merged, triangles, _WHAT)
    _check_volume(manifold.volume())
    return merged, triangles, manifold


def _merged(
    vertices: NDArray[np.floating], faces: NDArray[np.integer]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    merged, index = merge_equal(np.asarray(vertices, np.float64))
    triangles = index[np.asarray(faces)]
    a, b, c = triangles.T
    triangles = triangles[(a != b) & (b != c) & (c != a)]
    # A vertex of no face would widen the bounds by which parts are placed.
    used, corners = np.unique(triangles, return_inverse=True)
    return merged[used], corners.reshape(-1, 3)


def _check_volume(volume_mm3: float) -> None:
    if volume_mm3 <= 0:
        raise SolidError(
            f"{_WHAT} encloses {volume_mm3:g} mm³: it is inside out; reverse its faces"
        )
