"""Make a parametric heart surface: both ventricles as truncated ellipsoid shells."""

from __future__ import annotations

from manifold3d import Manifold

from design.errors import TissueError
from design.geometry.surface import Surface
from design.tissue.manifolds import arrays_of

# Semi-axes and centres of a heart 60 mm long, mm; z points to the base.
LEFT_OUTER = (20.0, 20.0, 44.0)
LEFT_INNER = (11.0, 11.0, 35.0)
RIGHT_OUTER = (25.0, 19.0, 38.0)
RIGHT_INNER = (20.5, 14.5, 33.5)
RIGHT_CENTRE = (17.0, 0.0, 2.0)
BASE_Z = 16.0


def biventricle(length_mm: float = 60.0, sides: int = 96) -> Surface:
    """Left and right ventricle as truncated ellipsoid shells that share the septum.

    (left outer ∪ right outer) - left cavity - (right cavity - left outer), cut flat at the base;
    both cavities are open there. A hull of 4.5 (right) to 9 mm (left) at the default length from
    apex to base.

    Raises
    ------
    TissueError
        When a length isn't positive.
    """
    if not length_mm > 0:
        raise TissueError(f"biventricle: length_mm is {length_mm:g}; give a length above 0")
    left, left_cavity = _ellipsoid(LEFT_OUTER, sides), _ellipsoid(LEFT_INNER, sides)
    right = _ellipsoid(RIGHT_OUTER, sides).translate(RIGHT_CENTRE)
    right_cavity = _ellipsoid(RIGHT_INNER, sides).translate(RIGHT_CENTRE)
    walls = (left + right) - left_cavity - (right_cavity - left)
    body = walls.trim_by_plane((0.0, 0.0, -1.0), -BASE_Z)
    body = body.translate((0.0, 0.0, LEFT_OUTER[2]))
    scale = length_mm / (LEFT_OUTER[2] + BASE_Z)
    return Surface(*arrays_of(body.scale((scale, scale, scale))))


def _ellipsoid(axes: tuple[float, float, float], sides: int) -> Manifold:
    return Manifold.sphere(1.0, sides).scale(axes)
