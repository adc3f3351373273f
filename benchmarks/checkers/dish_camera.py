"""Pictures of a dish insert and a needle by a camera of known lens and pose.

Shares no code with the product. Modelled: pinhole with k1, k2, p1, p2; any pose; blur; light that
falls off and leans; glare; shot and read noise; JPEG; marks made off their places, larger or
smaller than drawn; ink lines in the dish; a needle as a lit cylinder. Not modelled: depth of field,
rolling shutter, colour.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from scipy.interpolate import RectBivariateSpline
from scipy.ndimage import gaussian_filter

FINE = 2
PER_MM = 40.0
GRID_PX = 16


@dataclass
class Optics:
    """A camera: pixels, focal length, axis, distortion; rotation world to camera; centre, mm."""

    size: tuple[int, int]
    focal: float
    axis: tuple[float, float]
    k: tuple[float, float]
    p: tuple[float, float]
    rotation: np.ndarray
    centre: np.ndarray

    def pixels(self, world: np.ndarray) -> np.ndarray:
        """Pixels (n, 2) of world points (n, 3)."""
        seen = (world - self.centre) @ self.rotation.T
        return self.distorted(seen[:, 0] / seen[:, 2], seen[:, 1] / seen[:, 2])

    def distorted(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Pixels of directions a, b (over the focal length)."""
        r2 = a**2 + b**2
        gain = 1 + self.k[0] * r2 + self.k[1] * r2**2
        ad = a * gain + 2 * self.p[0] * a * b + self.p[1] * (r2 + 2 * a**2)
        bd = b * gain + self.p[0] * (r2 + 2 * b**2) + 2 * self.p[1] * a * b
        return np.column_stack([self.focal * ad + self.axis[0], self.focal * bd + self.axis[1]])

    def directions(self, pixels: np.ndarray) -> np.ndarray:
        """World directions (n, 3) of pixels (n, 2), by a fixed point."""
        want = (pixels - np.array(self.axis)) / self.focal
        a, b = want[:, 0].copy(), want[:, 1].copy()
        for _ in range(25):
            r2 = a**2 + b**2
            gain = 1 + self.k[0] * r2 + self.k[1] * r2**2
            shift_a = 2 * self.p[0] * a * b + self.p[1] * (r2 + 2 * a**2)
            shift_b = self.p[0] * (r2 + 2 * b**2) + 2 * self.p[1] * a * b
            a, b = (want[:, 0] - shift_a) / gain, (want[:, 1] - shift_b) / gain
        return np.column_stack([a, b, np.ones_like(a)]) @ self.rotation


def aimed(target: np.ndarray, away: float, tilt: float, azimuth: float, roll: float) -> Any:
    """Rotation and centre of a camera that looks at a target from a distance, tilted; rad."""
    back = np.array([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)])
    ahead = -back
    side = np.cross(ahead, [np.cos(roll), np.sin(roll), 0.0])
    right = np.cross(side, ahead)
    right /= np.linalg.norm(right)
    down = np.cross(ahead, right)
    return np.stack([right, down, ahead]), target + away * back


@dataclass
class Made:
    """An insert as it came out, and where it lies in the printer.

    ``plan`` is the insert's YAML as a dict; ``off`` the marks' errors (n, 2) mm; scale; growth of
    black by ``bleed`` mm on each side; ``turn`` (3, 3) and ``origin`` (3,) of its upper face.
    """

    plan: dict[str, Any]
    off: np.ndarray
    scale: float
    bleed: float
    turn: np.ndarray
    origin: np.ndarray

    def world(self, flat: np.ndarray) -> np.ndarray:
        """Printer's frame (n, 3) of drawn places (n, 2) but for the marks' own errors."""
        return np.column_stack([self.scale * flat, np.zeros(len(flat))]) @ self.turn.T + self.origin


@dataclass
class Scene:
    """What else there is: light, blur px, noise, JPEG's quality, lines (a, b, width) in mm."""

    blur: float = 0.9
    read: float = 1.5
    full_well: float = 8000.0
    quality: int = 92
    white: float = 200.0
    black: float = 35.0
    lean: tuple[float, float] = (0.2, -0.1)
    vignette: float = 0.25
    glare: tuple[float, float, float, float] | None = None
    hidden: list[tuple[float, float, float]] = field(default_factory=list)
    lines: list[tuple[np.ndarray, np.ndarray, float]] = field(default_factory=list)
    gamma: float = 1.0


def _cover(low: float, high: float, count: int, start: float) -> tuple[int, np.ndarray]:
    """Share of each texture cell along an axis that an interval covers, from an index on."""
    a, b = (low - start) * PER_MM, (high - start) * PER_MM
    first, last = max(int(np.floor(a)), 0), min(int(np.ceil(b)), count)
    cell = np.arange(first, last)
    return first, np.clip(np.minimum(b, cell + 1) - np.maximum(a, cell), 0, 1)


def plate(made: Made, scene: Scene, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """Brightness of the insert's plane 0 to 255, (n, n), rows along y; its first place, mm."""
    plan = made.plan
    wide = max(plan["plate_mm"]) / 2 + 12
    count = int(2 * wide * PER_MM)
    middle = -wide + (np.arange(count) + 0.5) / PER_MM
    x, y = np.meshgrid(middle, middle)
    px, py = (side / 2 for side in plan["plate_mm"])
    tile = np.full((count, count), scene.white, np.float32)
    noise = gaussian_filter(rng.normal(size=(count // 8, count // 8)), 1.5)
    noise = cv2.resize(noise.astype(np.float32) * 60, (count, count), interpolation=cv2.INTER_CUBIC)
    outside = (np.abs(x) > px) | (np.abs(y) > py)
    tile[outside] = (60 + noise)[outside]
    hx, hy = (side / 2 for side in plan["hole_mm"])
    inside = (
        (x / hx) ** 2 + (y / hy) ** 2 < 1
        if plan["shape"] == "round"
        else (np.abs(x) < hx) & (np.abs(y) < hy)
    )
    tile[inside] = (130 + noise)[inside]
    for a, b, thick in scene.lines:
        _draw_line(tile, a, b, thick, -wide, 60.0)
    book = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    for number, mark in enumerate(plan["marks"]):
        bits = cv2.aruco.generateImageMarker(book, mark["number"], 6)
        side = plan["mark_mm"] / 6
        left = mark["x_mm"] - plan["mark_mm"] / 2 + made.off[number, 0]
        low = mark["y_mm"] - plan["mark_mm"] / 2 + made.off[number, 1]
        u0, _ = _cover(left - 1, left + plan["mark_mm"] + 1, count, -wide)
        v0, _ = _cover(low - 1, low + plan["mark_mm"] + 1, count, -wide)
        room = int((plan["mark_mm"] + 2) * PER_MM) + 2
        ink = np.zeros((room, room), np.float32)
        for row, column in zip(*np.nonzero(bits == 0), strict=True):
            x0, y0 = left + column * side, low + (5 - row) * side
            u, across = _cover(x0 - made.bleed, x0 + side + made.bleed, count, -wide)
            v, along = _cover(y0 - made.bleed, y0 + side + made.bleed, count, -wide)
            ink[v - v0 : v - v0 + len(along), u - u0 : u - u0 + len(across)] += np.outer(
                along, across
            )
        part = tile[v0 : v0 + room, u0 : u0 + room]
        part -= np.minimum(ink[: part.shape[0], : part.shape[1]], 1) * (part - scene.black)
    return tile, -wide


def _draw_line(
    tile: np.ndarray, a: np.ndarray, b: np.ndarray, thick: float, start: float, grey: float
) -> None:
    low = np.minimum(a, b) - thick - 0.2
    high = np.maximum(a, b) + thick + 0.2
    i0, j0 = np.maximum(((low - start) * PER_MM).astype(int), 0)
    i1, j1 = ((high - start) * PER_MM).astype(int)
    u, v = np.meshgrid(np.arange(i0, i1), np.arange(j0, j1))
    at = start + (np.stack([u, v], axis=-1) + 0.5) / PER_MM
    t = np.clip((at - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
    off = np.linalg.norm(at - a - t[..., None] * (b - a), axis=-1)
    share = np.clip((thick / 2 - off) * PER_MM + 0.5, 0, 1)
    part = tile[j0:j1, i0:i1]
    part += (share * (grey - part)).astype(np.float32)


def plane_map(optics: Optics, normal: np.ndarray, origin: np.ndarray, fine: int = FINE) -> Any:
    """Functions of (rows, columns) of fine pixels: world x, y, z on a plane, by splines."""
    wide, high = optics.size
    u = np.arange(-GRID_PX, wide + 2 * GRID_PX, GRID_PX, dtype=float)
    v = np.arange(-GRID_PX, high + 2 * GRID_PX, GRID_PX, dtype=float)
    uu, vv = np.meshgrid(u, v)
    way = optics.directions(np.column_stack([uu.ravel(), vv.ravel()]))
    reach = ((origin - optics.centre) @ normal) / (way @ normal)
    world = optics.centre + reach[:, None] * way
    columns = (np.arange(wide * fine) + 0.5) / fine - 0.5
    rows = (np.arange(high * fine) + 0.5) / fine - 0.5

    def at(values: np.ndarray) -> np.ndarray:
        return RectBivariateSpline(v, u, values.reshape(uu.shape))(rows, columns).astype(np.float32)

    return world, at


def photograph(optics: Optics, made: Made, scene: Scene, seed: int) -> np.ndarray:
    """Picture (h, w), 8 bits."""
    rng = np.random.default_rng(seed)
    tile, start = plate(made, scene, rng)
    world, at = plane_map(optics, made.turn[:, 2], made.origin)
    flat = (world - made.origin) @ made.turn[:, :2] / made.scale
    across = (at(flat[:, 0]) - start) * PER_MM - 0.5
    along = (at(flat[:, 1]) - start) * PER_MM - 0.5
    fine = np.empty(across.shape, np.float32)
    for begin in range(0, len(fine), 4096):
        fine[begin : begin + 4096] = cv2.remap(
            tile, across[begin : begin + 4096], along[begin : begin + 4096], cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )  # fmt: skip
    wide, high = optics.size
    return developed(fine.reshape(high, FINE, wide, FINE).mean(axis=(1, 3)), scene, rng)


def developed(light: np.ndarray, scene: Scene, rng: np.random.Generator) -> np.ndarray:
    """Blur, light, glare, hidden places, noise and JPEG."""
    high, wide = light.shape
    image = cv2.GaussianBlur(light.astype(np.float32), (0, 0), scene.blur)
    u, v = np.meshgrid(np.linspace(-1, 1, wide), np.linspace(-1, 1, high))
    image *= (1 + scene.lean[0] * u + scene.lean[1] * v) * (1 - scene.vignette * (u**2 + v**2) / 2)
    if scene.glare is not None:
        gu, gv, size, strong = scene.glare
        image += strong * np.exp(-((u - gu) ** 2 + (v - gv) ** 2) / (2 * size**2))
    for hu, hv, size in scene.hidden:
        image[(u - hu) ** 2 + (v - hv) ** 2 < size**2] = 90
    image = 255 * (np.clip(image, 0, None) / 255) ** scene.gamma
    electrons = np.clip(image, 0, None) / 255 * scene.full_well
    image = rng.normal(electrons, np.sqrt(electrons + 1)) * 255 / scene.full_well
    image += rng.normal(0, scene.read, image.shape)
    eight = np.clip(np.round(image), 0, 255).astype(np.uint8)
    if scene.quality < 100:
        packed = cv2.imencode(".jpg", eight, [cv2.IMWRITE_JPEG_QUALITY, scene.quality])[1]
        eight = cv2.imdecode(packed, cv2.IMREAD_GRAYSCALE)
    return eight


NEEDLE_FINE = 3


@dataclass
class Needle:
    """A needle: tip, outer diameter and length, mm; unit axis upwards; its end's slope along x."""

    tip: np.ndarray
    outer: float
    axis: np.ndarray
    slope: float = 0.0
    length: float = 12.7
    bright: float = 150.0
    dark: float = 40.0
    thread: float = 0.8
    light: float = 0.7


def with_needle(optics: Optics, ground: np.ndarray, needle: Needle) -> np.ndarray:
    """Ground (h, w) in brightness 0 to 255, needle and hub before it; no blur, no noise."""
    out = _with_rod(optics, ground, needle)
    foot = needle.tip + needle.length * needle.axis
    side = np.cross(needle.axis, optics.centre - needle.tip)
    side *= 2.0 / np.linalg.norm(side)
    ends = np.stack([foot - side, foot + side, foot + side + 12 * needle.axis,
                     foot - side + 12 * needle.axis])  # fmt: skip
    cv2.fillConvexPoly(out, np.round(optics.pixels(ends)).astype(np.int32), 170.0)
    return out


def _with_rod(optics: Optics, ground: np.ndarray, needle: Needle) -> np.ndarray:
    ends = optics.pixels(np.stack([needle.tip, needle.tip + needle.length * needle.axis]))
    room = 3 * needle.outer * optics.focal / np.linalg.norm(optics.centre - needle.tip)
    low = np.maximum(np.floor(ends.min(axis=0) - room), 0).astype(int)
    high = np.minimum(np.ceil(ends.max(axis=0) + room), np.array(optics.size)).astype(int)
    out = ground.astype(np.float32).copy()
    for top in range(low[1], high[1], 64):
        bottom = min(top + 64, high[1])
        u = low[0] + (np.arange((high[0] - low[0]) * NEEDLE_FINE) + 0.5) / NEEDLE_FINE - 0.5
        v = top + (np.arange((bottom - top) * NEEDLE_FINE) + 0.5) / NEEDLE_FINE - 0.5
        uu, vv = np.meshgrid(u, v)
        flat = np.column_stack([uu.ravel(), vv.ravel()])
        along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        near = np.abs((flat - ends[0]) @ np.array([-along[1], along[0]])) < room / 3 + 4
        hit, light = np.zeros(len(flat), np.float32), np.zeros(len(flat), np.float32)
        if near.any():
            hit[near], light[near] = _cast(optics, needle, flat[near])
        shape = (bottom - top, NEEDLE_FINE, high[0] - low[0], NEEDLE_FINE)
        share = hit.reshape(shape).mean(axis=(1, 3))
        value = (hit * light).reshape(shape).mean(axis=(1, 3))
        part = out[top:bottom, low[0] : high[0]]
        part *= 1 - share
        part += value
    return out


def _cast(optics: Optics, needle: Needle, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    way = optics.directions(pixels)
    way /= np.linalg.norm(way, axis=1)[:, None]
    start = optics.centre - needle.tip
    axis = needle.axis
    w = way - (way @ axis)[:, None] * axis
    s = start - (start @ axis) * axis
    a, b, c = (w**2).sum(axis=1), w @ s, s @ s - (needle.outer / 2) ** 2
    inside = b**2 - a * c
    reach = (-b - np.sqrt(np.maximum(inside, 0))) / a
    point = start + reach[:, None] * way
    height = point @ axis
    side = np.cross(axis, [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    hit = (inside > 0) & (height > needle.slope * (point @ side)) & (height < needle.length)
    normal = (point - height[:, None] * axis) / (needle.outer / 2)
    facing = -(normal * way).sum(axis=1)
    across = normal @ np.cross(axis, -start / np.linalg.norm(start))
    lit = needle.dark + (needle.bright - needle.dark) * np.clip(facing, 0, 1) * (
        1 + needle.light * across
    ) / (1 + abs(needle.light))
    lit += needle.thread * 255 * np.exp(-(((across - 0.25) / 0.08) ** 2))
    if start @ axis < 0:  # seen from below: the end's face
        reach = -(start @ axis) / (way @ axis)
        face = np.linalg.norm(start + reach[:, None] * way, axis=1) < needle.outer / 2
        lit = np.where(face & ~hit, needle.dark, lit)
        hit |= face
    return hit.astype(np.float32), np.clip(lit, 0, 255).astype(np.float32)


def rough_ground(
    size: tuple[int, int], rng: np.random.Generator, level: float, deep: float
) -> np.ndarray:
    """Ground of blotches at several scales, (h, w)."""
    wide, high = size
    out = np.full((high, wide), level, np.float32)
    for scale in (4, 12, 40, 160):
        small = rng.normal(size=(high // scale + 2, wide // scale + 2)).astype(np.float32)
        out += deep / 2 * cv2.resize(small, size, interpolation=cv2.INTER_CUBIC)
    return np.clip(out, 5, 250)
