"""Render a network scene: shaded tubes in a translucent surface, as pixels and depth buffer."""

from __future__ import annotations

from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from design.geometry.surface import Surface
from design.network import VesselNetwork
from kernels.arrays import FloatArray, IntArray
from registration.report.picture.camera import Camera
from registration.report.picture.occlusion import occlude
from registration.report.picture.quantity import Quantity
from registration.report.picture.shell import draw_shell
from registration.report.picture.tubes import draw_tubes

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
