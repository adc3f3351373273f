"""Render the video of a dye front: light, absorption or fluorescence, camera disturbances.

Modelled: Beer-Lambert absorption in the three colours (or fluorescence in proportion to the dye),
a tilted camera and its perspective, uneven light, grain of the background, blur, light that
drifts, camera shake, shot and read noise, 8 bits. Not modelled: refraction at the lumens, gamma,
bubbles, dye that stains the gel, rolling shutter.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from kernels.arrays import FloatArray
from sim.devices.dye.camera import DyeCamera, light_paths
from sim.devices.dye.film_file import write_frames
from sim.devices.dye.transport import DyeFlow, Transport


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
