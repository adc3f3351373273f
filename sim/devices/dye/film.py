"""Render the video of a dye front: light, absorption or fluorescence, camera disturbances.

Modelled: Beer-Lambert absorption in the three colours (or fluorescence in proportion to the dye),
a tilted camera and its perspective, uneven light, grain of the background, blur, light that
drifts, camera shake, shot and read noise, 8 bits. Not modelled: refraction at the lumens, gamma,
bubbles, dye that stains the gel, rolling shutter.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_array, csr_array

from kernels.arrays import FloatArray
from sim.devices.dye.lumens import ANNULI, DyeFlow, Stretch, Transport
from sim.errors import SimError


@dataclass(frozen=True)
class Dye:
    """Dye and its optical properties.

    Attributes
    ----------
    absorbance_per_mm : (float, float, float)
        Naperian, of blue, green and red light. The default is a blue food dye.
    fluorescence_per_mm : float
        Grey levels per mm of dye, on a dark background; 0 for a dye that absorbs.
    """

    absorbance_per_mm: tuple[float, float, float] = (0.15, 0.5, 1.2)
    fluorescence_per_mm: float = 0.0


@dataclass(frozen=True)
class Disturbance:
    """Disturbances of a dye video.

    Attributes
    ----------
    noise : float
        Read noise, grey levels; shot noise comes on top.
    blur_px : float
        Standard deviation of the point spread.
    drift : float
        Relative change of the light over the film, a slow wave on it, and a third as much
        of a slope across the picture.
    shake_px : float
        Standard deviation of the picture's wandering.
    texture : float
        Relative grain of the background.
    """

    noise: float = 1.5
    blur_px: float = 1.0
    drift: float = 0.0
    shake_px: float = 0.0
    texture: float = 0.03


@dataclass(frozen=True)
class DyeCamera:
    """A camera: distant, or a pinhole at some distance, straight above or tilted.

    Attributes
    ----------
    width, height : int
        Pixels.
    px_per_mm : float
    centre_mm : (float, float, float)
        Part's point in the middle of the picture.
    turn_deg : float
        Clockwise turn of the picture.
    side : str
        The camera's side of the part: z, -z, x, -x, y or -y.
    mirrored : bool
        Filmed by way of a mirror.
    tilt_deg : float
        Of the line of sight from straight above: what is lower in the picture (before it is
        turned) comes nearer.
    distance_mm : float
        Pinhole to ``centre_mm``; without end by default, so that no perspective is seen.
    """

    width: int = 640
    height: int = 360
    px_per_mm: float = 36.0
    centre_mm: tuple[float, float, float] = (8.0, 4.0, 1.5)
    turn_deg: float = 0.0
    side: Literal["z", "-z", "x", "-x", "y", "-y"] = "z"
    mirrored: bool = False
    tilt_deg: float = 0.0
    distance_mm: float = np.inf

    def pixels(self, points: FloatArray) -> FloatArray:
        """Where points (n, 3), mm, are seen, (n, 2); (0, 0) is the first pixel's middle."""
        right, down, _ = self._axes()
        seen = points - np.array(self.centre_mm)
        flat = np.stack([seen @ right, seen @ down], axis=1) * self.scales(points)[:, None]
        angle = np.radians(self.turn_deg)
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        flat = flat @ turn.T
        if self.mirrored:
            flat[:, 0] *= -1.0
        placed: FloatArray = flat + [(self.width - 1) / 2.0, (self.height - 1) / 2.0]
        return placed

    def scales(self, points: FloatArray) -> FloatArray:
        """Size of things at points (n, 3), not foreshortened, (n,), px/mm."""
        farther = (points - np.array(self.centre_mm)) @ self._axes()[2]
        return np.asarray(self.px_per_mm / (1.0 + farther / self.distance_mm))

    def _axes(self) -> FloatArray:
        """Right, down and away from the camera, (3, 3)."""
        right, down = (np.array(axis) for axis in _AXES[self.side])
        away, tilt = np.cross(right, down), np.radians(self.tilt_deg)
        lower = np.cos(tilt) * down + np.sin(tilt) * away
        return np.array([right, lower, np.cross(right, lower)])


@dataclass(frozen=True)
class DyeFilm:
    """Settings of a simulated dye video.

    Attributes
    ----------
    fps : float, 1/s
    seconds : float, s
    start_s : float, s
        When dye enters the feed.
    """

    fps: float = 15.0
    seconds: float = 30.0
    start_s: float = 1.5
    camera: DyeCamera = field(default_factory=DyeCamera)
    dye: Dye = field(default_factory=Dye)
    spoilt: Disturbance = field(default_factory=Disturbance)

    def times(self) -> FloatArray:
        """Of the frames, (n,), s."""
        return np.arange(round(self.seconds * self.fps)) / self.fps


def film_frames(
    flow: DyeFlow, film: DyeFilm, generator: np.random.Generator
) -> Iterator[NDArray[np.uint8]]:
    """The film's frames, (height, width, 3), blue, green, red."""
    transport, times = Transport(flow, 1.0 / film.fps), film.times()
    paths = light_paths(film.camera, flow, transport)
    shape = (film.camera.height, film.camera.width)
    table = _light_table(film, generator)
    light, wander = _drift(film, times, generator), _shake(film, times, generator)
    for index, dye in enumerate(transport.frames(times, film.start_s)):
        depth = np.reshape(paths @ dye.ravel(), shape).astype(np.float32)
        clean = _lit(film, table, depth) * light[index][:, :, None]
        yield _taken(film, clean, wander[index], generator)


def _lit(film: DyeFilm, table: FloatArray, depth: NDArray[np.float32]) -> FloatArray:
    if film.dye.fluorescence_per_mm > 0.0:
        glow = (
            film.dye.fluorescence_per_mm
            * depth[:, :, None]
            * np.array([0.2, 1.0, 0.3], dtype=np.float32)
        )
        return np.asarray(0.06 * table + glow)
    absorbed = depth[:, :, None] * np.array(film.dye.absorbance_per_mm, dtype=np.float32)
    return np.asarray(table * np.exp(-absorbed))


def _light_table(film: DyeFilm, generator: np.random.Generator) -> FloatArray:
    """Background: brighter in the middle, grained, a few scratches; (height, width, 3)."""
    height, width = film.camera.height, film.camera.width
    v, u = np.meshgrid(np.linspace(-1, 1, height), np.linspace(-1, 1, width), indexing="ij")
    fine = ndimage.gaussian_filter(generator.standard_normal((height, width)), 1.5)
    coarse = ndimage.gaussian_filter(generator.standard_normal((height, width)), 8.0)
    grain = fine / fine.std() + coarse / coarse.std()
    level = 190.0 * (1.0 - 0.15 * (u**2 + v**2)) * (1.0 + film.spoilt.texture * grain)
    return np.asarray(level[:, :, None] * np.array([0.95, 1.0, 0.98]), dtype=np.float32)


def _drift(film: DyeFilm, times: FloatArray, generator: np.random.Generator) -> list[FloatArray]:
    phase, part = generator.uniform(0, 2 * np.pi), times / max(times[-1], 1e-9)
    wave = film.spoilt.drift * (part + 0.3 * np.sin(2 * np.pi * 2.5 * part + phase))
    across = np.linspace(-1.0, 1.0, film.camera.width)[None, :]
    return [(1.0 + w * (1.0 + across / 3.0)).astype(np.float32) for w in wave]


def _shake(film: DyeFilm, times: FloatArray, generator: np.random.Generator) -> FloatArray:
    if film.spoilt.shake_px == 0.0:
        return np.zeros((len(times), 2))
    raw = ndimage.gaussian_filter1d(generator.standard_normal((len(times), 2)), 2.0, axis=0)
    # The first frame stands where the camera says.
    return np.asarray(film.spoilt.shake_px * (raw - raw[0]) / raw.std())


def _taken(
    film: DyeFilm, clean: FloatArray, moved: FloatArray, generator: np.random.Generator
) -> NDArray[np.uint8]:
    blur = film.spoilt.blur_px
    if blur > 0.0:
        clean = ndimage.gaussian_filter(clean, (blur, blur, 0.0))
    if np.any(moved):
        clean = _moved(clean, moved)
    # A full well of some 10,000 electrons at 255.
    noise = np.sqrt(film.spoilt.noise**2 + np.maximum(clean, 0.0) / 40.0)
    noisy = clean + noise * generator.standard_normal(clean.shape, dtype=np.float32)
    return np.clip(np.round(noisy), 0, 255).astype(np.uint8)


def _moved(picture: FloatArray, by: FloatArray) -> FloatArray:
    """The picture moved right and down, its rim repeated."""
    matrix = np.array([[1.0, 0.0, by[0]], [0.0, 1.0, by[1]]])
    size = picture.shape[1::-1]
    return np.asarray(cv2.warpAffine(picture, matrix, size, borderMode=cv2.BORDER_REPLICATE))


def write_film(path: Path, flow: DyeFlow, film: DyeFilm, generator: np.random.Generator) -> None:
    """Write the film as .mp4, .mov or .avi.

    Raises
    ------
    SimError
        When the suffix isn't known, or the file can't be written.
    """
    size = (film.camera.width, film.camera.height)
    write_frames(path, film_frames(flow, film, generator), size, film.fps)


# Write video frames to a film file (MP4, MOV, AVI) by OpenCV.

CODES: Final = {".mp4": "mp4v", ".mov": "mp4v", ".avi": "MJPG"}
"""Codec of each suffix."""


def write_frames(
    path: Path, frames: Iterable[NDArray[np.uint8]], size: tuple[int, int], fps: float
) -> None:
    """Write frames (height, width, 3; blue, green, red) of ``size`` (width, height).

    A film that breaks off leaves no file.

    Raises
    ------
    SimError
        When the suffix isn't known, or the file can't be written.
    """
    if path.suffix.lower() not in CODES:
        raise SimError(f"{path}: a film is written as {', '.join(CODES)}")
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f".{path.stem}.part{path.suffix}")
    code = cv2.VideoWriter.fourcc(*CODES[path.suffix.lower()])
    writer = cv2.VideoWriter(str(draft), code, fps, size)
    try:
        if not writer.isOpened():
            raise SimError(f"{path}: OpenCV can't write this film; try .avi")
        for frame in frames:
            writer.write(frame)
        writer.release()
        draft.replace(path)
    finally:
        writer.release()
        draft.unlink(missing_ok=True)


# Simulated camera of a dye video: light paths from lumen cells to pixels.

_AXES: Final = {
    # To the right and downwards in the picture, seen from that side.
    "z": ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0)),
    "-z": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    "y": ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    "-y": ((1.0, 0.0, 0.0), (0.0, 0.0, -1.0)),
    "x": ((0.0, 1.0, 0.0), (0.0, 0.0, -1.0)),
    "-x": ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
}
_STEEPEST = 0.25


def light_paths(camera: DyeCamera, flow: DyeFlow, transport: Transport) -> csr_array:
    """Length of each pixel's ray within each cell's annuli, (pixels, cells · ANNULI), mm.

    A piece is a straight tube; its ends are cut off square, so that joints are neither rounded nor
    counted twice.
    """
    rows, columns, values = [], [], []
    for index, part in enumerate(flow.parts):
        cells = (int(transport.first[index]), int(transport.first[index + 1]))
        for pixel, cell, chords in _pieces(camera, part, cells):
            rows.append(np.repeat(pixel, ANNULI))
            columns.append((cell[:, None] * ANNULI + np.arange(ANNULI)).ravel())
            values.append(chords.ravel())
    shape = (camera.width * camera.height, len(transport.dye) * ANNULI)
    if not rows:
        return csr_array(shape)
    joined = (np.concatenate(rows), np.concatenate(columns))
    return coo_array((np.concatenate(values), joined), shape=shape).tocsr()


def _pieces(
    camera: DyeCamera, part: Stretch, cells: tuple[int, int]
) -> Iterator[tuple[FloatArray, FloatArray, FloatArray]]:
    seen, volumes, along = camera.pixels(part.points), part.volumes(), part.along()
    scales = camera.scales(part.points)
    for k in range(len(seen) - 1):
        start, way = seen[k], seen[k + 1] - seen[k]
        length = float(np.hypot(*way))
        real = float(along[k + 1] - along[k]) * float(scales[k : k + 2].mean())
        if length < 1e-6 or real < 1e-9:
            continue
        reach = float((part.radius * scales)[k : k + 2].max())
        pixel, points = _near(camera, start, start + way, reach)
        share = (points - start) @ way / length**2
        # Half way in space isn't half way in the picture: what is far is seen small.
        share = share * scales[k + 1] / (scales[k] + share * (scales[k + 1] - scales[k]))
        scale = 1.0 / ((1.0 - share) / scales[k] + share / scales[k + 1])
        aside = np.abs((points - start) @ np.array([-way[1], way[0]])) / length / scale
        radius = part.radius[k] + share * (part.radius[k + 1] - part.radius[k])
        hit = (share >= 0.0) & (share < 1.0) & (aside < radius)
        volume = volumes[k] + share[hit] * (volumes[k + 1] - volumes[k])
        cell = cells[0] + (volume / volumes[-1] * (cells[1] - cells[0])).astype(np.int64)
        chords = _chords(aside[hit], radius[hit]) / max(length / real, _STEEPEST)
        yield pixel[hit], np.minimum(cell, cells[1] - 1), chords


def _near(
    camera: DyeCamera, start: FloatArray, end: FloatArray, reach_px: float
) -> tuple[FloatArray, FloatArray]:
    """Pixels about a piece: their numbers and places."""
    size = np.array([camera.width, camera.height])
    margin = reach_px + 1.0
    low = np.clip(np.floor(np.minimum(start, end) - margin), 0, size).astype(int)
    high = np.clip(np.ceil(np.maximum(start, end) + margin) + 1, 0, size).astype(int)
    u, v = np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]))
    points = np.stack([u.ravel(), v.ravel()], axis=1).astype(np.float64)
    return (v * camera.width + u).ravel(), points


def _chords(aside: FloatArray, radius: FloatArray) -> FloatArray:
    """Length of a ray at a distance from the axis within each annulus, (n, ANNULI), mm."""
    edge = radius[:, None] * np.sqrt(np.arange(ANNULI + 1) / ANNULI)
    within = 2.0 * np.sqrt(np.maximum(edge**2 - aside[:, None] ** 2, 0.0))
    return np.diff(within, axis=1)
