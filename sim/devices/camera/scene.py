"""Camera and scene of a simulated picture, and the grid that it is drawn on.

Grey levels are 0 to 255, of linear light before the sensor's gamma; colours are red, green, blue.
The projection is own code, shared with no one who looks at the pictures: registration's is judged
by it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from firmware_profiles.strict_model import BeadShape
from gcode.user_files import FileSection
from kernels.arrays import FloatArray
from sim.errors import CameraError

Grey = Annotated[float, Field(ge=0, le=255)]
Colour = tuple[Grey, Grey, Grey]
Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Angle = Annotated[float, Field(ge=-360, le=360)]


class Bath(FileSection):
    """Support bath.

    Attributes
    ----------
    surface_z_mm : float, mm, or None
        Of the bath, printer's frame; None for none (what is seen lies in air).
    turbidity_per_mm : float
        Attenuation of the light, once each way.
    texture : float
        Standard deviation of the granules' brightness, of 1.
    granule_mm : float, mm
        Size of the finest; coarser ones lie among them.
    """

    colour: Colour = (172, 168, 158)
    surface_z_mm: float | None = None
    refractive_index: Annotated[float, Field(ge=1, le=2)] = 1.33
    turbidity_per_mm: NonNegative = 0.35
    texture: Annotated[float, Field(ge=0, le=0.5)] = 0.04
    granule_mm: Annotated[float, Field(ge=0.005, le=2)] = 0.06


class InkLook(FileSection):
    """Ink.

    Attributes
    ----------
    colour
        Of ink so thick that nothing shines through.
    density_per_mm : float
        How fast it comes to that (1/e).
    edge : float
        Darkening of its rims by refraction, of 1; below 0 brightening.
    relief : float
        How much ridges are lit and shaded, of 1.
    bead : shape or float
        Section of lines in a layer, as an ink's profile says it
        (`firmware_profiles.materials.bead`).
    """

    colour: Colour = (225, 222, 214)
    density_per_mm: Positive = 9.0
    edge: Annotated[float, Field(ge=-1, le=1)] = 0.15
    relief: Annotated[float, Field(ge=0, le=2)] = 0.25
    bead: BeadShape | Annotated[float, Field(ge=-1000, le=1000)] = "rounded"


class Light(FileSection):
    """Light from one side.

    Attributes
    ----------
    azimuth_deg : float, degrees
        Where it comes from (0 is +x, 90 is +y).
    uneven : float
        Fall across the field, of 1.
    """

    azimuth_deg: Angle = 135.0
    uneven: Annotated[float, Field(ge=0, le=0.9)] = 0.15


class Sensor(FileSection):
    """Lens faults and sensor.

    Attributes
    ----------
    blur_px : float
        Standard deviation of the point spread.
    vignetting : float
        Fall of the light to the farthest corner, of 1.
    full_well : float, electrons
        At level 255; shot noise is its root.
    read_noise : float, grey levels
    gamma : float
        2.2 for a picture made to be looked at; 1 for linear.
    mono : bool
        Grey, (h, w).
    """

    blur_px: Annotated[float, Field(ge=0, le=50)] = 0.8
    vignetting: Annotated[float, Field(ge=0, le=0.95)] = 0.1
    full_well: Annotated[float, Field(ge=100, le=1e6)] = 10_000.0
    read_noise: Annotated[float, Field(ge=0, le=50)] = 0.8
    gamma: Annotated[float, Field(ge=0.3, le=3)] = 1.0
    mono: bool = False


class Scene(FileSection):
    """All that a picture shows besides the ink; `seed` is of what lies there from look to look."""

    bath: Bath = Bath()
    ink: InkLook = InkLook()
    light: Light = Light()
    sensor: Sensor = Sensor()
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 0

    def shades(self, colour: Colour) -> tuple[float, ...]:
        """A colour as the sensor tells it: red, green, blue, or grey (BT.601) alone."""
        if not self.sensor.mono:
            return colour
        red, green, blue = colour
        return (0.299 * red + 0.587 * green + 0.114 * blue,)

    @model_validator(mode="after")
    def _ink_shows(self) -> Scene:
        if self.ink.colour == self.bath.colour:
            raise ValueError("ink.colour is the bath's; nothing would be seen of the ink")
        return self


# Own code, shared with no one who looks at the pictures: registration's projection is judged by it.
_ROUNDS: Final = 60
_STEEPEST: Final = 0.05
"""Least cosine between a ray and straight down that still is called looking at the dish."""


class Camera(FileSection):
    """A camera over the dish.

    Attributes
    ----------
    um_per_px : float
        At the target, on the optical axis.
    target_mm : (x, y, z), mm
        Printer's frame; seen in the middle of the picture, but for `centre_off_px`.
    distance_mm : float, mm
        Pinhole to target.
    tilt_deg, tilt_towards_deg : float, degrees
        Of the camera's body from straight above, towards this direction (0 is +x, 90 is +y).
    turn_deg : float, degrees
        Clockwise turn of the picture; at 0 (and no tilt) +x is right and +y is up.
    centre_off_px : (x, y)
        Of the optical axis from the picture's middle.
    distortion : (k1, k2, p1, p2, k3)
        Brown (1971), in OpenCV's order and units.
    """

    size_px: tuple[Annotated[int, Field(ge=16, le=20_000)], Annotated[int, Field(ge=16, le=20_000)]]
    um_per_px: Annotated[float, Field(gt=0.1, le=1000)]
    target_mm: tuple[float, float, float]
    distance_mm: Annotated[float, Field(gt=1, le=10_000)] = 150.0
    tilt_deg: Annotated[float, Field(ge=0, le=60)] = 0.0
    tilt_towards_deg: float = 0.0
    turn_deg: float = 0.0
    centre_off_px: tuple[float, float] = (0.0, 0.0)
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)

    @property
    def focal_px(self) -> float:
        """Focal length in pixels."""
        return 1000.0 * self.distance_mm / self.um_per_px

    @property
    def axes(self) -> FloatArray:
        """Right, down and ahead of the camera in the printer's frame, (3, 3)."""
        tilt, towards = np.radians(self.tilt_deg), np.radians(self.tilt_towards_deg)
        out = np.array([np.cos(towards), np.sin(towards), 0.0])
        ahead = -np.cos(tilt) * np.array([0.0, 0.0, 1.0]) - np.sin(tilt) * out
        # The axes of the upright camera, carried along by the tilt.
        axis = np.cross([0.0, 0.0, -1.0], ahead)
        right = _rotated(np.array([1.0, 0.0, 0.0]), axis, tilt)
        right = _rotated(right, ahead, -np.radians(self.turn_deg))
        return np.array([right, np.cross(ahead, right), ahead])

    @property
    def eye_mm(self) -> FloatArray:
        """The pinhole's place, (3,), mm."""
        return np.asarray(np.array(self.target_mm) - self.distance_mm * self.axes[2])

    @property
    def centre_px(self) -> FloatArray:
        """Pixel of the optical axis, (2,); (0, 0) is the first pixel's middle."""
        return np.asarray((np.array(self.size_px) - 1) / 2 + np.array(self.centre_off_px))

    def pixels(self, points_mm: FloatArray) -> FloatArray:
        """Pixels (n, 2) of places (n, 3) in air; NaN behind the camera."""
        seen = (np.asarray(points_mm, dtype=np.float64) - self.eye_mm) @ self.axes.T
        deep = np.where(seen[:, 2:] > 1e-6, seen[:, 2:], np.nan)
        return self._distorted(seen[:, :2] / deep) * self.focal_px + self.centre_px

    def on_plane(self, pixels: FloatArray, z_mm: float) -> FloatArray:
        """Places (n, 2) where the rays of pixels (n, 2) meet a height, in air, mm.

        Raises
        ------
        CameraError
            When one looks beside it.
        """
        flat = self._straight(
            (np.asarray(pixels, dtype=np.float64) - self.centre_px) / self.focal_px
        )
        rays = np.column_stack([flat, np.ones(len(flat))]) @ self.axes
        if not (-rays[:, 2] > _STEEPEST * np.linalg.norm(rays, axis=1)).all():
            raise CameraError(
                f"the camera, tilted by {self.tilt_deg:g} degrees, sees past the dish's plane; "
                "lower tilt_deg, or the field (um_per_px, size_px)"
            )
        reach = (z_mm - self.eye_mm[2]) / rays[:, 2]
        return np.asarray(self.eye_mm[:2] + reach[:, None] * rays[:, :2])

    def _distorted(self, flat: FloatArray) -> FloatArray:
        k1, k2, p1, p2, k3 = self.distortion
        x, y = flat.T
        r2 = x**2 + y**2
        stretch = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
        return np.column_stack(
            [
                x * stretch + 2 * p1 * x * y + p2 * (r2 + 2 * x**2),
                y * stretch + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y,
            ]
        )

    def _straight(self, seen: FloatArray) -> FloatArray:
        """Inverse of `_distorted`, by repeated correction."""
        flat = seen.copy()
        for _ in range(_ROUNDS):
            off = self._distorted(flat) - seen
            flat = flat - off
            if np.abs(off).max() < 1e-12:
                return flat
        if np.abs(off).max() > 1e-7:
            raise CameraError(
                f"the lens distortion {self.distortion} folds the picture over; take smaller values"
            )
        return flat


def through_surface(
    points_mm: FloatArray, eye_mm: FloatArray, surface_z_mm: float, index: float
) -> FloatArray:
    """Places (n, 2) on a height at which an eye above sees places (n, 3), mm.

    Below it a ray goes on by Snell's law, sin i = index × sin r: at a place a aside of the eye,
    a / √(a² + H²) = index (D - a) / √((D - a)² + h²), solved by halving. Above it (and at index 1)
    all is straight.
    """
    points = np.asarray(points_mm, dtype=np.float64)
    high = eye_mm[2] - surface_z_mm
    aside = points[:, :2] - eye_mm[:2]
    below = surface_z_mm - points[:, 2]
    straight = eye_mm[:2] + aside * (high / (high + below))[:, None]
    deep = (below > 0) & (index > 1)
    if not deep.any():
        return np.asarray(straight)
    far, depth = np.hypot(*aside[deep].T), below[deep]
    low, top = np.zeros_like(far), far.copy()
    for _ in range(_ROUNDS):
        middle = (low + top) / 2
        rest = far - middle
        bent = middle * np.hypot(rest, depth) - index * rest * np.hypot(middle, high)
        low, top = np.where(bent < 0, middle, low), np.where(bent < 0, top, middle)
    straight[deep] = eye_mm[:2] + aside[deep] * (middle / np.maximum(far, 1e-12))[:, None]
    return np.asarray(straight)


def _rotated(vector: FloatArray, axis: FloatArray, angle: float) -> FloatArray:
    """A vector turned about an axis (Rodrigues); as it is where there is none."""
    length = float(np.linalg.norm(axis))
    if length < 1e-12:
        return vector
    unit = axis / length
    along = unit * float(unit @ vector)
    across = np.cross(unit, vector)
    return np.asarray(along + np.cos(angle) * (vector - along) + np.sin(angle) * across)


SingleArray = NDArray[np.float32]


class PlanGrid(NamedTuple):
    """Grid on which a scene is drawn."""

    # Pixels between those whose place is computed; the map is smooth between them.
    coarse_px: int = 8
    margin_px: int = 4
    max_pixels: int = 60_000_000


GRID: Final = PlanGrid()


@dataclass(frozen=True)
class Plan:
    """Drawing plane: the bath's surface, or the top of the ink where there is none.

    Attributes
    ----------
    index : float
        Refractive, of what lies below.
    origin_mm : (2,) float64, mm
        Centre of the first pixel; rows go to +y.
    pitch_mm : float, mm
        Of the pixels: one of the camera's at the target.
    shape : (rows, columns)
    """

    camera: Camera
    z_mm: float
    index: float
    origin_mm: FloatArray
    pitch_mm: float
    shape: tuple[int, int]

    @staticmethod
    def under(camera: Camera, z_mm: float, index: float) -> Plan:
        """All that the camera sees of a plane.

        Raises
        ------
        CameraError
            When it looks past it, or from below.
        """
        high = float(camera.eye_mm[2] - z_mm)
        if high <= 1.0:
            raise CameraError(
                f"the camera is {high:g} mm above the drawn plane (z {z_mm:g} mm); it must be more "
                "than 1 mm: raise distance_mm, or mend target_mm"
            )
        edge = camera.on_plane(_border(camera), z_mm)
        pitch = camera.um_per_px * 1e-3 * high / float(camera.eye_mm[2] - camera.target_mm[2])
        low = edge.min(axis=0) - GRID.margin_px * pitch
        columns, rows = np.ceil((edge.max(axis=0) - low) / pitch).astype(int) + GRID.margin_px + 1
        if rows * columns > GRID.max_pixels:
            raise CameraError(
                f"the field of {columns} by {rows} pixels in the dish's plane is too large; lower "
                "tilt_deg or size_px"
            )
        return Plan(camera, z_mm, index, low, pitch, (int(rows), int(columns)))

    def seen_at(self, points_mm: FloatArray) -> FloatArray:
        """Pixels (n, 2) of the plane where places (n, 3), mm, are seen."""
        at = through_surface(points_mm, self.camera.eye_mm, self.z_mm, self.index)
        return np.asarray((at - self.origin_mm) / self.pitch_mm)

    def scale(self, z_mm: FloatArray) -> FloatArray:
        """Pixels of the plane in a mm at heights (n,); straight below the eye."""
        high = self.camera.eye_mm[2] - self.z_mm
        deep = self.z_mm - np.asarray(z_mm)
        apparent = np.where(deep > 0, deep / self.index, deep)
        return np.asarray(high / (high + apparent) / self.pitch_mm)

    def below(self, z_mm: float) -> Plan:
        """The same pixels on a lower plane, where the camera sees it through this one's in air."""
        eye = self.camera.eye_mm
        scale = float((eye[2] - z_mm) / (eye[2] - self.z_mm))
        origin = eye[:2] + scale * (self.origin_mm - eye[:2])
        return replace(self, z_mm=z_mm, origin_mm=origin, pitch_mm=self.pitch_mm * scale)

    def photograph(self, drawn: SingleArray) -> SingleArray:
        """The drawn plane (rows, columns, colours) as the camera's lens throws it."""
        width, height = self.camera.size_px
        coarse_u = np.arange(0, width + GRID.coarse_px, GRID.coarse_px, dtype=np.float64)
        coarse_v = np.arange(0, height + GRID.coarse_px, GRID.coarse_px, dtype=np.float64)
        u, v = np.meshgrid(coarse_u, coarse_v)
        at = self.camera.on_plane(np.column_stack([u.ravel(), v.ravel()]), self.z_mm)
        places = ((at - self.origin_mm) / self.pitch_mm).reshape(*u.shape, 2).astype(np.float32)
        # A pixel's share of the way between two coarse ones is an eighth: exact in OpenCV.
        fine = np.array([[1 / GRID.coarse_px, 0, 0], [0, 1 / GRID.coarse_px, 0]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        maps = [
            cv2.warpAffine(np.ascontiguousarray(places[..., k]), fine, (width, height), flags=flags)
            for k in range(2)
        ]
        image = cv2.remap(
            drawn, maps[0], maps[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        return np.asarray(image).reshape(height, width, -1)


def _border(camera: Camera) -> FloatArray:
    """Pixels along the picture's rim."""
    width, height = camera.size_px
    u, v = np.linspace(-1, width, 65), np.linspace(-1, height, 65)
    along_x = [np.column_stack([u, np.full(65, edge)]) for edge in (-1.0, float(height))]
    along_y = [np.column_stack([np.full(65, edge), v]) for edge in (-1.0, float(width))]
    return np.concatenate([*along_x, *along_y])
