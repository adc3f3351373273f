"""Paint a solid part before and after its last layer, by code that shares nothing with the product.

Layers are parallel touching lines, turned against those below; their ridges are parabolas. Three
inks: translucent (Beer and Lambert towards the ink's own colour, all layers added up), opaque
(shaded by a lamp and a sky) and matte (even light: its ridges don't show). The bath is grainy. In
between the camera moves by a part of a pixel, the light changes, bath and ink dry a little, and a
bubble may come, stay or go. Missing stretches are cut square.
"""

from dataclasses import dataclass

import cv2
import numpy as np

KINDS = ("translucent", "opaque", "matte")


@dataclass
class Layer:
    """Parallel lines; offsets ``at`` (n,) along the normal, each from -half to half."""

    angle: float
    at: np.ndarray
    half: float
    width: float

    @property
    def way(self) -> np.ndarray:
        """Direction of writing."""
        return np.array([np.cos(self.angle), np.sin(self.angle)])

    @property
    def aside(self) -> np.ndarray:
        """To its left."""
        return np.array([-np.sin(self.angle), np.cos(self.angle)])

    def ends(self) -> tuple[np.ndarray, np.ndarray]:
        """Starts and ends (n, 2), mm."""
        middle = self.at[:, None] * self.aside
        return middle - self.half * self.way, middle + self.half * self.way


@dataclass
class Stack:
    """Two pictures, and the truth."""

    before: np.ndarray
    picture: np.ndarray
    to_px: np.ndarray  # (2, 3)
    layer: Layer
    older: list[Layer]
    gaps: list[tuple[int, float, float]]  # line, from, to along it

    def to_pixels(self, points: np.ndarray) -> np.ndarray:
        """Pixels (n, 2) of places (n, 3), mm."""
        return np.asarray(np.asarray(points)[:, :2] @ self.to_px[:, :2].T + self.to_px[:, 2])


def stack(
    seed: int, kind: str, *, most_move_px: float = 1.5, change: bool = True, gaps: int = 0
) -> Stack:
    """Paint one; ``change`` for light, drying and bubbles."""
    rng = np.random.default_rng((seed, KINDS.index(kind)))
    size, width = rng.uniform(3.0, 4.5), rng.uniform(0.2, 0.4)
    pitch, turn, count = (
        width * rng.uniform(0.9, 1.0),
        rng.uniform(0, np.pi),
        int(rng.integers(1, 8)),
    )
    lines = max(4, int(size / pitch))
    crossing = rng.random() < 0.7
    layers = [
        Layer(
            turn + (k % 2) * np.pi / 2 * crossing,
            (np.arange(lines) - (lines - 1) / 2) * pitch,
            size / 2,
            width,
        )
        for k in range(count + 1)
    ]
    cut = []
    for line in rng.permutation(np.arange(1, lines - 1))[:gaps]:
        length = float(rng.choice([0.5, 0.7, 1.0, 1.5]))
        begin = float(rng.uniform(0.3, size - 0.3 - length))
        cut.append((int(line), begin, begin + length))
    um = rng.uniform(15, 28)
    cell = um * 1e-3 / 1.5
    reach = size / 2 + 1.5
    x, y = np.meshgrid(*[np.arange(-reach, reach, cell)] * 2)
    thick = width * rng.uniform(0.5, 0.8)
    crown = rng.uniform(0.1, 0.45)
    top = np.zeros_like(x)
    tops = []
    for k, layer in enumerate(layers):
        if k == count:
            tops.append(top.copy())
        own = _ridges(layer, x, y, thick, crown, cut if k == count else [])
        top = np.where(own > 0, k * thick + own, top)
    tops.append(top)
    world = _World(x, y, cell, size, kind, thick, rng)
    angle, far = rng.uniform(0, 2 * np.pi), rng.uniform(0, most_move_px)
    move = far * np.array([np.cos(angle), np.sin(angle)])
    spin = rng.uniform(-0.3, 0.3)
    px = 1e3 / um
    side = int(2 * (size / 2 + 1.2) * px)
    to_px = px * np.array([[np.cos(spin), -np.sin(spin), 0], [np.sin(spin), np.cos(spin), 0]])
    to_px[:, 2] = (side - 1) / 2
    pictures = []
    for after in (False, True):
        plane = world.lit(tops[after], change and after)
        own = to_px.copy()
        own[:, 2] += move * after
        pictures.append(world.photograph(plane, own, side, rng))
    return Stack(pictures[0], pictures[1], to_px, layers[-1], layers[:-1], cut)


def _ridges(
    layer: Layer,
    x: np.ndarray,
    y: np.ndarray,
    thick: float,
    crown: float,
    cut: list[tuple[int, float, float]],
) -> np.ndarray:
    """Height of a layer over its floor; 0 where there is no ink."""
    along = x * layer.way[0] + y * layer.way[1]
    across = x * layer.aside[0] + y * layer.aside[1]
    pitch = layer.at[1] - layer.at[0]
    line = np.clip(np.rint((across - layer.at[0]) / pitch), 0, len(layer.at) - 1).astype(int)
    off = (across - layer.at[line]) / (layer.width / 2)
    over = np.maximum(np.abs(along) - layer.half, 0.0) / (layer.width / 2)
    height = thick * (1 - crown * (off**2 + over**2))
    ink = off**2 + over**2 < 1
    for number, begin, end in cut:
        here = along + layer.half
        ink &= ~((line == number) & (here > begin) & (here < end))
    return np.where(ink, height, 0.0)


class _World:
    """Bath, ink, lamp and camera of one stack."""

    def __init__(
        self,
        x: np.ndarray,
        y: np.ndarray,
        cell: float,
        size: float,
        kind: str,
        thick: float,
        rng: np.random.Generator,
    ) -> None:
        self.u, self.v, self.cell, self.kind = 2 * x / size, 2 * y / size, cell, kind
        self.x, self.y, self.thick = x, y, thick
        bath = rng.uniform(100, 190) * rng.uniform(0.9, 1.1, 3)
        self.bath = bath * (1 + rng.uniform(0.01, 0.05) * _grains(x.shape, cell, rng))
        self.ink = bath * rng.permutation([rng.uniform(0.1, 0.4), rng.uniform(0.3, 0.8), 0.9])
        self.density = np.exp(rng.uniform(np.log(0.04), np.log(0.6))) / thick
        self.lamp, self.sky = rng.uniform(0, 2 * np.pi), rng.uniform(0.3, 0.8)
        self.uneven, self.blur = rng.uniform(0, 0.3), rng.uniform(0.5, 1.1)
        self.noise, self.colour = rng.uniform(0.6, 2.5), rng.random() < 0.6
        self.gain = float(np.exp(rng.normal(0, 0.07)))
        self.slope = rng.normal(0, 0.02, 2)
        self.drying = rng.uniform(0, 0.015)
        self.bubble = str(rng.choice(["none", "none", "comes", "goes", "stays"]))
        self.spot, self.radius = rng.uniform(-0.35, 0.35, 2) * size, rng.uniform(0.15, 0.4)

    def lit(self, top: np.ndarray, after: bool) -> np.ndarray:
        """Light from the dish; changed where ``after``."""
        bath = self.bath * (1 + self.drying * after)
        if self.kind == "translucent":
            through = np.exp(-self.density * (1 + self.drying * after) * top)[..., None]
            plane = self.ink + (bath - self.ink) * through
        else:
            shade = np.ones_like(top)
            if self.kind == "opaque":
                soft = cv2.GaussianBlur(top, (0, 0), 0.02 / self.cell)
                slope_y, slope_x = np.gradient(soft, self.cell)
                facing = 1 - slope_x * np.cos(self.lamp) - slope_y * np.sin(self.lamp)
                lamp = np.maximum(0, facing) / np.sqrt(1 + slope_x**2 + slope_y**2)
                shade = self.sky + (1 - self.sky) * lamp
            plane = np.where(top[..., None] > 0, self.ink * shade[..., None], bath)
        if self.bubble == "stays" or self.bubble == ("comes" if after else "goes"):
            plane = self._with_bubble(plane)
        fall = 1 + self.uneven * (0.3 * self.u - 0.2 * self.v - 0.15 * (self.u**2 + self.v**2))
        if after:
            fall = fall * self.gain * (1 + self.slope[0] * self.u + self.slope[1] * self.v)
        return np.asarray(plane * fall[..., None])

    def _with_bubble(self, plane: np.ndarray) -> np.ndarray:
        far = np.hypot(self.x - self.spot[0], self.y - self.spot[1]) / self.radius
        soft = cv2.GaussianBlur(plane, (0, 0), 0.3 * self.radius / self.cell)
        inner = np.where((far < 0.9)[..., None], 0.6 * soft + 0.4 * self.bath, plane)
        ring = 1 - 0.55 * np.exp(-(((far - 0.92) / 0.09) ** 2))
        return np.asarray(inner * ring[..., None])

    def photograph(
        self, plane: np.ndarray, to_px: np.ndarray, side: int, rng: np.random.Generator
    ) -> np.ndarray:
        """Picture of ``side`` px."""
        turn = np.linalg.inv(to_px[:, :2])
        col, row = np.meshgrid(np.arange(side) - to_px[0, 2], np.arange(side) - to_px[1, 2])
        at_x, at_y = (turn[k, 0] * col + turn[k, 1] * row for k in range(2))
        first = self.x[0, 0]
        seen = cv2.remap(
            cv2.GaussianBlur(plane.astype(np.float32), (0, 0), 0.6),
            ((at_x - first) / self.cell).astype(np.float32),
            ((at_y - first) / self.cell).astype(np.float32),
            cv2.INTER_LINEAR, None, cv2.BORDER_REFLECT_101,
        )  # fmt: skip
        seen = cv2.GaussianBlur(seen, (0, 0), self.blur)
        seen = seen + rng.normal(0, 1, seen.shape) * np.sqrt(self.noise**2 + 0.015 * seen)
        picture = np.clip(np.rint(seen), 0, 255).astype(np.uint8)
        return picture if self.colour else np.ascontiguousarray(picture[..., 1])


def _grains(shape: tuple[int, int], cell: float, rng: np.random.Generator) -> np.ndarray:
    total = np.zeros(shape)
    for size in (0.03, 0.08, 0.2):
        one = cv2.GaussianBlur(rng.normal(0, 1, shape), (0, 0), size / cell)
        total += one / one.std() / np.sqrt(3)
    return total[..., None]
