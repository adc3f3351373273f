"""A painted laser over the small dish of the camera's tests: a flat floor, and blocks on it."""

from functools import cache
from pathlib import Path

import cv2
import numpy as np

from registration.devices.laser_sweep import FittedSweep, fit_laser, trace
from tests.registration.devices.camera_frame import scene
from tests.registration.devices.laser_sweep.laser_painter import (
    Heights,
    Swept,
    laser_over,
    looked_at,
)

FLOOR_Z = 1.0
BLOCKS = ((1.0, 3.0, 0.5), (3.8, 6.2, 0.9))
"""From x to x, mm from the corner of the field, and how high; all from y 1 to 6."""
LOW = scene.TARGET[:2] - 3.5
HIGH = LOW + 7.0


@cache
def laser(kind: str) -> Swept:
    return laser_over(scene.TARGET, 0.8 + np.pi, np.radians(15), 200.0, kind == "turns", askew=1.0)


def blocks() -> Heights:
    field = np.zeros((350, 350))
    for left, right, high in BLOCKS:
        field[50:300, round(left * 50) : round(right * 50)] = high
    return Heights(field, LOW, 0.02)


def _pictures(kind: str, amounts: np.ndarray, ink: Heights | None, seed: int) -> list[np.ndarray]:
    own = laser(kind)
    look = looked_at(scene.optics(), scene.made(), scene.SCENE, own, FLOOR_Z, ink, seed)
    amounts = np.random.default_rng(seed).permutation(amounts)
    turned = -np.arctan(amounts / 200) if kind == "turns" else amounts
    return [look.picture(own.sheet(one), seed + k) for k, one in enumerate(turned)]


@cache
def _flat(kind: str) -> list[np.ndarray]:
    return _pictures(kind, np.linspace(-15, 15, 24), None, 100)


@cache
def _over_blocks(kind: str) -> list[np.ndarray]:
    return _pictures(kind, np.linspace(-5.5, 5.5, 90), blocks(), 300)


def flat(kind: str = "turns") -> list[np.ndarray]:
    return _flat(kind)  # a cache takes f() and f("turns") for two


def over_blocks(kind: str = "turns") -> list[np.ndarray]:
    return _over_blocks(kind)


def written(pictures: list[np.ndarray], folder: Path) -> Path:
    folder.mkdir()
    for number, one in enumerate(pictures):
        cv2.imwrite(str(folder / f"{number:03d}.tif"), one, [cv2.IMWRITE_TIFF_COMPRESSION, 1])
    return folder


def fitted(folder: Path, kind: str = "turns") -> FittedSweep:
    path = written(flat(kind), folder)
    return fit_laser(trace(path, scene.frame()), scene.frame(), FLOOR_Z, scene.MADE_AT)
