"""Draw ArUco markers, picture files and the dish's rim into a simulated picture of the dish."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from sim.devices.camera.plan import Plan
from sim.devices.camera.scene import Dish, Marker, Scene
from sim.errors import CameraError

SingleArray = NDArray[np.float32]

_CELL: Final = 24
"""Pixels of a marker's cell before it is laid down."""
_RIM: Final = 1 / 7
"""White around a marker, of its side."""
_INK: Final = (28.0, 235.0)
_CORNERS: Final = np.array([[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]])


def add_marks(drawn: SingleArray, plan: Plan, scene: Scene, folder: Path) -> None:
    """Draw them into a plane of light, in place; files are relative to `folder`.

    Raises
    ------
    CameraError
        When a picture can't be read, or there is no such set of markers.
    """
    if scene.dish is not None:
        _add_dish(drawn, plan, scene.dish, scene.shades(scene.dish.table_colour))
    for marker in scene.markers:
        _lay(drawn, plan, *_marker(marker))
    for picture in scene.pictures:
        _lay(drawn, plan, _read(folder / picture.file), np.array(picture.corners_mm))


def _add_dish(drawn: SingleArray, plan: Plan, dish: Dish, table_colour: tuple[float, ...]) -> None:
    """Table outside of the dish's wall, the wall brighter where it is seen on edge."""
    centre = np.array([dish.centre_mm])
    at = plan.seen_at(centre)[0]
    scale = float(plan.scale(centre[:, 2])[0])
    rows, columns = plan.shape
    y, x = np.ogrid[0:rows, 0:columns]
    away = np.sqrt((x - at[0]) ** 2 + (y - at[1]) ** 2).astype(np.float32)
    inner, outer = dish.inner_mm / 2 * scale, (dish.inner_mm / 2 + dish.wall_mm) * scale
    outside = away > inner - 1
    away = away[outside]
    wall = np.clip(away - inner + 0.5, 0, 1) * np.clip(outer - away + 0.5, 0, 1)
    table = np.clip(away - outer + 0.5, 0, 1)
    rim = 1 - 0.45 * np.cos(2 * np.pi * np.clip((away - inner) / (outer - inner), 0, 1))
    there = drawn[outside] * (1 - wall * (1 - 0.85 * rim))[:, None]
    drawn[outside] = there + table[:, None] * (np.array(table_colour, np.float32) - there)


def _marker(marker: Marker) -> tuple[SingleArray, FloatArray]:
    """A marker with its rim, and where its corners lie, (4, 3), mm."""
    number: Any = getattr(cv2.aruco, f"DICT_{marker.dictionary.upper()}", None)
    if number is None:
        raise CameraError(
            f"there is no set of markers {marker.dictionary!r}; take one of OpenCV's, such as "
            "4X4_50, 5X5_100"
        )
    markers = cv2.aruco.getPredefinedDictionary(number)
    if marker.number >= len(markers.bytesList):
        raise CameraError(
            f"{marker.dictionary} has markers 0 to {len(markers.bytesList) - 1}; marker "
            f"{marker.number} isn't among them"
        )
    side = _CELL * (markers.markerSize + 2)
    rim = round(_RIM * side)
    black = cv2.aruco.generateImageMarker(markers, marker.number, side)
    texture = np.pad(black, rim, constant_values=255).astype(np.float32)
    half = marker.side_mm * (0.5 + rim / side)
    angle = np.radians(marker.turn_deg)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    flat = half * _CORNERS @ turn.T
    return texture, np.column_stack([flat, np.zeros(4)]) + np.array(marker.centre_mm)


def _read(path: Path) -> SingleArray:
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise CameraError(f"picture {path} can't be read; check the path, and that it is a PNG")
    return image.astype(np.float32)


def _lay(drawn: SingleArray, plan: Plan, texture: SingleArray, corners_mm: FloatArray) -> None:
    """Lay a grey picture on the plane, over what is there, its corners where they are seen."""
    rows, columns = texture.shape
    # Corners are the outer ones of the corner pixels.
    source = np.array([[0, 0], [columns, 0], [columns, rows], [0, rows]], np.float32) - 0.5
    goal = plan.seen_at(corners_mm)
    limit = np.array(plan.shape[::-1])
    low = np.clip(np.floor(goal.min(axis=0)).astype(int) - 2, 0, limit)
    high = np.clip(np.ceil(goal.max(axis=0)).astype(int) + 3, 0, limit)
    if (low >= high).any():
        return
    warp = cv2.getPerspectiveTransform(source, (goal - low).astype(np.float32))
    finer = np.linalg.norm(np.diff(goal, axis=0), axis=1).max() / max(rows, columns)
    if finer < 0.6:
        texture = cv2.GaussianBlur(texture, (0, 0), 0.35 / finer)
    size = (int(high[0] - low[0]), int(high[1] - low[1]))
    grey = cv2.warpPerspective(texture, warp, size, borderMode=cv2.BORDER_REPLICATE)
    cover = cv2.warpPerspective(np.ones_like(texture), warp, size)[..., None]
    black, white = _INK
    shown = (black + (white - black) * grey / 255)[..., None].astype(np.float32)
    box = drawn[low[1] : high[1], low[0] : high[0]]
    box += cover * (shown - box)
