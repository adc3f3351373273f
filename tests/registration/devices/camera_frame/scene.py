"""A small camera over a small insert, painted once, and the frame that is fitted to it."""

from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from functools import cache
from typing import Any

import numpy as np

from benchmarks.checkers.dish_camera import Made, Optics, Scene, aimed, photograph
from firmware_profiles import Dish, load
from registration.devices.camera_frame import (
    CameraFrame,
    Insert,
    SeenMarks,
    Ties,
    Touch,
    design_insert,
    find_marks,
    fit_frame,
)
from registration.devices.lens import Lens

MADE_AT = datetime(2026, 11, 25, 15, 0, tzinfo=UTC)
TARGET = np.array([100.0, 90.0, 4.0])
SCENE = Scene(blur=0.8, quality=92)


@cache
def insert() -> Insert:
    return design_insert(load(Dish, "petri_35mm"), process="engraved", mark_mm=7.0)


@cache
def optics() -> Optics:
    rotation, centre = aimed(TARGET, 150.0, np.radians(28), 0.8, 2.0)
    return Optics((1000, 800), 2000.0, (505.0, 396.0), (-0.2, 0.05), (1e-3, -8e-4),
                  rotation, centre)  # fmt: skip


@cache
def made() -> Made:
    rng = np.random.default_rng(3)
    off = rng.normal(0, 0.01, (len(insert().marks), 2))
    return Made(insert().model_dump(mode="json"), off, 1.0002, 0.02, np.eye(3), TARGET)


@cache
def picture() -> np.ndarray:
    return photograph(optics(), made(), SCENE, 1)


def shifted(x_mm: float, y_mm: float, scene: Scene = SCENE, seed: int = 2) -> np.ndarray:
    """Another picture, the camera bumped."""
    moved = replace(optics(), centre=optics().centre + np.array([x_mm, y_mm, 0.0]))
    return photograph(moved, made(), scene, seed)


@cache
def lens() -> Lens:
    camera = optics()
    sure = np.diag(np.array([0.8, 1, 1, 1e-3, 5e-3, 2e-5, 2e-5, 1e-3]) ** 2)
    return Lens(
        size_px=camera.size, focal_px=camera.focal, centre_px=camera.axis,
        distortion=(*camera.k, *camera.p, 0.0), um_per_px=75.0, um_per_px_95=(74.0, 76.0),
        off_px=0.05, covariance=tuple(tuple(map(float, row)) for row in sure),
    )  # fmt: skip


@cache
def marks() -> SeenMarks:
    return find_marks(picture(), insert(), lens(), "seen.png")


def fitted(touches: Sequence[Touch] = (), **ties: Any) -> CameraFrame:
    """The frame by the insert's marks and touches, or other ties."""
    return fit_frame(marks(), insert(), lens(), Ties(touches=touches, **ties), MADE_AT)


def touched(off_mm: np.ndarray) -> list[Touch]:
    """Touches of all crosses, off by so much, (n, 3) mm."""
    crosses = insert().crosses
    there = made().world(np.array([[c.x_mm, c.y_mm] for c in crosses])) + off_mm
    pairs = zip(crosses, there.tolist(), strict=True)
    return [Touch(cross.name, *place, u_mm=0.01) for cross, place in pairs]


@cache
def frame() -> CameraFrame:
    off = np.random.default_rng(4).normal(0, 0.01, (len(insert().crosses), 3))
    return fitted(touched(off))
