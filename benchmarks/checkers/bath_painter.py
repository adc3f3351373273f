"""Paint a camera's pictures of filaments in a support bath, with clogs, by a pinhole of its own.

Filaments lie at several depths, seen from above or aslant: what absorbs darkens the bath behind it
by its chord, what scatters or glows adds light of its own; both are veiled by the bath above, and
blurred out of focus. Baths are gelatin grain, a slurry of round particles, streaks with clouds,
or clear with dust. Two pictures of one scene differ by the sensor's noise, the camera's tremor and
drifting glare; the one before also lacks what the needle stirred along its way.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

BATHS = ("grain", "slurry", "streaks", "clear")
Gap = tuple[int, float, float]
_MARGIN_MM = 2.0


@dataclass(frozen=True)
class Vessel:
    """A filament: points (k, 3) mm of its middle, closely spaced, and its diameter."""

    points: np.ndarray
    diameter: float

    @property
    def arc(self) -> np.ndarray:
        """Way before each point, (k,) mm."""
        step = np.linalg.norm(np.diff(self.points, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(step)])

    @property
    def length(self) -> float:
        """Of all of it, mm."""
        return float(self.arc[-1])


@dataclass(frozen=True)
class Scene:
    """Bath, ink, light and camera.

    ``contrast`` is the logarithm of ink over bath in the middle of the widest filament at the top.
    """

    bath: str
    contrast: float
    texture: float
    grain_px: float
    grey: float
    colour: np.ndarray
    tint: np.ndarray
    glows: bool
    veil: float
    blur: float
    defocus: float
    noise: float
    slope: tuple[float, float, float]
    glare: int
    bubbles: int
    stirred: float
    um_per_px: float
    tilt: float
    turn: float
    jpeg: int


@dataclass(frozen=True)
class Pinhole:
    """A camera: (3, 4) matrix from mm to pixels."""

    matrix: np.ndarray

    def to_pixels(self, points_mm: np.ndarray) -> np.ndarray:
        """Return pixels (n, 2) of places (n, 3)."""
        at = np.column_stack([points_mm, np.ones(len(points_mm))]) @ self.matrix.T
        return at[:, :2] / at[:, 2:]


def random_scene(bath: str, contrast: float, most_tilt: float, rng: np.random.Generator) -> Scene:
    """A scene of that bath and contrast; all else by chance."""
    grey = rng.random() < 0.4
    most = {"grain": 0.035, "slurry": 0.03, "streaks": 0.03, "clear": 0.004}[bath]
    tint = np.ones(3) if grey else rng.uniform(0.3, 1.7, 3)
    return Scene(
        bath=bath,
        contrast=contrast,
        texture=float(rng.uniform(0.3, 1.0)) * most,
        grain_px=float(rng.uniform(1.0, 4.0)),
        grey=float(rng.uniform(90, 170)),
        colour=np.ones(3) if grey else rng.uniform(0.85, 1.15, 3),
        tint=tint / np.abs(tint).mean(),
        glows=bool(rng.random() < 0.35),
        veil=float(rng.uniform(0.0, 0.4)),
        blur=float(rng.uniform(0.6, 1.5)),
        defocus=float(rng.uniform(0.0, 0.6)),
        noise=float(rng.uniform(0.6, 2.5)),
        slope=(*rng.uniform(-0.2, 0.2, 2), float(rng.uniform(0.0, 0.2))),
        glare=int(rng.integers(0, 3)),
        bubbles=int(rng.integers(0, 3)),
        stirred=float(rng.uniform(0.0, 0.6)),
        um_per_px=float(rng.uniform(22, 36)),
        tilt=float(rng.uniform(0, most_tilt)),
        turn=float(rng.uniform(-180, 180)),
        jpeg=int(rng.choice([0, 0, 92])),
    )


def random_vessels(kind: str, rng: np.random.Generator) -> list[Vessel]:
    """A ``lone`` vessel, a ``tree``, or ``rows`` that pass each other, tips of 0.25 to 0.5 mm."""
    wide = float(rng.uniform(0.25, 0.5))
    if kind == "lone":
        return [_curve((0, 0), float(rng.uniform(0, 6.28)), float(rng.uniform(5, 8)), wide, rng)]
    if kind == "rows":
        count = int(rng.integers(3, 6))
        return [
            _curve((0, 1.4 * k), 0.0, float(rng.uniform(5, 7)), wide * s, rng)
            for k, s in enumerate(rng.uniform(0.7, 1.0, count))
        ]
    trunk = _curve((0, 0), 0.0, 4.0, wide, rng)
    out, ends = [trunk], [(trunk, 0.0)]
    for shrink in (0.79, 0.63):
        grown = []
        for parent, angle in ends:
            for side in (-1, 1):
                at = parent.points[-1]
                turned = angle + side * float(rng.uniform(0.5, 0.9)) * (
                    1.0 if shrink > 0.7 else 0.7
                )
                child = _curve(
                    (at[0], at[1]), turned, 4.0 * shrink, wide * shrink, rng, float(at[2])
                )
                grown.append((child, turned))
        out, ends = [*out, *(one for one, _ in grown)], grown
    return out


def _curve(
    begin: tuple[float, float], angle: float, length: float, wide: float,
    rng: np.random.Generator, z: float | None = None,
) -> Vessel:  # fmt: skip
    """A curve that sways, and sinks or rises by up to a fifth of its way; z from -3 to 0."""
    s = np.linspace(0, length, max(8, round(length / 0.1)))
    sway = rng.uniform(0, 0.25) * np.sin(s / length * np.pi * rng.uniform(0.5, 2))
    deep = rng.uniform(-2.0, -0.5) if z is None else z
    height = np.clip(deep + s * rng.uniform(-0.2, 0.2), -3.0, 0.0)
    x = begin[0] + s * np.cos(angle) - sway * np.sin(angle)
    y = begin[1] + s * np.sin(angle) + sway * np.cos(angle)
    return Vessel(np.column_stack([x, y, height]), wide)


class Canvas:
    """One scene's camera, bath and light; each picture of it by `picture`."""

    def __init__(self, vessels: list[Vessel], scene: Scene, seed: int) -> None:
        self.vessels, self.scene, self.seed = vessels, scene, seed
        rng = np.random.default_rng([seed, 1])
        self.frame, self.shape = _camera(vessels, scene)
        self.texture = bath_texture(scene, self.shape, rng)
        self.stirred = bath_texture(scene, self.shape, rng)
        high, wide = self.shape
        self.bubbles = np.column_stack(
            [rng.uniform(0, wide, scene.bubbles), rng.uniform(0, high, scene.bubbles),
             rng.uniform(4, 14, scene.bubbles)]
        )  # fmt: skip
        self.glare = np.column_stack(
            [rng.uniform(0, wide, scene.glare), rng.uniform(0, high, scene.glare),
             rng.uniform(3, 12, scene.glare)]
        )  # fmt: skip

    def picture(self, number: int, gaps: list[Gap], written: set[int]) -> np.ndarray:
        """Picture ``number`` of the vessels ``written`` so far, less the ``gaps``."""
        scene, (high, wide) = self.scene, self.shape
        rng = np.random.default_rng([self.seed, 2, number])
        rough = self.texture
        wake = scene.stirred * self._wake(written)
        rough = (1 - wake) * rough + wake * self.stirred
        y, x = np.mgrid[0:high, 0:wide]
        u, v = (x / wide - 0.5) * 2, (y / high - 0.5) * 2
        light = 1 + scene.slope[0] * u + scene.slope[1] * v - scene.slope[2] * (u * u + v * v)
        plane = (scene.grey * light * (1 + rough))[..., None] * scene.colour
        plane = self._with_ink(plane, written, gaps)
        for bx, by, br in self.bubbles:
            d = np.hypot(x - bx, y - by) / br
            ring = np.exp(-(((d - 0.9) / 0.12) ** 2)) - 0.8 * np.exp(-(((d - 0.3) / 0.15) ** 2))
            plane = plane * (1 - 0.5 * ring[..., None])
        drift = rng.normal(0, 1.5, (len(self.glare), 2))
        for (gx, gy, gr), by in zip(self.glare, drift, strict=True):
            far = np.hypot(x - gx - by[0], y - gy - by[1]) / gr
            plane = plane + 400 * np.exp(-(far**2))[..., None]
        tremor = np.array([[1, 0, rng.normal(0, 0.3)], [0, 1, rng.normal(0, 0.3)]], np.float32)
        plane = cv2.GaussianBlur(plane, (0, 0), scene.blur) * rng.uniform(0.98, 1.02)
        plane = cv2.warpAffine(plane, tremor, (wide, high), borderMode=cv2.BORDER_REFLECT)
        spread = np.sqrt(scene.noise**2 + 0.015 * np.clip(plane, 0, 255))
        out = np.clip(np.rint(plane + rng.normal(size=plane.shape) * spread), 0, 255)
        picture = out.astype(np.uint8)
        if scene.jpeg:
            stored = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, scene.jpeg])[1]
            picture = cv2.imdecode(stored, cv2.IMREAD_COLOR)
        return picture

    def steps(self) -> list[float]:
        """Logarithm of ink over bath in the middle of each vessel, without blur."""
        most = max(one.diameter for one in self.vessels)
        return [self._strength(one, most, float(one.points[:, 2].mean())) for one in self.vessels]

    def _strength(self, vessel: Vessel, most: float, z: float) -> float:
        return self.scene.contrast * vessel.diameter / most * float(np.exp(self.scene.veil * z))

    def _with_ink(self, plane: np.ndarray, written: set[int], gaps: list[Gap]) -> np.ndarray:
        scene, most = self.scene, max(one.diameter for one in self.vessels)
        layers: dict[int, np.ndarray] = {}
        for number in sorted(written):
            vessel = self.vessels[number]
            away = [(a, b) for stroke, a, b in gaps if stroke == number]
            for begin, end in _pieces(vessel.length, away):
                part = _part(vessel, begin, end)
                z = float(part[:, 2].mean())
                depth = round(2 * scene.defocus * abs(z + 1.0))
                ink = self._chord(part, vessel.diameter)
                ink *= self._strength(vessel, most, 0.0) * np.exp(scene.veil * self._z)
                layers[depth] = layers.get(depth, 0.0) + ink
        for depth, ink in layers.items():
            soft = cv2.GaussianBlur(ink, (0, 0), 0.5 * depth) if depth else ink
            if scene.glows:
                lit = np.expm1(np.abs(scene.contrast)) / max(abs(scene.contrast), 1e-9)
                plane = plane + (scene.grey * lit * soft)[..., None] * scene.tint
            else:
                plane = plane * np.exp(-soft[..., None] * scene.tint)
        return plane

    def _chord(self, points: np.ndarray, diameter: float) -> np.ndarray:
        """Chord through a filament over its diameter at each pixel; sets the depth there."""
        chord = np.zeros(self.shape)
        self._z = np.zeros(self.shape)
        side = 0.5 * diameter
        place = self.frame.to_pixels(points)
        scale = np.linalg.norm(self.frame.to_pixels(points + (side, 0, 0)) - place, axis=1)
        up = np.linalg.norm(self.frame.to_pixels(points + (0, side, 0)) - place, axis=1)
        radius = np.maximum(scale, up)
        for k in range(len(points) - 1):
            p, q, r = place[k], place[k + 1], float(radius[k])
            low = np.maximum(np.floor(np.minimum(p, q) - r - 1), 0).astype(int)
            high = np.minimum(np.ceil(np.maximum(p, q) + r + 2), self.shape[::-1]).astype(int)
            if (low >= high).any():
                continue
            y, x = np.mgrid[low[1] : high[1], low[0] : high[0]]
            d = q - p
            t = np.clip(((x - p[0]) * d[0] + (y - p[1]) * d[1]) / max(d @ d, 1e-12), 0, 1)
            far = np.hypot(x - p[0] - t * d[0], y - p[1] - t * d[1]) / r
            own = np.sqrt(np.clip(1 - far**2, 0, None))
            box = np.s_[low[1] : high[1], low[0] : high[0]]
            deeper = own > chord[box]
            chord[box] = np.where(deeper, own, chord[box])
            self._z[box] = np.where(deeper, points[k, 2], self._z[box])
        return chord

    def _wake(self, written: set[int]) -> np.ndarray:
        """Where the needle has stirred the bath, 0 to 1: all ways, with ink or without."""
        out = np.zeros(self.shape, np.uint8)
        for vessel in (self.vessels[number] for number in written):
            place = np.rint(self.frame.to_pixels(vessel.points) * 16).astype(np.int32)
            wide = max(1, round(1.6e3 * vessel.diameter / self.scene.um_per_px))
            cv2.polylines(out, [place], False, 255, wide, cv2.LINE_AA, 4)
        return cv2.GaussianBlur(out.astype(np.float64) / 255, (0, 0), 3.0)


def bath_texture(scene: Scene, shape: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Relative brightness of a bath without light, noise and blur, standard deviation as told."""
    g = scene.grain_px
    if scene.bath == "grain":
        rough = sum(_soft(shape, g * s, rng) for s in (0.7, 1.5, 4.0))
    elif scene.bath == "slurry":
        rough = np.zeros(shape)
        count = int(shape[0] * shape[1] / (6.0 * g) ** 2 * 3)
        for x, y, r, s in zip(
            rng.uniform(0, shape[1], count), rng.uniform(0, shape[0], count),
            rng.gamma(4, g / 4, count) + 1, rng.normal(0.3, 1, count), strict=True,
        ):  # fmt: skip
            cv2.circle(rough, (int(x), int(y)), max(1, int(r)), float(s), -1, cv2.LINE_AA)
        rough = cv2.GaussianBlur(rough, (0, 0), 0.8)
    elif scene.bath == "streaks":
        wave = np.fft.rfft2(rng.normal(size=shape))
        fy, fx = np.fft.fftfreq(shape[0])[:, None], np.fft.rfftfreq(shape[1])[None]
        turn = rng.uniform(0, np.pi)
        along, across = fx * np.cos(turn) + fy * np.sin(turn), fy * np.cos(turn) - fx * np.sin(turn)
        size = np.sqrt((3 * along) ** 2 + across**2) + 2.0 / max(shape)
        rough = np.fft.irfft2(wave * size**-1.2, s=shape)
    else:
        rough = _soft(shape, 3 * g, rng)
        for _ in range(int(rng.integers(0, 6))):  # dust
            at = int(rng.integers(0, shape[1])), int(rng.integers(0, shape[0]))
            cv2.circle(
                rough, at, int(rng.integers(1, 4)), float(rng.normal(0, 30)), -1, cv2.LINE_AA
            )
    even = np.asarray(rough - np.median(rough))
    spread = float(even.std()) if scene.bath != "clear" else 1.0
    return np.asarray(scene.texture * even / max(spread, 1e-9))


def _soft(shape: tuple[int, int], sigma: float, rng: np.random.Generator) -> np.ndarray:
    rough = cv2.GaussianBlur(rng.normal(size=shape), (0, 0), sigma)
    return rough / max(float(rough.std()), 1e-9)


def _camera(vessels: list[Vessel], scene: Scene) -> tuple[Pinhole, tuple[int, int]]:
    """A pinhole 150 mm away that sees all vessels with a margin, and its picture's size."""
    points = np.concatenate([one.points for one in vessels])
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    a, c = np.deg2rad([scene.tilt, scene.turn])
    tilt = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    turn = np.array([[np.cos(c), -np.sin(c), 0], [np.sin(c), np.cos(c), 0], [0, 0, 1]])
    turned = np.diag([1.0, -1.0, -1.0]) @ tilt @ turn
    far = 150.0
    focal = far * 1e3 / scene.um_per_px
    place = np.column_stack([turned, np.array([0, 0, far]) - turned @ middle])
    view = Pinhole(np.diag([focal, focal, 1.0]) @ place)
    at = view.to_pixels(points)
    margin = _MARGIN_MM * 1e3 / scene.um_per_px
    low, high = at.min(axis=0) - margin, at.max(axis=0) + margin
    moved = np.array([[1, 0, -low[0]], [0, 1, -low[1]], [0, 0, 1]]) @ view.matrix
    size = np.ceil(high - low).astype(int)
    return Pinhole(moved), (int(size[1]), int(size[0]))


def _pieces(length: float, away: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """What is left of a way without some stretches."""
    left = [(0.0, length)]
    for a, b in away:
        left = [(p, q) for low, high in left for p, q in ((low, min(high, a)), (max(low, b), high))]
        left = [(p, q) for p, q in left if q - p > 0.02]
    return left


def _part(vessel: Vessel, begin: float, end: float) -> np.ndarray:
    """Points of a filament from and to, every 0.05 mm."""
    s = np.linspace(begin, end, max(2, round((end - begin) / 0.05)))
    return np.column_stack([np.interp(s, vessel.arc, vessel.points[:, c]) for c in range(3)])
