"""Pictures of a laser's line on ink in a dish, painted ray by ray; shares no code with the product.

Modelled: a fan of light from a laser that turns about an axis (which it needn't contain nor be
parallel to) or moves along one; a camera of `dish_camera`; the insert's face, the dish's floor and
a field of heights; shadows of camera and laser; marks' albedo; slopes; light that spreads below the
surface; wet spots that mirror and dull ones; speckle of its own in each picture; ambient light,
which flickers; gamma, saturation, noise, JPEG. Not modelled: the dish's wall, depth of field,
second reflections, a bath.
"""

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

from benchmarks.checkers.dish_camera import Made, Optics, Scene, photograph

Plane = tuple[np.ndarray, float, np.ndarray]
"""Normal n and distance d of a sheet n·x = d, and the laser's place."""


@dataclass
class Swept:
    """A laser: its place, the sheet's normal, and the axis that it turns about or moves along."""

    place: np.ndarray
    normal: np.ndarray
    axis: np.ndarray
    hinge: np.ndarray | None

    def sheet(self, amount: float) -> Plane:
        """The sheet after a turn by an angle, rad, or a move, mm."""
        if self.hinge is None:
            place, normal = self.place + amount * self.axis, self.normal
        else:
            turn = Rotation.from_rotvec(amount * self.axis).as_matrix()
            place, normal = self.hinge + turn @ (self.place - self.hinge), turn @ self.normal
        return normal, float(normal @ place), place


def laser_over(
    target: np.ndarray, azimuth: float, tilt: float, away: float, turns: bool, askew: float = 0.0
) -> Swept:
    """A laser at a tilt from upright towards an azimuth, rad, whose line runs across the azimuth.

    ``askew`` scales how far it is from an ideal one: the sheet leans against the axis and lies
    beside it, and the axis isn't level.
    """
    back = np.array([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)])
    across = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    normal = np.cross(back, across)
    place = target + away * back
    if not turns:
        along = np.array([np.cos(azimuth), np.sin(azimuth), 0.03 * askew])
        return Swept(place, normal, along / np.linalg.norm(along), None)
    axis = across + askew * (0.04 * back + 0.03 * normal)
    hinge = place + askew * np.array([3.0, -2.0, 4.0])
    return Swept(place, normal, axis / np.linalg.norm(axis), hinge)


@dataclass
class Heights:
    """Heights over the dish's floor, (rows, columns) mm, from a corner on; a cell's side, mm."""

    field: np.ndarray
    low: np.ndarray
    step: float

    def at(self, xy: np.ndarray) -> np.ndarray:
        """Heights (n,) of places (n, 2); 0 outside."""
        where = ((xy - self.low) / self.step).T[::-1]
        return map_coordinates(self.field, where, order=1, mode="constant")


@dataclass
class Look:
    """What doesn't change in a sweep; all in the picture's pixels."""

    optics: Optics
    scene: Scene
    ambient: np.ndarray
    place: np.ndarray
    strength: np.ndarray
    inky: np.ndarray
    hard: float
    spot_mm: float

    def picture(self, sheet: Plane, seed: int, bright: float = 420.0) -> np.ndarray:
        """Picture (h, w), 8 bits, with the laser on."""
        rng = np.random.default_rng((seed, 11))
        normal, distance, _ = sheet
        off = (self.place @ normal.astype(np.float32) - np.float32(distance)) / self.spot_mm
        light = np.zeros(off.shape, np.float32)
        near = np.abs(off) < 12
        rows = np.flatnonzero(near.any(axis=1))
        if len(rows):
            part = slice(max(rows[0] - 8, 0), rows[-1] + 9)
            o, inky = off[part], self.inky[part]
            own = np.exp(-0.5 * o**2)
            deep = 0.5 * self.hard * inky
            glow = np.exp(-0.5 * (o / 3) ** 2) / 3
            band = bright * self.strength[part] * ((1 - deep) * own + deep * glow)
            grain = cv2.GaussianBlur(
                rng.exponential(size=band.shape).astype(np.float32), (0, 0), 0.8
            )
            band *= 1 + self.hard * (grain - 1)
            light[part] = cv2.GaussianBlur(band, (0, 0), self.scene.blur)
        image = self.ambient * (1 + 0.02 * self.hard * rng.normal()) + light
        image = 255 * (np.clip(image, 0, None) / 255) ** self.scene.gamma
        image += rng.normal(size=image.shape).astype(np.float32) * np.sqrt(
            np.clip(image, 0, None) * 255 / self.scene.full_well + self.scene.read**2
        ).astype(np.float32)
        eight = np.clip(np.round(image), 0, 255).astype(np.uint8)
        if self.scene.quality < 100:
            packed = cv2.imencode(".jpg", eight, [cv2.IMWRITE_JPEG_QUALITY, self.scene.quality])[1]
            eight = cv2.imdecode(packed, cv2.IMREAD_GRAYSCALE)
        return eight


def looked_at(
    optics: Optics,
    made: Made,
    scene: Scene,
    laser: Swept,
    floor_z: float,
    ink: Heights | None = None,
    seed: int = 0,
    hard: float = 1.0,
    spot_mm: float = 0.04,
) -> Look:
    """Trace each pixel's ray to what it shows, and the laser's light from there."""
    rng = np.random.default_rng((seed, 12))
    plain = replace(scene, read=0.0, full_well=1e9, quality=100, gamma=1.0)
    ambient = photograph(optics, made, plain, seed).astype(np.float32)
    wide, high = optics.size
    uu, vv = np.meshgrid(np.arange(wide, dtype=float), np.arange(high, dtype=float))
    way = optics.directions(np.column_stack([uu.ravel(), vv.ravel()]))
    up = made.turn[:, 2]
    place = optics.centre + ((made.origin - optics.centre) @ up / (way @ up))[:, None] * way
    flat = (place - made.origin) @ made.turn[:, :2] / made.scale
    hole = np.hypot(*(flat / (np.array(made.plan["hole_mm"]) / 2)).T) < 1
    slope = way / way[:, 2:]
    place[hole] = (optics.centre + (floor_z - optics.centre[2]) * slope)[hole]
    strength = np.where(hole, 0.6, ambient.ravel() / scene.white)
    inky = np.zeros(len(place))
    if ink is not None:
        _hit(place, strength, inky, slope, hole, optics, laser, floor_z, ink, rng, hard)
    shape = (high, wide)
    return Look(
        optics, scene, ambient, place.reshape(*shape, 3).astype(np.float32),
        strength.reshape(shape).astype(np.float32), inky.reshape(shape).astype(np.float32),
        hard, spot_mm,
    )  # fmt: skip


def _hit(
    place: np.ndarray, strength: np.ndarray, inky: np.ndarray, slope: np.ndarray, hole: np.ndarray,
    optics: Optics, laser: Swept, floor_z: float, ink: Heights, rng: Any, hard: float,
) -> None:  # fmt: skip
    """Move pixels' places onto the ink; what light is there."""
    size = np.array(ink.field.shape[::-1]) * ink.step
    top = float(ink.field.max()) + 1e-6
    low = np.minimum(place[:, :2], place[:, :2] + top * slope[:, :2])
    near = hole & (low > ink.low - 2).all(axis=1) & (low < ink.low + size + 2).all(axis=1)
    own, ways = place[near], slope[near]
    done = np.zeros(len(own), bool)
    levels = np.arange(top, -0.002, -0.004)
    for z in levels:
        at = optics.centre + (floor_z + z - optics.centre[2]) * ways
        now = ~done & (ink.at(at[:, :2]) >= z)
        own[now] = at[now]
        done |= now
    height = ink.at(own[:, :2])
    step = 1.5 * ink.step
    gx = (ink.at(own[:, :2] + [step, 0]) - ink.at(own[:, :2] - [step, 0])) / (2 * step)
    gy = (ink.at(own[:, :2] + [0, step]) - ink.at(own[:, :2] - [0, step])) / (2 * step)
    normal = np.column_stack([-gx, -gy, np.ones(len(gx))])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    from_ = np.tile(laser.place, (len(own), 1))
    if laser.hinge is None:  # where it is when its sheet comes there
        reach = ((own - laser.place) @ laser.normal) / (laser.axis @ laser.normal)
        from_ = laser.place + reach[:, None] * laser.axis
    beam = from_ - own
    beam /= np.linalg.norm(beam, axis=1)[:, None]
    shaded = np.zeros(len(own), bool)
    for rise in np.arange(0.01, top + 0.01, 0.008):
        at = own + beam * (rise / beam[:, 2])[:, None]
        shaded |= ink.at(at[:, :2]) > at[:, 2] - floor_z + 0.004
    sight = optics.centre - own
    sight /= np.linalg.norm(sight, axis=1)[:, None]
    lit = np.clip((normal * beam).sum(axis=1), 0, 1) * (~shaded)
    half = beam + sight
    half /= np.linalg.norm(half, axis=1)[:, None]
    mirror = np.exp(-((1 - (normal * half).sum(axis=1)) / 2e-3))
    wet = _patches(ink, own, 0.3, rng) > 1.0
    dull = _patches(ink, own, 0.15, rng) > 2.2
    is_ink = height > 0.01
    light = 0.7 * lit * (1 + 6 * hard * mirror * wet) * np.where(dull & (hard > 0), 0.05, 1.0)
    strength[near] = np.where(is_ink, light, strength[near] * (~shaded))
    inky[near] = is_ink
    place[near] = own


def _patches(ink: Heights, at: np.ndarray, size_mm: float, rng: Any) -> np.ndarray:
    """Smooth noise of unit spread over the ink, at places."""
    noise = cv2.GaussianBlur(rng.normal(size=ink.field.shape), (0, 0), size_mm / 2 / ink.step)
    return Heights(noise / noise.std(), ink.low, ink.step).at(at[:, :2])
