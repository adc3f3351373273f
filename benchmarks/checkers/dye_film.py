"""Synthetic dye video of straight tubes, by rays through a pinhole, without product code.

Dye is carried along streamlines: Poiseuille's profile, no diffusion, flows that mix wholly at
nodes, a step of dye at the inlet. What leaves a tube is the sum over its streamlines of what
entered, each as much later as it is slow: done in time, where the product has Laplace transforms.
Each pixel's ray is cut with every tube; along what lies inside, places know how long ago what is
there entered the tube. Light falls off by Beer and Lambert. The picture is blurred, shaken, lit
unevenly and changingly, and noisy. Tubes are cut off square, and count twice where they overlap.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

STEP_S = 0.01
_LINES = 400


@dataclass(frozen=True)
class Tubes:
    """A network of straight tubes, dye let in at one end; mm, µL/s.

    ``vessel`` (n, 2): ends of each; ``flow`` (n,) from first end to last, 0 in closed ones and in
    what they cut off; ``entered`` (m, k): concentration at each node at multiples of `STEP_S`.
    """

    node: FloatArray
    vessel: IntArray
    radius: FloatArray
    flow: FloatArray
    entered: FloatArray

    def length(self) -> FloatArray:
        """Of each tube, mm."""
        ends = self.node[self.vessel]
        return np.asarray(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1))

    def transit(self) -> FloatArray:
        """Volume over flow, s; without end in those at rest."""
        volume = np.pi * self.radius**2 * self.length()
        with np.errstate(divide="ignore"):
            return np.asarray(volume / np.abs(self.flow))

    def begin(self, vessel: int) -> int:
        """Node that flow enters a vessel by."""
        return int(self.vessel[vessel, 0 if self.flow[vessel] >= 0 else 1])

    def mean(self, vessel: int, share: float) -> FloatArray:
        """Mean concentration over the section at a share of the length from the first end, (k,)."""
        if self.flow[vessel] == 0.0:
            return np.zeros(self.entered.shape[1])
        along = share if self.flow[vessel] > 0 else 1.0 - share
        line = (np.arange(_LINES) + 0.5) / _LINES
        delay = along * self.transit()[vessel] / (2.0 * (1.0 - line))
        return _later(self.entered[self.begin(vessel)], delay, np.full(_LINES, 1.0 / _LINES))

    def arrival(self, vessel: int, share: float, seconds: float) -> float:
        """When half of the level at the film's end, its last tenth, is reached, s."""
        curve = self.mean(vessel, share)[: round(seconds / STEP_S)]
        half = 0.5 * float(np.median(curve[int(0.9 * len(curve)) :]))
        if half < 1e-3:
            return float("nan")
        k = int(np.argmax(curve >= half))
        return float(STEP_S * (k - 1 + (half - curve[k - 1]) / (curve[k] - curve[k - 1])))


def dyed(
    node: FloatArray,
    vessel: IntArray,
    radius: FloatArray,
    inflow_ul_s: float,
    start_s: float,
    seconds: float,
    closed: Collection[int] = (),
) -> Tubes:
    """Solve the flow without the closed vessels, and carry the dye."""
    flow, pressure = _flow(node, vessel, radius, inflow_ul_s, closed)
    count = round(seconds / STEP_S) + 1
    tubes = Tubes(node, vessel, radius, flow, np.zeros((len(node), count)))
    transit, into = tubes.transit(), np.zeros(len(node))
    entered = tubes.entered
    entered[_inlets(vessel)] = STEP_S * np.arange(count) >= start_s
    line = (np.arange(_LINES) + 0.5) / _LINES
    # By falling pressure of where a vessel begins: all that enters a node comes before what leaves.
    for k in sorted(np.flatnonzero(flow), key=lambda k: -pressure[tubes.begin(int(k))]):
        first = tubes.begin(int(k))
        last = int(vessel[k].sum()) - first
        share = 2.0 * (1.0 - line) / _LINES
        passed = _later(entered[first], transit[k] / (2.0 * (1.0 - line)), share)
        rate = abs(float(flow[k]))
        entered[last] = (into[last] * entered[last] + rate * passed) / (into[last] + rate)
        into[last] += rate
    return tubes


def _later(curve: FloatArray, delay: FloatArray, share: FloatArray) -> FloatArray:
    """Sum of a curve, delayed by each of some times, by shares; fractions of a step by a line."""
    made = np.zeros(len(curve) + 1)
    whole = np.minimum(delay / STEP_S, len(curve)).astype(np.int64)
    part = np.minimum(delay / STEP_S - whole, 1.0)
    np.add.at(made, np.minimum(whole, len(curve)), share * (1.0 - part))
    np.add.at(made, np.minimum(whole + 1, len(curve)), share * part)
    return np.convolve(curve, made[:-1])[: len(curve)]


def _inlets(vessel: IntArray) -> IntArray:
    return np.setdiff1d(vessel[:, 0], vessel[:, 1])


def _flow(
    node: FloatArray, vessel: IntArray, radius: FloatArray, inflow: float, closed: Collection[int]
) -> tuple[FloatArray, FloatArray]:
    """Flow of each vessel and pressure at each node, one inlet, all outlets at 0."""
    length = np.linalg.norm(node[vessel[:, 1]] - node[vessel[:, 0]], axis=1)
    conductance = radius**4 / length
    conductance[list(closed)] = 0.0
    matrix = np.zeros((len(node), len(node)))
    for (a, b), g in zip(vessel.tolist(), conductance.tolist(), strict=True):
        matrix[a, a] += g
        matrix[b, b] += g
        matrix[a, b] -= g
        matrix[b, a] -= g
    right = np.zeros(len(node))
    right[_inlets(vessel)] = inflow
    held = np.setdiff1d(vessel[:, 1], vessel[:, 0])
    free = np.setdiff1d(np.arange(len(node)), held)
    pressure = np.zeros(len(node))
    # Nodes that a closure cuts off have no pressure: least squares leaves them at one.
    pressure[free] = np.linalg.lstsq(matrix[np.ix_(free, free)], right[free], rcond=1e-13)[0]
    flow = conductance * (pressure[vessel[:, 0]] - pressure[vessel[:, 1]])
    flow[np.abs(flow) < 1e-6 * inflow] = 0.0
    return flow, pressure


_PLACES = 7
_BLUE_GREEN_RED_PER_MM = np.array([0.2, 0.6, 1.3])


@dataclass(frozen=True)
class Pinhole:
    """A camera above a part, tilted about an axis at ``about_deg`` from the part's x.

    ``centre`` (3,), mm, is in the picture's middle, ``px_per_mm`` there, ``distance_mm`` away.
    """

    width: int
    height: int
    px_per_mm: float
    centre: FloatArray
    distance_mm: float = 400.0
    tilt_deg: float = 0.0
    about_deg: float = 0.0

    def frame(self) -> FloatArray:
        """Right, down and away, (3, 3): z looked down on, y upwards, turned by the tilt."""
        straight = np.diag([1.0, -1.0, -1.0])
        about = np.deg2rad(self.about_deg)
        axis = np.array([np.cos(about), np.sin(about), 0.0])
        turn = cv2.Rodrigues(np.deg2rad(self.tilt_deg) * axis)[0]
        return np.asarray(straight @ turn.T)

    def pixels(self, points: FloatArray) -> FloatArray:
        """Where points (n, 3), mm, are seen, (n, 2); the first pixel's middle is (0, 0)."""
        right, down, away = (self.frame() @ (points - self.centre).T)[:]
        size = self.px_per_mm * self.distance_mm / (self.distance_mm + away)
        return np.stack(
            [size * right + (self.width - 1) / 2, size * down + (self.height - 1) / 2], axis=1
        )

    def rays(self) -> tuple[FloatArray, FloatArray]:
        """The pinhole, (3,), and each pixel's direction, (height · width, 3), of length 1."""
        v, u = np.mgrid[: self.height, : self.width].reshape(2, -1).astype(np.float64)
        aside = np.stack([u - (self.width - 1) / 2, v - (self.height - 1) / 2]) / self.px_per_mm
        way = np.vstack([aside, np.full(len(u), self.distance_mm)]).T @ self.frame()
        pinhole = self.centre - self.distance_mm * self.frame()[2]
        return pinhole, way / np.linalg.norm(way, axis=1)[:, None]


@dataclass(frozen=True)
class Spoilt:
    """Deviations of noise (grey levels), blur (px) and shake (px); relative change of the light."""

    noise: float = 1.5
    blur_px: float = 1.0
    shake_px: float = 0.7
    drift: float = 0.1


@dataclass(frozen=True)
class _Inside:
    """Places along rays within tubes: their pixel, node, delay and length."""

    pixel: NDArray[np.int64]
    node: NDArray[np.int64]
    delay: FloatArray
    length: FloatArray


def write_film(
    path: Path, tubes: Tubes, camera: Pinhole, fps: float, spoilt: Spoilt, seed: int
) -> None:
    """Write a film as long as the tubes' curves, .avi."""
    generator = np.random.default_rng(seed)
    inside = _inside(tubes, camera)
    seconds = STEP_S * (tubes.entered.shape[1] - 1)
    times = np.arange(round(seconds * fps)) / fps
    table = _table(camera, generator)
    size = (camera.width, camera.height)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), fps, size)
    if not writer.isOpened():
        raise RuntimeError(f"{path}: OpenCV can't write this film")
    moved = np.cumsum(generator.standard_normal((len(times), 2)), axis=0)
    moved = cv2.GaussianBlur(moved - np.linspace(0, 1, len(times))[:, None] * moved[-1], (1, 9), 2)
    moved = spoilt.shake_px * (moved - moved[0]) / moved.std()
    across = np.linspace(-1, 1, camera.width)[None, :, None]
    for k, time in enumerate(times):
        phase = 2 * np.pi * k / len(times)
        light = 1 + spoilt.drift * (0.5 * np.sin(2.3 * phase) + 0.3 * across * np.sin(phase))
        depth = _depth(inside, tubes, time, camera)
        clean = table * light * np.exp(-depth[:, :, None] * _BLUE_GREEN_RED_PER_MM)
        writer.write(_taken(clean, moved[k], spoilt, generator))
    writer.release()


def _inside(tubes: Tubes, camera: Pinhole) -> _Inside:
    pinhole, way = camera.rays()
    parts: list[list[Any]] = [[], [], [], []]
    length, transit = tubes.length(), tubes.transit()
    for k, (a, b) in enumerate(tubes.node[tubes.vessel]):
        if tubes.flow[k] == 0.0:
            continue
        start, end = (a, b) if tubes.flow[k] > 0 else (b, a)
        axis = (end - start) / length[k]
        off, turn = pinhole - start, way - np.outer(way @ axis, axis)
        off_axis = off - (off @ axis) * axis
        # |off_axis + t turn|² = r²
        square, half = (turn**2).sum(axis=1), turn @ off_axis
        root = half**2 - square * (off_axis @ off_axis - tubes.radius[k] ** 2)
        hit = np.flatnonzero(root > 0)
        span = np.sqrt(root[hit]) / square[hit]
        for place in (2 * np.arange(_PLACES) + 1) / _PLACES - 1:
            t = -half[hit] / square[hit] + place * span
            along = (off @ axis + t * (way[hit] @ axis)) / length[k]
            slow = np.linalg.norm(off_axis + t[:, None] * turn[hit], axis=1) / tubes.radius[k]
            here = (along > 0) & (along < 1)
            delay = along[here] * transit[k] / (2 * np.maximum(1 - slow[here] ** 2, 1e-6))
            parts[0].append(hit[here])
            parts[1].append(np.full(here.sum(), tubes.begin(k)))
            parts[2].append(delay)
            parts[3].append(2 * span[here] / _PLACES)
    return _Inside(*(np.concatenate(part) for part in parts))


def _depth(inside: _Inside, tubes: Tubes, time: float, camera: Pinhole) -> FloatArray:
    """Length of dye along each pixel's ray, (height, width), mm."""
    step = np.maximum((time - inside.delay) / STEP_S, 0.0)
    low = step.astype(np.int64)
    part = step - low
    before = tubes.entered[inside.node, low]
    after = tubes.entered[inside.node, np.minimum(low + 1, tubes.entered.shape[1] - 1)]
    dye = inside.length * ((1 - part) * before + part * after)
    found = np.bincount(inside.pixel, weights=dye, minlength=camera.width * camera.height)
    return np.asarray(found.reshape(camera.height, camera.width), dtype=np.float64)


def _table(camera: Pinhole, generator: np.random.Generator) -> FloatArray:
    """The light table, brighter in the middle, with grain, (height, width, 3)."""
    shape = (camera.height, camera.width)
    v, u = np.mgrid[-1 : 1 : shape[0] * 1j, -1 : 1 : shape[1] * 1j]
    parts = [cv2.GaussianBlur(generator.standard_normal(shape), (0, 0), wide) for wide in (1.5, 6)]
    grain = sum(part / part.std() for part in parts)
    level = 185 * (1 - 0.12 * (u**2 + v**2)) * (1 + 0.03 * grain)
    return np.asarray(level[:, :, None] * np.array([0.93, 1.0, 0.97]))


def _taken(
    clean: FloatArray, moved: FloatArray, spoilt: Spoilt, generator: np.random.Generator
) -> NDArray[np.uint8]:
    shift = np.array([[1, 0, moved[0]], [0, 1, moved[1]]])
    size = (clean.shape[1], clean.shape[0])
    seen = cv2.warpAffine(clean, shift, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    seen = cv2.GaussianBlur(seen, (0, 0), spoilt.blur_px)
    noise = np.sqrt(spoilt.noise**2 + np.maximum(seen, 0) / 50)
    noise *= generator.standard_normal(seen.shape)
    return np.asarray(np.clip(np.rint(seen + noise), 0, 255), dtype=np.uint8)
