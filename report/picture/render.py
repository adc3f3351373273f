"""Render a network scene: shaded tubes in a translucent surface, as pixels."""

from __future__ import annotations

from math import cos, pi, sin, sqrt
from typing import Any, Final

import cv2
import numpy as np
from numba import prange
from numpy.typing import NDArray
from scipy.sparse import csr_array

from design.geometry.surface import Surface
from design.network import VesselNetwork
from kernels import jit, pjit
from kernels.arrays import FloatArray, IntArray
from report.picture.camera import Camera
from report.picture.quantity import Quantity

# A piece is the hull of the spheres between its ends, so neighbours that share an end and a radius
# join without a seam.
BANDS = 32
"""Strips of the picture, each drawn by one thread."""


@jit
def front_of_sphere(wx: float, wy: float, r: float) -> float:
    """Height of a sphere's front above its centre at (wx, wy) from it; -inf beside it."""
    left = r * r - wx * wx - wy * wy
    return sqrt(left) if left >= 0.0 else -np.inf


@jit
def front_of_cone(
    wx: float, wy: float, ux: float, uy: float, uz: float, ra: float, dr: float
) -> tuple[float, float]:
    """Height above the first end, and place along the piece, of the hull's front; -inf beside it.

    With w from the first end, u along the piece and radius ra + t dr the hull's surface is where
    f(t) = |w - t u|² - (ra + t dr)² and f'(t) vanish. With k = u² - dr² that is
    t = (w·u + ra dr) / k and k (w² - ra²) = (w·u + ra dr)², a quadratic in w's height.
    """
    k = ux * ux + uy * uy + uz * uz - dr * dr
    if k <= 0.0:
        # One end sphere lies within the other and is all there is.
        return -np.inf, 0.0
    a = k - uz * uz
    m = wx * ux + wy * uy + ra * dr
    c = k * (wx * wx + wy * wy - ra * ra) - m * m
    b = m * uz
    root = b * b - a * c
    if root < 0.0:
        return -np.inf, 0.0
    # The second root as c over the first stays exact as a goes through 0, where a cone that
    # points at the eye has its tip just above its base's rim.
    both = b + sqrt(root) if b >= 0.0 else b - sqrt(root)
    best, place = -np.inf, 0.0
    for which in range(2):
        over, under = (both, a) if which == 0 else (c, both)
        if under == 0.0:
            continue
        height = over / under
        t = (m + height * uz) / k
        if 0.0 <= t <= 1.0 and height > best:
            best, place = height, t
    return best, place


@jit
def front_of_piece(
    px: float, py: float, a: Any, b: Any, ra: float, rb: float
) -> tuple[float, float]:
    """Depth of a piece's front at pixel (px, py), and the place t along it; -inf beside it."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    depth, t = front_of_cone(px - a[0], py - a[1], ux, uy, uz, ra, rb - ra)
    depth += a[2]
    near = a[2] + front_of_sphere(px - a[0], py - a[1], ra)
    if near > depth:
        depth, t = near, 0.0
    far = b[2] + front_of_sphere(px - b[0], py - b[1], rb)
    if far > depth:
        depth, t = far, 1.0
    return depth, t


@pjit
def draw_tubes(
    start: Any, end: Any, start_radius: Any, end_radius: Any, height: int, width: int
) -> Any:
    """Depth buffer of all pieces.

    Parameters
    ----------
    start, end : (n, 3) float64
        In pixels: x to the right, y downwards, z towards the eye; the centre of pixel (i, j) is
        at x = j, y = i.
    start_radius, end_radius : (n,) float64
        In pixels.

    Returns
    -------
    depth : (height, width) float64
        z of the nearest surface; -inf where there is none.
    piece : (height, width) int64
        Whose it is; -1 where there is none.
    place : (height, width) float64
        Where along it, 0 to 1.
    """
    depth = np.full((height, width), -np.inf)
    piece = np.full((height, width), -1)
    place = np.zeros((height, width))
    for band in prange(BANDS):
        top, bottom = band * height // BANDS, (band + 1) * height // BANDS
        for i in range(len(start)):
            ra, rb = start_radius[i], end_radius[i]
            y0 = max(top, int(np.ceil(min(start[i, 1] - ra, end[i, 1] - rb))))
            y1 = min(bottom, int(np.floor(max(start[i, 1] + ra, end[i, 1] + rb))) + 1)
            if y0 >= y1:
                continue
            x0 = max(0, int(np.ceil(min(start[i, 0] - ra, end[i, 0] - rb))))
            x1 = min(width, int(np.floor(max(start[i, 0] + ra, end[i, 0] + rb))) + 1)
            for y in range(y0, y1):
                for x in range(x0, x1):
                    z, t = front_of_piece(float(x), float(y), start[i], end[i], ra, rb)
                    if z > depth[y, x]:
                        depth[y, x] = z
                        piece[y, x] = i
                        place[y, x] = t
    return depth, piece, place


SAMPLES = 28
_GOLDEN = pi * (3.0 - sqrt(5.0))
_BIAS = 0.06


@pjit
def occlude(depth: Any, normal: Any, reach: float) -> Any:
    """Openness of each pixel's surroundings, from 1 (open) to 0 (enclosed).

    Samples on a golden spiral of radius ``reach`` count by how far they rise above the pixel's
    tangent plane, v·n / |v|, and less the farther they are (after McGuire et al. 2011, "The
    Alchemy screen-space ambient obscurance algorithm", doi 10.1145/2018323.2018327). Nothing that
    the depth buffer hides is known to it.

    Parameters
    ----------
    depth : (height, width) float64
        In pixels, towards the eye; -inf where there is nothing.
    normal : (height, width, 3) float64
        Of the surface: x to the right, y downwards, z towards the eye.
    reach : float
        In pixels.
    """
    height, width = depth.shape
    open_share = np.ones((height, width))
    for y in prange(height):
        for x in range(width):
            z = depth[y, x]
            if z == -np.inf:
                continue
            # A turn of its own for each pixel (Jimenez 2014) trades bands for fine grain.
            turn = 52.9829189 * ((0.06711056 * x + 0.00583715 * y) % 1.0) % 1.0 * 2.0 * pi
            hidden = 0.0
            for k in range(SAMPLES):
                r = reach * sqrt((k + 0.5) / SAMPLES)
                j = x + round(r * cos(k * _GOLDEN + turn))
                i = y + round(r * sin(k * _GOLDEN + turn))
                if i < 0 or j < 0 or i >= height or j >= width or depth[i, j] == -np.inf:
                    continue
                vx, vy, vz = float(j - x), float(i - y), depth[i, j] - z
                far = sqrt(vx * vx + vy * vy + vz * vz)
                if far == 0.0:
                    continue
                rises = (
                    vx * normal[y, x, 0] + vy * normal[y, x, 1] + vz * normal[y, x, 2]
                ) / far - _BIAS
                if rises > 0.0:
                    hidden += rises / (1.0 + (far / reach) ** 2)
            open_share[y, x] = max(0.0, 1.0 - 2.6 * hidden / SAMPLES)
    return open_share


FACE_ON = 0.045
"""Opacity of a layer seen face-on."""
GRAZING = 0.42
"""Opacity that a layer seen edge-on has above that."""


@jit
def layer_opacity(facing: float) -> float:
    """Opacity of a layer whose normal has the share ``facing`` (0 to 1) along the view."""
    slant = 1.0 - facing
    return FACE_ON + GRAZING * slant * slant * slant


@pjit
def draw_shell(points: Any, normals: Any, faces: Any, depth: Any) -> Any:
    """Light let through by the layers in front of ``depth``, 1 where there are none.

    The product of all layers' transparencies, whose order doesn't matter as they share a colour.

    Parameters
    ----------
    points : (n, 3) float64
        In pixels, as in `report.picture.render.draw_tubes`.
    normals : (m, 3, 3) float64
        Unit normal at each corner of each face.
    faces : (m, 3) int64
    depth : (height, width) float64
        Of what is opaque.

    Returns
    -------
    (height, width) float64
    """
    height, width = depth.shape
    through = np.ones((height, width))
    for band in prange(BANDS):
        top, bottom = band * height // BANDS, (band + 1) * height // BANDS
        for f in range(len(faces)):
            a, b, c = points[faces[f, 0]], points[faces[f, 1]], points[faces[f, 2]]
            y0 = max(top, int(np.ceil(min(a[1], b[1], c[1]))))
            y1 = min(bottom, int(np.floor(max(a[1], b[1], c[1]))) + 1)
            area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
            if y0 >= y1 or area == 0.0:
                continue
            x0 = max(0, int(np.ceil(min(a[0], b[0], c[0]))))
            x1 = min(width, int(np.floor(max(a[0], b[0], c[0]))) + 1)
            for y in range(y0, y1):
                for x in range(x0, x1):
                    v = ((x - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (y - a[1])) / area
                    w = ((b[0] - a[0]) * (y - a[1]) - (x - a[0]) * (b[1] - a[1])) / area
                    u = 1.0 - v - w
                    if u < 0.0 or v < 0.0 or w < 0.0:
                        continue
                    if u * a[2] + v * b[2] + w * c[2] <= depth[y, x]:
                        continue
                    n = u * normals[f, 0] + v * normals[f, 1] + w * normals[f, 2]
                    length = np.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
                    facing = abs(n[2]) / length if length > 0.0 else 1.0
                    through[y, x] *= 1.0 - layer_opacity(facing)
    return through


PAPER: Final = np.array([1.0, 1.0, 1.0])
SHELL: Final = np.array([0.47, 0.53, 0.60])
LAMP: Final = np.array([-0.42, -0.55, 0.72])
"""Towards the light: from the upper left, in front. x to the right, y downwards."""
AMBIENT, DIFFUSE, GLOSS = 0.50, 0.56, 0.16
HAZE = 0.22
"""Share of paper mixed into what lies farthest away."""
_CREASE = 0.8


def shade(
    network: VesselNetwork,
    quantity: Quantity,
    surface: Surface | None,
    camera: Camera,
    finer: int,
) -> tuple[NDArray[np.uint8], FloatArray]:
    """Draw a scene.

    Parameters
    ----------
    network : VesselNetwork
    quantity : Quantity
        What the vessels are coloured by.
    surface : Surface or None
        Shown as a translucent shell.
    camera : Camera
        Its width and height are multiples of ``finer``.
    finer : int
        So many pixels a side are averaged into one.

    Returns
    -------
    image : (height / finer, width / finer, 3) uint8
        sRGB.
    depth : (height, width) float64
        Of the vessels' fronts towards the eye, pixels; -inf where there is none.
    """
    start, end, r0, r1, _ = network.pieces()
    scale = camera.pixels_per_mm
    a, b = camera.project(start), camera.project(end)
    depth, piece, place = draw_tubes(a, b, r0 * scale, r1 * scale, camera.height, camera.width)
    hit = piece >= 0
    normal = _normals(a, b, r0 * scale, r1 * scale, depth, piece, place)
    light = np.where(hit, _light(normal), 0.0)
    reach = max(0.035 * camera.height, 4.0 * float(np.median(network.radius)) * scale)
    light *= 0.25 + 0.75 * occlude(depth, normal, reach)
    image = np.broadcast_to(PAPER, (*depth.shape, 3)).copy()
    image[hit] = _lit(_colours(network, quantity, piece, place, hit), normal, light, hit)
    image[hit] += (HAZE * _remoteness(depth, hit))[:, None] * (PAPER - image[hit])
    if surface is not None:
        corners = corner_normals(surface) @ camera.turn.T
        seen = camera.project(surface.vertices)
        through = draw_shell(seen, corners, surface.faces.astype(np.int64), depth)[:, :, None]
        image = image * through + SHELL * (1.0 - through)
    return _averaged(image, finer), depth


def _normals(
    a: FloatArray, b: FloatArray, ra: FloatArray, rb: FloatArray,
    depth: FloatArray, piece: IntArray, place: FloatArray,
) -> FloatArray:  # fmt: skip
    """Unit normal of each pixel, (height, width, 3): away from the nearest sphere's centre."""
    normal = np.zeros((*depth.shape, 3))
    y, x = np.nonzero(piece >= 0)
    i, t = piece[y, x], place[y, x][:, None]
    centre = a[i] + t * (b[i] - a[i])
    radius = ra[i] + t[:, 0] * (rb[i] - ra[i])
    normal[y, x] = (np.column_stack([x, y, depth[y, x]]) - centre) / radius[:, None]
    return normal


def _light(normal: FloatArray) -> FloatArray:
    """Brightness by Lambert's law, with a light from all sides."""
    lamp = LAMP / np.linalg.norm(LAMP)
    return AMBIENT + DIFFUSE * np.maximum(normal @ lamp, 0.0)


def _lit(colour: FloatArray, normal: FloatArray, light: FloatArray, hit: Any) -> FloatArray:
    """Colours under the light, with a soft highlight (Blinn & Phong's half vector)."""
    half = LAMP / np.linalg.norm(LAMP) + [0.0, 0.0, 1.0]
    shine = np.maximum(normal[hit] @ (half / np.linalg.norm(half)), 0.0) ** 36
    lit = colour * light[hit][:, None] + (GLOSS * shine * light[hit])[:, None]
    return np.clip(lit, 0.0, 1.0)


def _colours(
    network: VesselNetwork, quantity: Quantity, piece: IntArray, place: FloatArray, hit: Any
) -> FloatArray:
    """Colour of each pixel that shows a vessel, (n, 3)."""
    first, last = quantity.piece_ends(network)
    i, t = piece[hit], place[hit]
    return quantity.rgb(first[i] + t * (last - first)[i])


def _remoteness(depth: FloatArray, hit: Any) -> FloatArray:
    """0 for the nearest pixel, 1 for the farthest."""
    seen = depth[hit]
    if len(seen) == 0:
        return seen
    return (seen.max() - seen) / max(float(np.ptp(seen)), 1e-9)


def corner_normals(surface: Surface) -> FloatArray:
    """Unit normal at each corner of each face, (m, 3, 3): smooth, but across creases.

    The sum over the faces around the vertex that are turned little from the corner's own, by area.
    """
    corners = surface.vertices[surface.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat = across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
    count = surface.faces.size
    at = csr_array(
        (np.ones(count), surface.faces.ravel(), np.arange(count + 1)),
        shape=(count, len(surface.vertices)),
    )
    # Corners that share a vertex; corner k is of face k // 3.
    pairs = (at @ at.T).tocoo()
    mine, other = pairs.coords[0] // 3, pairs.coords[1] // 3
    like = np.einsum("px,px->p", flat[mine], flat[other]) > _CREASE
    total: FloatArray = np.stack(
        [np.bincount(pairs.coords[0][like], across[other[like], x], count) for x in range(3)],
        axis=1,
    ).astype(np.float64)
    total /= np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-300)
    return total.reshape(-1, 3, 3)


def _averaged(image: FloatArray, finer: int) -> NDArray[np.uint8]:
    size = image.shape[1] // finer, image.shape[0] // finer
    return np.rint(255.0 * cv2.resize(image, size, interpolation=cv2.INTER_AREA)).astype(np.uint8)
