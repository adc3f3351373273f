"""Make parametric tissue surfaces: block, cylinder, ring, cortex, heart, kidney, liver."""

from __future__ import annotations

from math import ceil, pi

import numpy as np
from manifold3d import Manifold
from numpy.typing import NDArray

from design.errors import TissueError
from design.geometry.surface import Surface
from design.tissue.zones import arrays_of
from kernels.arrays import FloatArray


def block(size_mm: tuple[float, float, float]) -> Surface:
    """Box from the origin to ``size_mm``; volume is the product of its sides."""
    _positive(x_mm=size_mm[0], y_mm=size_mm[1], z_mm=size_mm[2])
    bottom = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float64)
    return _prism(bottom * size_mm[:2], size_mm[2])


def cylinder(diameter_mm: float, height_mm: float, sides: int = 96) -> Surface:
    """Regular prism inscribed in a cylinder about z, from z = 0 up.

    Volume: ½ n r² sin(2π/n) h.
    """
    _positive(diameter_mm=diameter_mm, height_mm=height_mm)
    return _prism(_circle(0.5 * diameter_mm, sides), height_mm)


def annulus(outer_mm: float, inner_mm: float, height_mm: float, sides: int = 96) -> Surface:
    """Ring about z between two diameters, from z = 0 up.

    Volume: ½ n (R² - r²) sin(2π/n) h.
    """
    _positive(outer_mm=outer_mm, inner_mm=inner_mm, height_mm=height_mm)
    if inner_mm >= outer_mm:
        raise TissueError(f"annulus: inner {inner_mm:g} mm isn't below outer {outer_mm:g} mm")
    rings = [_circle(0.5 * d, sides) for d in (outer_mm, outer_mm, inner_mm, inner_mm)]
    heights = (0.0, height_mm, height_mm, 0.0)
    rows = [np.column_stack([r, np.full(sides, z)]) for r, z in zip(rings, heights, strict=True)]
    return _torus(np.stack(rows))


def folded_cortex(
    thickness_mm: float = 3.0,
    width_mm: float = 32.0,
    fold_mm: float = 16.0,
    amplitude_mm: float = 4.0,
    folds: float = 2.5,
    facet_mm: float = 1.0,
) -> Surface:
    """Slab of grey matter in sinusoidal gyri, equally thick everywhere along its normal.

    The middle surface is z = a cos(2π x / fold), extruded along y; the slab reaches half its
    thickness to either side. Its volume is thickness x arc length x width, exact because the
    offsets on the two sides of a bend cancel, as long as no bend is tighter than half the
    thickness.

    Raises
    ------
    TissueError
        When the folds are too tight for the thickness.
    """
    _positive(thickness_mm=thickness_mm, width_mm=width_mm, fold_mm=fold_mm, folds=folds)
    _positive(amplitude_mm=amplitude_mm, facet_mm=facet_mm)
    k = 2.0 * pi / fold_mm
    tightest = 1.0 / (amplitude_mm * k * k)
    if tightest <= 0.5 * thickness_mm:
        raise TissueError(
            f"folded cortex: bends of radius {tightest:.3g} mm are tighter than half the "
            f"thickness of {thickness_mm:g} mm; lower amplitude_mm or raise fold_mm"
        )
    along = max(8, ceil(3.0 * folds * fold_mm / facet_mm))
    x = np.linspace(0.0, folds * fold_mm, along + 1)
    middle = np.column_stack([x, amplitude_mm * np.cos(k * x)])
    slope = -amplitude_mm * k * np.sin(k * x)
    normal = np.column_stack([-slope, np.ones_like(x)]) / np.hypot(slope, 1.0)[:, None]
    upper, lower = middle + 0.5 * thickness_mm * normal, middle - 0.5 * thickness_mm * normal
    # Points across the slab's ends keep facets there as small as elsewhere.
    steps = max(1, round(thickness_mm / facet_mm))
    inner = np.arange(1, steps)[:, None] / steps
    right = lower[-1] * (1 - inner) + upper[-1] * inner
    left = upper[0] * (1 - inner) + lower[0] * inner
    outline = np.concatenate([lower, right, upper[::-1], left])
    return _extruded(outline, width_mm, max(1, round(width_mm / facet_mm)), along, steps)


def _positive(**lengths: float) -> None:
    for name, value in lengths.items():
        if not (np.isfinite(value) and value > 0):
            raise TissueError(f"shape: {name} is {value:g}; give a length above 0")


def _circle(radius: float, sides: int) -> FloatArray:
    if sides < 3:
        raise TissueError(f"shape: {sides} sides don't enclose anything; give at least 3")
    angle = 2.0 * pi * np.arange(sides) / sides
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def _prism(outline: FloatArray, height: float) -> Surface:
    """Extrude a convex outline (n, 2), counter-clockwise, along z."""
    n = len(outline)
    vertices = np.concatenate([np.column_stack([outline, np.full(n, z)]) for z in (0.0, height)])
    i = np.arange(n)
    j = (i + 1) % n
    sides = np.concatenate([np.column_stack([i, j, j + n]), np.column_stack([i, j + n, i + n])])
    fan = np.column_stack([np.zeros(n - 2, dtype=int), i[1:-1], i[2:]])
    faces = np.concatenate([sides, fan[:, ::-1], fan + n])
    return Surface(vertices, faces.astype(np.int32))


def _torus(rows: FloatArray) -> Surface:
    """Close rows (a, b, 3) of points, neighbours joined in both directions, cyclically."""
    a, b, _ = rows.shape
    i, j = np.meshgrid(np.arange(a), np.arange(b), indexing="ij")
    here, right = i * b + j, i * b + (j + 1) % b
    up, across = (i + 1) % a * b + j, (i + 1) % a * b + (j + 1) % b
    faces = np.concatenate(
        [np.stack([here, right, across], -1), np.stack([here, across, up], -1)]
    ).reshape(-1, 3)
    return Surface(rows.reshape(-1, 3), faces.astype(np.int32))


def _extruded(outline: FloatArray, width: float, rows: int, along: int, steps: int) -> Surface:
    """Extrude a slab's outline (n, 2) in (x, z) along y.

    The outline runs along the lower side (``along`` edges), up the end (``steps`` edges), back
    and down.
    """
    n = len(outline)
    y = np.linspace(0.0, width, rows + 1)
    vertices = np.empty((rows + 1, n, 3))
    vertices[..., 0], vertices[..., 2] = outline[:, 0], outline[:, 1]
    vertices[..., 1] = y[:, None]
    i, j = np.meshgrid(np.arange(rows), np.arange(n), indexing="ij")
    here, right = i * n + j, i * n + (j + 1) % n
    walls = [np.stack([here, here + n, right + n], -1), np.stack([here, right + n, right], -1)]
    faces = [w.reshape(-1, 3) for w in walls]
    cap, inner = _slab_cap(outline, along, steps)
    caps = np.concatenate([vertices.reshape(-1, 3)] + [_lift(inner, at) for at in (0.0, width)])
    base = (rows + 1) * n
    for shift, first, flip in ((0, base, False), (rows * n, base + len(inner), True)):
        number = np.concatenate([np.arange(n) + shift, np.arange(len(inner)) + first])
        faces.append(number[cap][:, ::-1] if flip else number[cap])
    return Surface(caps, np.concatenate(faces).astype(np.int32))


def _lift(points: FloatArray, y: float) -> FloatArray:
    return np.column_stack([points[:, 0], np.full(len(points), y), points[:, 1]])


def _slab_cap(outline: FloatArray, along: int, steps: int) -> tuple[NDArray[np.int64], FloatArray]:
    """Triangles over a slab's outline, and the points inside it that they use.

    Counter-clockwise in (x, z), which is seen from -y.
    """
    n = len(outline)
    lower = np.arange(along + 1)
    upper = np.arange(along + steps, along + steps + along + 1)[::-1]
    weights = np.arange(1, steps) / steps
    inside = (
        outline[lower[1:-1], None] * (1 - weights)[:, None]
        + outline[upper[1:-1], None] * weights[:, None]
    )
    grid = np.empty((along + 1, steps + 1), dtype=np.int64)
    grid[:, 0], grid[:, -1] = lower, upper
    grid[-1, 1:-1] = np.arange(along + 1, along + steps)
    grid[0, 1:-1] = np.arange(n - 1, n - steps, -1)
    grid[1:-1, 1:-1] = n + np.arange((along - 1) * (steps - 1)).reshape(along - 1, steps - 1)
    a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
    cap = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)
    return cap, inside.reshape(-1, 2)


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


WIDTH, THICKNESS = 0.5, 0.42
"""Of the bean, over its length."""
BEND = 0.06
"""How far the poles lean to the hilum's side, over the length."""
SINUS_DEPTH, SINUS_HEIGHT, SINUS_THICKNESS = 0.24, 0.15, 0.1
"""Of the sinus, over the length; the latter two are standard deviations of its Gaussian outline."""


def kidney(length_mm: float = 60.0, sides: int = 96) -> Surface:
    """Bean along y with its hilum at the -x side, lying on z = 0.

    An ellipsoid, bent, with a Gaussian dent in the middle of its concave side.

    Raises
    ------
    TissueError
        When the length isn't positive.
    """
    if not length_mm > 0:
        raise TissueError(f"kidney: length_mm is {length_mm:g}; give a length above 0")
    ball, faces = arrays_of(Manifold.sphere(1.0, sides))
    x, y, z = 0.5 * ball.T
    z = THICKNESS * z
    dent = np.clip(-2.0 * x, 0.0, None) ** 2
    dent *= np.exp(-0.5 * ((y / SINUS_HEIGHT) ** 2 + (z / SINUS_THICKNESS) ** 2))
    x = WIDTH * x + SINUS_DEPTH * dent - BEND * (2.0 * y) ** 2
    points = length_mm * np.column_stack([x, y, z - z.min()])
    return Surface(np.ascontiguousarray(points), faces)


DEPTH, HEIGHT = 0.65, 0.62
"""Of the right lobe, over the width."""
TAPER = 0.55
"""Share of depth and height that is lost from the right side to the left."""
HOLLOW, HOLLOW_SPREAD = 0.2, 0.12
"""Depth of the hollow of the porta over the width; standard deviation of its outline."""
GROOVE, GROOVE_SPREAD = 0.18, 0.06
"""Depth of the vena cava's groove over the width; standard deviation across it."""


def liver(width_mm: float = 60.0, sides: int = 96) -> Surface:
    """Wedge along x, thick at -x, its hollow below, the groove at -y, lying on z = 0.

    An ellipsoid, tapered, with a Gaussian dent from below and a groove from behind.

    Raises
    ------
    TissueError
        When the width isn't positive.
    """
    if not width_mm > 0:
        raise TissueError(f"liver: width_mm is {width_mm:g}; give a width above 0")
    ball, faces = arrays_of(Manifold.sphere(1.0, sides))
    x, y, z = 0.5 * ball.T
    dent = HOLLOW * np.clip(-2.0 * z, 0.0, None) ** 2
    dent *= np.exp(-0.5 * (x**2 + y**2) / HOLLOW_SPREAD**2)
    groove = GROOVE * np.clip(-2.0 * y, 0.0, None) ** 2 * np.exp(-0.5 * (x / GROOVE_SPREAD) ** 2)
    thick = 1.0 - TAPER * (x + 0.5)
    y, z = thick * (DEPTH * y + groove), thick * (HEIGHT * z + dent)
    points = width_mm * np.column_stack([x, y, z - z.min()])
    return Surface(np.ascontiguousarray(points), faces)
