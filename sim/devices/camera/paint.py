"""Render a simulated camera's picture of the dish from laid ink, camera and scene.

Modelled
--------
- Camera: pinhole, lens distortion, tilt, turn, any place; refraction at the bath's flat surface.
- Ink: each line as wide as its dose makes it, thick in its middle, translucent, with a colour of
  its own; rims darker or brighter; ridges lit from one side; what was laid before below it, fading
  with the bath's turbidity; ink that is missing by faults (`sim.gcode.deposit.lay`).
- Bath: granules of several sizes, which lie still from look to look; light of its own over deep
  ink.
- Uneven light, glints of a wavy wet surface, bubbles, fibres, specks, markers, boards, the dish's
  rim, the needle in the view.
- Sensor: blur of focus and motion, vignetting, shot and read noise, gamma, JPEG.

Not modelled
------------
Shadows, ink that a needle drags, crevices it leaves in the bath, focus that changes with depth,
scattering from line to line, colour of the bath that changes as it dries, rolling shutter, the
sensor's colour mosaic, saturation that blooms. Deep ink hides no other deep ink: their thicknesses
add up. Refraction moves places, and its scale is that straight below the camera.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from kernels.arrays import FloatArray
from sim.devices.camera.ink_map import ink_map
from sim.devices.camera.lighting import exposed, glints, lit
from sim.devices.camera.optics import Camera
from sim.devices.camera.plan import Plan
from sim.devices.camera.scene import Clutter, Dish, Light, Marker, NeedleLook, Scene
from sim.devices.recorded_ink import InkSource
from sim.errors import CameraError
from sim.gcode.deposit.lay import Laid
from sim.user_files import read_model


def paint(
    ink: Laid,
    camera: Camera,
    scene: Scene,
    seed: int,
    *,
    tip_mm: FloatArray | None = None,
    folder: Path = Path(),
) -> NDArray[np.uint8]:
    """Return a picture: (h, w, 3) in blue, green, red, or (h, w) of a sensor without colours.

    Same ink, camera, scene and seed, same bytes.

    Parameters
    ----------
    ink : Laid
    camera : Camera
    scene : Scene
        Its own seed is of what lies in the dish.
    seed : int
        Of the sensor's noise: another one for another look.
    tip_mm : (3,) float64 or None, mm
        Of the needle, where the scene has one that doesn't say.
    folder : Path
        Of the scene's picture files.

    Raises
    ------
    CameraError
        When the camera sees past the dish, or a picture file can't be read.
    """
    index = 1.0 if scene.bath.surface_z_mm is None else scene.bath.refractive_index
    plan = Plan.under(camera, _plane_z(ink, camera, scene), index)
    drawn_ink = ink_map(ink, plan, scene.ink, scene.bath)
    drawn = lit(drawn_ink, plan, scene, _ground(ink, plan, scene))
    add_clutter(drawn, plan, scene.clutter, scene.light, scene.seed)
    add_marks(drawn, plan, scene, folder)
    glare = glints(drawn_ink, plan, scene.light, scene.seed)
    if glare is not None:
        drawn += glare[..., None]
    taken = plan.photograph(drawn)
    if scene.needle is not None:
        tip = tip_mm if scene.needle.tip_mm is None else np.array(scene.needle.tip_mm)
        if tip is not None:
            add_needle(taken, camera, scene.needle, tip, scene.light)
    return exposed(taken, scene.sensor, np.random.default_rng((seed, 11)))


def _ground(ink: Laid, plan: Plan, scene: Scene) -> Plan:
    """Where granules lie: without a surface below the ink, so that they don't rise with it."""
    if scene.bath.surface_z_mm is not None or not len(ink.strands):
        return plan
    tip = np.minimum(ink.strands.start[:, 2], ink.strands.end[:, 2])
    return plan.below(float((tip - ink.height_mm).min()))


def _plane_z(ink: Laid, camera: Camera, scene: Scene) -> float:
    """Height of the plane that is drawn, mm."""
    if scene.bath.surface_z_mm is not None:
        return scene.bath.surface_z_mm
    if not len(ink.strands):
        return camera.target_mm[2]
    return float(max(ink.strands.start[:, 2].max(), ink.strands.end[:, 2].max()))


# Draw bubbles, fibres and specks into a simulated picture, fixed in the dish by a seed.

SingleArray = NDArray[np.float32]
_TILE_MM: Final = 10.0
"""Clutter is drawn by squares of the printer's plane: a camera that is moved sees the same."""
_SHIFT: Final = 4
_FIBRE_KNOTS: Final = 12


def add_clutter(drawn: SingleArray, plan: Plan, clutter: Clutter, light: Light, seed: int) -> None:
    """Draw all of it into a plane of light, in place."""
    for at, generator in _places(plan, clutter.debris_per_cm2, (seed, 1)):
        _speck(drawn, plan, at, clutter.debris_mm, generator)
    for at, generator in _places(plan, clutter.bubbles_per_cm2, (seed, 2)):
        _bubble(drawn, plan, at, clutter.bubble_mm, light, generator)


def _places(
    plan: Plan, per_cm2: float, seed: tuple[int, int]
) -> Iterator[tuple[FloatArray, np.random.Generator]]:
    """Pixels of things strewn at random, each with a generator of its own."""
    if per_cm2 == 0:
        return
    size = np.array(plan.shape[::-1]) * plan.pitch_mm
    first = np.floor(plan.origin_mm / _TILE_MM).astype(int)
    last = np.floor((plan.origin_mm + size) / _TILE_MM).astype(int)
    for j in range(first[1], last[1] + 1):
        for i in range(first[0], last[0] + 1):
            generator = np.random.default_rng((*seed, i % 2**16, j % 2**16))
            for _ in range(generator.poisson(per_cm2 * _TILE_MM**2 / 100)):
                at = (np.array([i, j]) + generator.random(2)) * _TILE_MM
                yield (at - plan.origin_mm) / plan.pitch_mm, generator


def _bubble(
    drawn: SingleArray,
    plan: Plan,
    at: FloatArray,
    size_mm: float,
    light: Light,
    generator: np.random.Generator,
) -> None:
    """Dark rim by total reflection, a clear middle, the lamp's image on the side of the light."""
    radius = size_mm / plan.pitch_mm / 2 * generator.lognormal(0.0, 0.35)
    patch, away, off = _around(drawn, at, 1.3 * radius + 2)
    if patch is None:
        return
    q = away / radius
    inside = np.clip(radius - away + 0.5, 0, 1)
    rim = np.exp(-(((q - 0.88) / 0.12) ** 2))
    azimuth = np.radians(light.azimuth_deg)
    lamp = off / radius - 0.55 * np.array([np.cos(azimuth), np.sin(azimuth)])
    glint = np.exp(-(lamp**2).sum(axis=-1) / (2 * 0.12**2))
    glow = np.exp(
        -((off / radius + 0.5 * np.array([np.cos(azimuth), np.sin(azimuth)])) ** 2).sum(-1) / 0.18
    )
    factor = 1 - inside * (0.65 * rim - 0.12 * (1 - rim) - 0.1 * glow)
    patch *= factor[..., None].astype(np.float32)
    patch += (200 * glint * inside)[..., None].astype(np.float32)


def _speck(
    drawn: SingleArray, plan: Plan, at: FloatArray, size_mm: float, generator: np.random.Generator
) -> None:
    """A dark or light grain, or a fibre that bends at random."""
    long = size_mm / plan.pitch_mm * generator.lognormal(0.0, 0.4)
    dark = 0.35 + 0.4 * generator.random()
    if generator.random() < 0.5:
        patch, away, _ = _around(drawn, at, 0.2 * long + 2)
        if patch is not None:
            cover = np.clip(0.15 * long - away + 0.5, 0, 1)
            patch *= (1 - (1 - dark) * cover)[..., None].astype(np.float32)
        return
    turn = generator.uniform(0, 2 * np.pi) + np.cumsum(
        0.35 * generator.standard_normal(_FIBRE_KNOTS)
    )
    way = np.cumsum(np.column_stack([np.cos(turn), np.sin(turn)]) * long / _FIBRE_KNOTS, axis=0)
    path = at + way - way.mean(axis=0)
    low = np.floor(path.min(axis=0)).astype(int) - 3
    size = np.ceil(path.max(axis=0)).astype(int) + 4 - low
    mask = np.zeros((size[1], size[0]), np.uint8)
    knots = np.round((path - low) * 2**_SHIFT).astype(np.int32)
    thick = max(1, round(0.012 / plan.pitch_mm))
    cv2.polylines(mask, [knots], False, 255, thick, cv2.LINE_AA, _SHIFT)
    rows, columns = drawn.shape[:2]
    (x0, y0), (x1, y1) = np.clip([low, low + size], 0, [columns, rows])
    cover = mask[y0 - low[1] : y1 - low[1], x0 - low[0] : x1 - low[0]].astype(np.float32) / 255
    drawn[y0:y1, x0:x1] *= (1 - np.float32(1 - dark) * cover)[..., None]


def _around(
    drawn: SingleArray, at: FloatArray, reach: float
) -> tuple[SingleArray | None, FloatArray, FloatArray]:
    """The part of a plane about a place, and each pixel's distance and way from there."""
    rows, columns = drawn.shape[:2]
    x0, y0 = np.clip(np.floor(at - reach).astype(int), 0, [columns, rows])
    x1, y1 = np.clip(np.ceil(at + reach).astype(int) + 1, 0, [columns, rows])
    if x0 >= x1 or y0 >= y1:
        return None, np.zeros(0), np.zeros(0)
    y, x = np.mgrid[y0:y1, x0:x1]
    off = np.stack([x - at[0], y - at[1]], axis=-1)
    return drawn[y0:y1, x0:x1], np.hypot(off[..., 0], off[..., 1]), off


# Draw ArUco markers, picture files and the dish's rim into a simulated picture of the dish.

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


# Draw the needle, from its tip up towards the camera, into a simulated picture.

_NEAREST: Final = 0.02
"""Of the way from the pinhole to the tip: what is nearer is out of the picture."""
_KNOTS: Final = 60
_FINE: Final = 4
"""Dots of the drawing along a pixel."""
_STRIPES: Final = ((1.0, 0.45), (0.85, 0.8), (0.55, 1.0), (0.18, 1.7))
"""Share of the needle's width, and brightness over its own: round steel has a bright line."""
_AROUND: Final = 32


def add_needle(
    taken: SingleArray, camera: Camera, needle: NeedleLook, tip_mm: FloatArray, light: Light
) -> None:
    """Draw a needle into the light that falls on the sensor, in place.

    Notes
    -----
    Its axis is vertical, and it is the outline of circles up the axis. Its end looks downwards, so
    a camera above sees no more of it than the near half of its rim. It is blurred as a whole,
    though less near its tip in truth.
    """
    height, width = taken.shape[:2]
    high = camera.eye_mm[2] - tip_mm[2]
    if high <= 0:
        return
    z = camera.eye_mm[2] - high * np.geomspace(1, _NEAREST, _KNOTS)
    rings = _rings(camera, tip_mm, z, needle.outer_mm / 2)
    if not _in_view(rings.reshape(-1, 2), width, height):
        return
    for number, (share, bright) in enumerate(_STRIPES):
        shaft = _rings(camera, tip_mm, z, share * needle.outer_mm / 2)
        hulls = [np.concatenate(pair) for pair in itertools.pairwise(shaft)]
        mask = _filled(hulls, (height, width))
        _blend(taken, mask, needle.brightness * bright, needle.defocus_px if number == 0 else 1.0)


def _rings(camera: Camera, tip_mm: FloatArray, z_mm: FloatArray, radius_mm: float) -> FloatArray:
    """Pixels of circles about the axis at heights (n,), (n, _AROUND, 2)."""
    angle = np.linspace(0, 2 * np.pi, _AROUND, endpoint=False)
    places = np.empty((len(z_mm), _AROUND, 3))
    places[..., 0] = tip_mm[0] + radius_mm * np.cos(angle)
    places[..., 1] = tip_mm[1] + radius_mm * np.sin(angle)
    places[..., 2] = z_mm[:, None]
    return camera.pixels(places.reshape(-1, 3)).reshape(len(z_mm), _AROUND, 2)


def _in_view(pixels: FloatArray, width: int, height: int) -> bool:
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    return bool((high > 0).all() and low[0] < width and low[1] < height)


def _filled(hulls: list[FloatArray], shape: tuple[int, int]) -> NDArray[np.uint8]:
    """Share of each pixel that lies in a hull of pixels; what lies far outside isn't drawn.

    OpenCV fills the pixels that an outline touches, too, which would make a needle a pixel wider:
    it is drawn finer.
    """
    mask = np.zeros(shape, np.uint8)
    limit = 3.0 * max(shape)
    near = [one for one in hulls if np.isfinite(one).all() and np.abs(one).max() <= limit]
    if not near:
        return mask
    reach = np.concatenate(near)
    low = np.clip(np.floor(reach.min(axis=0)).astype(int) - 1, 0, None)
    high = np.clip(np.ceil(reach.max(axis=0)).astype(int) + 2, None, shape[::-1])
    columns, rows = high - low
    if columns <= 0 or rows <= 0:
        return mask
    fine = np.zeros((_FINE * rows, _FINE * columns), np.uint8)
    for pixels in near:
        corners = (pixels - low + 0.5) * _FINE - 0.5
        hull = cv2.convexHull(np.round(corners * 2**_SHIFT).astype(np.int32))
        cv2.fillConvexPoly(fine, hull, 255, cv2.LINE_8, _SHIFT)
    box = cv2.resize(fine, (int(columns), int(rows)), interpolation=cv2.INTER_AREA)
    mask[low[1] : high[1], low[0] : high[0]] = box
    return mask


def _blend(taken: SingleArray, mask: NDArray[np.uint8], grey: float, blur_px: float) -> None:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return
    pad = int(4 * blur_px) + 2
    box = (
        slice(max(0, rows[0] - pad), rows[-1] + pad + 1),
        slice(max(0, columns[0] - pad), columns[-1] + pad + 1),
    )
    share = mask[box].astype(np.float32) / 255
    if blur_px > 0:
        share = cv2.GaussianBlur(share, (0, 0), blur_px)
    taken[box] += share[..., None] * (np.float32(grey) - taken[box])


class CameraFile(BaseModel):
    """A simulated camera over a simulated printer."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    camera: Camera
    scene: Scene = Scene()
    laid: InkSource


def load_camera(path: Path) -> CameraFile:
    """Read a camera's file.

    Raises
    ------
    CameraError
        When it can't be read, or has a key or value that means nothing.
    """
    return read_model(path, CameraFile, "camera file", CameraError)
