"""Render a simulated camera's picture of the dish from laid ink, camera and scene.

Modelled
--------
- Camera: pinhole, lens distortion, tilt, turn, any place; refraction at the bath's flat surface.
- Ink: each line as wide as its dose makes it, thick in its middle, translucent, with a colour of
  its own; rims darker or brighter; ridges lit from one side; what was laid before below it, fading
  with the bath's turbidity; ink that is missing by faults (`gcode.deposit.lay`).
- Bath: granules of several sizes, which lie still from look to look; light of its own over deep
  ink. Uneven light.
- Sensor: blur, vignetting, shot and read noise, gamma.

Not modelled
------------
Glints, bubbles and dirt, markers, the dish's rim, the needle in the view (`benchmarks/checkers`
paint them, to judge the inspection); shadows, ink that a needle drags, crevices it leaves in the
bath, focus that changes with depth, scattering from line to line, a bath that dries, rolling
shutter, the sensor's colour mosaic, saturation that blooms. Deep ink hides no other deep ink: their
thicknesses add up. Refraction moves places, and its scale is that straight below the camera.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from firmware_profiles.materials.bead import BeadSection
from gcode.deposit.lay import Laid
from gcode.deposit.written import Strands
from gcode.errors import SimError
from gcode.user_files import UserFile
from kernels import jit
from kernels.arrays import FloatArray, IntArray
from sim.devices.camera.scene import Bath, Camera, InkLook, Light, Plan, Scene, Sensor
from sim.devices.recorded_ink import InkSource
from sim.errors import CameraError

SingleArray = NDArray[np.float32]


class InkDrawing(NamedTuple):
    """How ink is drawn."""

    faint: float = 0.02  # Share of its light by which a deep layer isn't drawn any more.
    rim: float = 0.15  # A line isn't thinner at its rim, where it is seen on edge.
    opaque: float = 6.0  # Optical thickness of ink below which nothing shows.


DRAWING: Final = InkDrawing()

_FLAT: Final = {"layered": 0.25, "embedded": 0.5}
"""Power of 1 - q² at the share q of the radius: 1/2 is an ellipse, less is flatter."""


@dataclass(frozen=True)
class InkMap:
    """Ink over a plan.

    Attributes
    ----------
    thick_mm : (rows, columns) float32
        Of all ink along the line of sight, deeper one fading with the bath's turbidity.
    crest_mm : (rows, columns) float32
        Top of the ink, printer's z; NaN where there is none.
    """

    thick_mm: SingleArray
    crest_mm: SingleArray


def ink_map(ink: Laid, plan: Plan, look: InkLook, bath: Bath) -> InkMap:
    """Draw laid ink.

    Layers add up, lines within one don't (they are united); of filaments in a bath the one that
    shows most counts.
    """
    thick = np.zeros(plan.shape, np.float32)
    crest = np.full(plan.shape, -np.inf, np.float32)
    lines = ink.strands
    if not len(lines):
        return InkMap(thick, np.full(plan.shape, np.nan, np.float32))
    top, radius = _tops(ink), _radii(ink, look)
    surface = top.max() if bath.surface_z_mm is None else max(bath.surface_z_mm, top.max())
    weight = np.exp(-2 * bath.turbidity_per_mm * (surface - top.mean(axis=1)))
    shown = weight > DRAWING.faint * weight.max()
    number = np.zeros(len(lines), np.int64)
    if ink.layering is not None:
        number = ink.layering.number(lines.end[:, 2])
    profile = np.maximum(np.linspace(1, 0, 1025) ** _FLAT[ink.style], DRAWING.rim)
    pens = _Pens(radius, top, ink.height_mm, weight, profile, DRAWING.opaque / look.density_per_mm)
    for layer in np.unique(number[shown])[::-1]:
        _draw(lines, np.flatnonzero(shown & (number == layer)), pens, plan, thick, crest)
    return InkMap(thick, np.where(np.isfinite(crest), crest, np.float32(np.nan)))


def _tops(ink: Laid) -> FloatArray:
    """Height of the crest at each line's ends, (n, 2), mm."""
    tip = np.column_stack([ink.strands.start[:, 2], ink.strands.end[:, 2]])
    return tip if ink.layering is not None else tip + ink.strands.radius[:, None]


def _radii(ink: Laid, look: InkLook) -> FloatArray:
    """Half of what is seen of each line from above, mm."""
    if ink.layering is None:
        return ink.strands.radius
    width = BeadSection(look.bead).width(ink.strands.area_mm2, ink.height_mm)
    return np.asarray(width / 2)


@dataclass(frozen=True)
class _Pens:
    """How each line is drawn; names as of `draw_lines`, radius in mm."""

    radius: FloatArray
    crest: FloatArray
    height: FloatArray
    weight: FloatArray
    profile: FloatArray
    enough: float


def _draw(
    lines: Strands,
    rows: IntArray,
    pens: _Pens,
    plan: Plan,
    thick: SingleArray,
    crest: SingleArray,
) -> None:
    """Add some of the lines to the maps."""
    start, end = plan.seen_at(lines.start[rows]), plan.seen_at(lines.end[rows])
    wide = pens.radius[rows] * plan.scale((lines.start[rows, 2] + lines.end[rows, 2]) / 2)
    limit = np.array(plan.shape[::-1]) - 1.0
    low = np.minimum(start, end).min(axis=0) - wide.max() - 2
    high = np.maximum(start, end).max(axis=0) + wide.max() + 2
    if (high < 0).any() or (low > limit).any():
        return
    first = np.clip(np.floor(low), 0, limit).astype(int)
    last = np.clip(np.ceil(high), 0, limit).astype(int) + 1
    box = (slice(first[1], last[1]), slice(first[0], last[0]))
    above, own_crest = np.ascontiguousarray(thick[box]), np.ascontiguousarray(crest[box])
    own = np.zeros_like(above)
    draw_lines(
        np.column_stack([start - first, end - first]),
        wide,
        pens.crest[rows],
        pens.height[rows],
        pens.weight[rows],
        pens.profile,
        above,
        pens.enough,
        own,
        own_crest,
    )
    thick[box] += own
    crest[box] = own_crest


@jit
def draw_lines(
    segments: FloatArray,
    radius: FloatArray,
    crest: FloatArray,
    height: FloatArray,
    weight: FloatArray,
    profile: FloatArray,
    above_map: SingleArray,
    enough: float,
    thick_map: SingleArray,
    crest_map: SingleArray,
) -> None:
    """Draw capsules, each thickest in its middle; where they overlap the thickest counts.

    ``segments`` (n, 4) are x0, y0, x1, y1 and ``radius`` (n,) in pixels of the maps; ``crest``
    (n, 2) and ``height`` (n,) are mm: where a line's top is at its ends, and how thick it is.
    ``weight`` fades what lies deep. ``profile`` (m,) is a line's thickness over that in its middle,
    evenly over the square of the share of the radius. The outermost pixel counts by the share that
    is covered. Nothing is drawn where more than ``enough`` ink lies in ``above_map`` already.
    """
    ny, nx = thick_map.shape
    for s in range(len(radius)):
        x0, y0, x1, y1 = segments[s]
        r = radius[s]
        reach = r + 1.0
        dx, dy = x1 - x0, y1 - y0
        squared = dx * dx + dy * dy
        per_squared = 1.0 / squared if squared > 0.0 else 0.0
        per_radius = (len(profile) - 1) / (r * r)
        thickest = weight[s] * height[s]
        outer, inner = (r + 0.5) ** 2, max(r - 0.5, 0.0) ** 2
        first = max(0, math.ceil(min(y0, y1) - reach))
        last = min(ny - 1, math.floor(max(y0, y1) + reach))
        for row in range(first, last + 1):
            t0, t1 = 0.0, 1.0
            if abs(dy) > 1e-9:
                ta, tb = (row - reach - y0) / dy, (row + reach - y0) / dy
                t0, t1 = max(0.0, min(ta, tb)), min(1.0, max(ta, tb))
            xa, xb = x0 + t0 * dx, x0 + t1 * dx
            left = max(0, math.ceil(min(xa, xb) - reach))
            right = min(nx - 1, math.floor(max(xa, xb) + reach))
            py = row - y0
            for col in range(left, right + 1):
                if above_map[row, col] > enough:
                    continue
                px = col - x0
                t = min(1.0, max(0.0, (px * dx + py * dy) * per_squared))
                ox, oy = px - t * dx, py - t * dy
                square = ox * ox + oy * oy
                if square >= outer:
                    continue
                cover = 1.0
                if square > inner:
                    cover = r - math.sqrt(square) + 0.5
                share = profile[min(int(square * per_radius), len(profile) - 1)] * cover
                thick = np.float32(thickest * share)
                if thick > thick_map[row, col]:
                    thick_map[row, col] = thick
                upper = crest[s, 0] + t * (crest[s, 1] - crest[s, 0])
                top = np.float32(upper - height[s] * (1.0 - share))
                if top > crest_map[row, col]:
                    crest_map[row, col] = top


_SMOOTH_PX: Final = 1.2
"""Of the crest before its slope is taken: what light makes of a ridge has no corners."""


def lit(ink: InkMap, plan: Plan, scene: Scene, ground: Plan) -> SingleArray:
    """Light that comes from the plane, grey levels, (rows, columns, 3 or 1).

    ``ground`` is where the bath's granules lie.
    """
    bath = scene.bath
    grain = _grain(ground, bath, scene.seed)
    through = np.exp(-np.float32(scene.ink.density_per_mm) * ink.thick_mm)
    # The bath over the ink throws light of its own between the ink and the camera.
    clear = _clearness(ink, bath)
    shade = _shade(ink, plan, scene.ink, scene.light)
    share = (1 - through) * clear
    lit_ink = share * shade
    colours = list(zip(scene.shades(bath.colour), scene.shades(scene.ink.colour), strict=True))
    out = np.empty((*plan.shape, len(colours)), np.float32)
    for k, (under, over) in enumerate(colours):
        out[..., k] = np.float32(under) * (1 - share) + np.float32(over) * lit_ink
    # Granules show on the bath, and less through the ink.
    out *= (1 + grain * (1 - 0.5 * share))[..., None]
    out *= _unevenness(plan, scene.light)[..., None]
    return out


def _grain(plan: Plan, bath: Bath, seed: int) -> SingleArray:
    # Grains finer than a pixel are averaged in it.
    kept = min(1.0, bath.granule_mm / plan.pitch_mm)
    return np.float32(bath.texture * kept) * granules(plan, bath.granule_mm, seed)


def _clearness(ink: InkMap, bath: Bath) -> SingleArray:
    """Share of the ink's light that the bath over it lets through."""
    if bath.surface_z_mm is None:
        return np.ones_like(ink.thick_mm)
    cover = np.float32(bath.surface_z_mm) - np.nan_to_num(ink.crest_mm, nan=bath.surface_z_mm)
    return np.exp(np.float32(-2 * bath.turbidity_per_mm) * np.maximum(cover, 0))


def _shade(ink: InkMap, plan: Plan, look: InkLook, light: Light) -> SingleArray:
    """Brightness of the ink by its slope, 1 where it is level."""
    slope_x, slope_y = _slopes(ink.crest_mm, plan.pitch_mm)
    towards = _direction(light.azimuth_deg)
    facing = -(slope_x * towards[0] + slope_y * towards[1])
    steep = slope_x**2 + slope_y**2
    shade = 1 + look.relief * np.tanh(facing) - look.edge * steep / (1 + steep)
    return np.maximum(shade, 0.05).astype(np.float32)


def _slopes(crest: SingleArray, pitch_mm: float) -> tuple[SingleArray, SingleArray]:
    """Slope of the crest along x and y; where there is no ink it is as high as its lowest."""
    level = crest
    if np.isnan(crest).any():
        known = crest[np.isfinite(crest)]
        level = np.nan_to_num(crest, nan=float(known.min()) if len(known) else 0.0)
    smooth = cv2.GaussianBlur(level, (0, 0), _SMOOTH_PX)
    scale = 1 / (8 * pitch_mm)
    return (
        np.asarray(cv2.Sobel(smooth, cv2.CV_32F, 1, 0, scale=scale)),
        np.asarray(cv2.Sobel(smooth, cv2.CV_32F, 0, 1, scale=scale)),
    )


def _unevenness(plan: Plan, light: Light) -> SingleArray:
    """Light over the field: brighter towards the lamp, and about a soft middle of its own."""
    rows, columns = plan.shape
    target = plan.camera.target_mm
    half = max(rows, columns) * plan.pitch_mm / 2
    x = ((plan.origin_mm[0] + plan.pitch_mm * np.arange(columns) - target[0]) / half).astype("f4")
    y = ((plan.origin_mm[1] + plan.pitch_mm * np.arange(rows) - target[1]) / half).astype("f4")
    towards = _direction(light.azimuth_deg)
    along = x[None, :] * towards[0] + y[:, None] * towards[1]
    off = (x[None, :] - 0.3 * towards[0]) ** 2 + (y[:, None] - 0.3 * towards[1]) ** 2
    return np.asarray(np.clip(1 + light.uneven * (0.6 * along - 0.4 * off), 0.05, None), np.float32)


def _direction(azimuth_deg: float) -> tuple[float, float]:
    angle = np.radians(azimuth_deg)
    return float(np.cos(angle)), float(np.sin(angle))


ByteArray = NDArray[np.uint8]
_WHITE: Final = 255.0


def exposed(light: SingleArray, sensor: Sensor, generator: np.random.Generator) -> ByteArray:
    """Take a picture: (h, w, 3), blue, green, red, or (h, w) of a sensor without colours.

    Parameters
    ----------
    light : (h, w, 3 or 1) float32
        Red, green, blue, or grey alone; grey levels.
    """
    blurred = light
    if sensor.blur_px > 0:
        blurred = cv2.GaussianBlur(light, (0, 0), sensor.blur_px)
    blurred = blurred.reshape(light.shape)[..., ::-1]
    blurred = blurred * _vignette(light.shape[:2], sensor.vignetting)
    picture = _counted(blurred, sensor, generator)
    if sensor.mono:
        picture = picture[..., 0]
    return picture


def _vignette(shape: tuple[int, ...], fall: float) -> SingleArray:
    rows, columns = shape
    most = ((rows / 2) ** 2 + (columns / 2) ** 2) / fall if fall else np.inf
    y = ((np.arange(rows) - (rows - 1) / 2) ** 2 / most).astype(np.float32)
    x = ((np.arange(columns) - (columns - 1) / 2) ** 2 / most).astype(np.float32)
    factor = (1 - y)[:, None] - x[None, :]
    return factor[..., None]


def _counted(light: SingleArray, sensor: Sensor, generator: np.random.Generator) -> ByteArray:
    """Shot and read noise, the sensor's limit, gamma, 8 bits."""
    np.clip(light, 0, 4 * _WHITE, out=light)
    noise = light * np.float32(_WHITE / sensor.full_well)
    noise += np.float32(sensor.read_noise**2)
    np.sqrt(noise, out=noise)
    noise *= generator.standard_normal(light.shape, dtype=np.float32)
    light += noise
    np.clip(light, 0, _WHITE, out=light)
    if sensor.gamma != 1:
        light = _WHITE * (light / _WHITE) ** np.float32(1 / sensor.gamma)
    return np.ascontiguousarray(np.round(light, out=light).astype(np.uint8))


class GranuleNoise(NamedTuple):
    """Noise of which the granules are made."""

    tile_px: int = 1024
    texels_per_grain: float = 3.0  # Texels of a tile in a grain.
    # Texels a pixel below which straight lines between them would be seen.
    cubic_below: float = 0.2


GRANULES: Final = GranuleNoise()

_OCTAVES: Final = ((1.0, 0.6), (2.7, 0.5), (8.3, 0.45), (31.0, 0.4))
"""Size over the finest granule, and its share; no two sizes have a common measure, so that no
tile's repetition shows."""


def granules(plan: Plan, granule_mm: float, seed: int) -> SingleArray:
    """Brightness of a granular bath about 0, standard deviation 1, (rows, columns)."""
    out = np.zeros(plan.shape, np.float32)
    for number, (size, share) in enumerate(_OCTAVES):
        tile = _noise_tile(seed, number)
        if number == 0:
            # Granules have edges: bright bodies with dark seams between them.
            tile = np.abs(tile)
            tile = (tile - tile.mean()) / tile.std()
        out += np.float32(share) * _laid_out(tile, plan, granule_mm * size)
    return out / np.float32(np.sqrt(sum(share**2 for _, share in _OCTAVES)))


@lru_cache(maxsize=8)
def _noise_tile(seed: int, number: int) -> SingleArray:
    """Smooth noise without seams at its rim, standard deviation 1."""
    drawn = np.random.default_rng((seed, 7, number)).standard_normal(
        (GRANULES.tile_px, GRANULES.tile_px), np.float32
    )
    sigma, pad = GRANULES.texels_per_grain / 2.5, 8
    wide = np.pad(drawn, pad, mode="wrap")
    smooth = cv2.GaussianBlur(wide, (0, 0), sigma)[pad:-pad, pad:-pad]
    return np.ascontiguousarray(smooth / smooth.std(), dtype=np.float32)


def _laid_out(tile: SingleArray, plan: Plan, grain_mm: float) -> SingleArray:
    """A tile over the plan, again and again, by the printer's coordinates."""
    texel = grain_mm / GRANULES.texels_per_grain
    scale = plan.pitch_mm / texel
    x, y = np.mod(plan.origin_mm / texel, GRANULES.tile_px)
    rows, columns = plan.shape
    between = cv2.INTER_CUBIC if scale < GRANULES.cubic_below else cv2.INTER_LINEAR
    return np.asarray(
        cv2.warpAffine(
            tile,
            np.array([[scale, 0, x], [0, scale, y]]),
            (columns, rows),
            flags=between | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_WRAP,
        )
    )


def paint(ink: Laid, camera: Camera, scene: Scene, seed: int) -> NDArray[np.uint8]:
    """Return a picture: (h, w, 3) in blue, green, red, or (h, w) of a sensor without colours.

    Same ink, camera, scene and seed, same bytes.

    Parameters
    ----------
    scene : Scene
        Its own seed is of what lies in the dish.
    seed : int
        Of the sensor's noise: another one for another look.

    Raises
    ------
    CameraError
        When the camera sees past the dish.
    """
    index = 1.0 if scene.bath.surface_z_mm is None else scene.bath.refractive_index
    plan = Plan.under(camera, _plane_z(ink, camera, scene), index)
    drawn_ink = ink_map(ink, plan, scene.ink, scene.bath)
    drawn = lit(drawn_ink, plan, scene, _ground(ink, plan, scene))
    return exposed(plan.photograph(drawn), scene.sensor, np.random.default_rng((seed, 11)))


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


class CameraFile(UserFile):
    """A simulated camera over a simulated printer."""

    called: ClassVar[str] = "camera file"
    error: ClassVar[type[SimError]] = CameraError

    camera: Camera
    scene: Scene = Scene()
    laid: InkSource
