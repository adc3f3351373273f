"""Camera frame: pixels to printer coordinates and back, with uncertainty."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Annotated, Final, Literal

import cv2
import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from kernels.arrays import FloatArray
from registration.devices.camera_frame.insert import Insert
from registration.devices.lens import Lens
from registration.devices.lens.lens import read_model


def turned(vector: Sequence[float] | FloatArray) -> FloatArray:
    """Rotation matrix (3, 3) of a rotation vector (3,), rad."""
    return np.asarray(cv2.Rodrigues(np.asarray(vector, dtype=np.float64))[0])


def turn_vector(matrix: FloatArray) -> FloatArray:
    """Rotation vector (3,), rad, of a rotation matrix (3, 3)."""
    return np.asarray(cv2.Rodrigues(np.asarray(matrix, dtype=np.float64))[0]).ravel()


_ROUNDS: Final = 30
_SMALL: Final = 1e-12


@dataclass(frozen=True, eq=False)
class View:
    """A camera over the printer, as numbers that are cheap to vary.

    Attributes
    ----------
    lens : (8,) float64
        As `registration.devices.lens.Lens.numbers`.
    turn : (3, 3) float64
        From the printer's axes to the camera's (x right, y down, z ahead).
    eye_mm : (3,) float64, mm
        The camera's centre, printer's frame.
    surface_z_mm : float, mm, or None
        Of the bath; None for air all over.
    index : float
        Refractive, of the bath.
    """

    lens: FloatArray
    turn: FloatArray
    eye_mm: FloatArray
    surface_z_mm: float | None = None
    index: float = 1.0


def bend(flat: FloatArray, lens: FloatArray) -> FloatArray:
    """Distort places (n, 2) over the focal length (Brown 1971; the terms of `Lens`)."""
    k1, k2, p1, p2, k3 = lens[3:8]
    x, y = flat[:, 0], flat[:, 1]
    square = x * x + y * y
    radial = 1 + square * (k1 + square * (k2 + square * k3))
    return np.column_stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x),
            y * radial + p1 * (square + 2 * y * y) + 2 * p2 * x * y,
        ]
    )


def unbend(seen: FloatArray, lens: FloatArray) -> FloatArray:
    """Inverse of `bend`, by Newton's method."""
    k1, k2, p1, p2, k3 = lens[3:8]
    flat = seen.copy()
    for _ in range(_ROUNDS):
        x, y = flat[:, 0], flat[:, 1]
        square = x * x + y * y
        radial = 1 + square * (k1 + square * (k2 + square * k3))
        slope = k1 + square * (2 * k2 + square * 3 * k3)  # of radial by square
        xx = radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x
        xy = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
        yy = radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x
        off = bend(flat, lens) - seen
        area = xx * yy - xy * xy
        step = (
            np.column_stack([yy * off[:, 0] - xy * off[:, 1], xx * off[:, 1] - xy * off[:, 0]])
            / np.where(np.abs(area) > _SMALL, area, 1.0)[:, None]
        )
        flat = flat - np.clip(step, -0.1, 0.1)
        if not len(step) or np.abs(step).max() < _SMALL:
            break
    return flat


def project(view: View, points_mm: FloatArray) -> FloatArray:
    """Pixels (n, 2) of places (n, 3), printer's frame; NaN behind the camera."""
    aim = _aims(view, points_mm)
    seen = (aim - view.eye_mm) @ view.turn.T
    ahead = np.where(seen[:, 2:] > _SMALL, seen[:, 2:], np.nan)
    return bend(seen[:, :2] / ahead, view.lens) * view.lens[0] + view.lens[1:3]


def rays(view: View, pixels: FloatArray) -> FloatArray:
    """Directions (n, 3) in air, printer's axes, not of unit length."""
    flat = unbend((np.asarray(pixels, np.float64) - view.lens[1:3]) / view.lens[0], view.lens)
    return np.column_stack([flat, np.ones(len(flat))]) @ view.turn


def meet(view: View, pixels: FloatArray, z_mm: float | FloatArray) -> FloatArray:
    """Places (n, 2) at a height that pixels (n, 2) show; NaN where a ray never comes there.

    Notes
    -----
    Below the bath's surface a ray goes on by Snell's law: sin i = index × sin r.
    """
    way = rays(view, pixels)
    way = np.where(way[:, 2:] < 0, way, np.nan)
    z = np.broadcast_to(np.asarray(z_mm, np.float64), len(way))
    top = z if view.surface_z_mm is None else np.maximum(z, view.surface_z_mm)
    reach = (top - view.eye_mm[2]) / way[:, 2]
    at: FloatArray = view.eye_mm[:2] + reach[:, None] * way[:, :2]
    if view.surface_z_mm is not None:
        sine = way[:, :2] / np.linalg.norm(way, axis=1)[:, None] / view.index
        at += (top - z)[:, None] * sine / np.sqrt(1 - (sine**2).sum(axis=1))[:, None]
    return at


def _aims(view: View, points_mm: FloatArray) -> FloatArray:
    """Where the straight way from the camera to each place leads: itself, or through the surface.

    The ray meets the surface at the distance a from the point below the eye where
    a / √(a² + H²) = index (D - a) / √((D - a)² + h²) (Snell), found by Newton's method.
    """
    points = np.asarray(points_mm, dtype=np.float64).reshape(-1, 3)
    if view.surface_z_mm is None or view.index == 1.0:
        return points
    depth = np.maximum(view.surface_z_mm - points[:, 2], 0.0)
    height = view.eye_mm[2] - view.surface_z_mm
    aside = points[:, :2] - view.eye_mm[:2]
    far = np.linalg.norm(aside, axis=1)
    a = far * height / (height + depth / view.index)
    for _ in range(_ROUNDS):
        rest = far - a
        above, below = np.hypot(a, height), np.hypot(rest, depth) + _SMALL
        off = a / above - view.index * rest / below
        slope = height**2 / above**3 + view.index * depth**2 / below**3
        step = np.where(depth > 0, off / slope, 0.0)
        a = np.clip(a - step, 0.0, far)
        if not len(step) or np.abs(step).max() < _SMALL:
            break
    share = np.where(far > 0, a / np.where(far > 0, far, 1.0), 1.0)
    on_top = view.eye_mm[:2] + aside * share[:, None]
    under = depth > 0
    aims = points.copy()
    aims[under, :2] = on_top[under]
    aims[under, 2] = view.surface_z_mm
    return aims


Number = Annotated[float, Field(allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Three = tuple[Number, Number, Number]


class SeenAtFit(BaseModel):
    """Marks as the pictures of the fit showed them; what a later picture is compared with.

    Attributes
    ----------
    numbers : tuple of int
        Of the marks.
    corners_px : tuple of 8 floats each
        u, v of the four corners.
    u_px : float
        Standard uncertainty of a corner along each axis.
    blur_px, black, white, gamma : float
        As `SeenMarks`.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    numbers: tuple[int, ...]
    corners_px: tuple[tuple[Number, ...], ...]
    u_px: NotNegative
    blur_px: NotNegative
    black: Number
    white: Number
    gamma: Annotated[float, Field(gt=0.0, lt=5.0)] = 1.0

    @property
    def corners(self) -> FloatArray:
        """Corners (n, 4, 2) px."""
        return np.array(self.corners_px, dtype=np.float64).reshape(-1, 4, 2)


class Bath(BaseModel):
    """A flat surface of bath above the ink, through which the camera looks."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    surface_z_mm: Number
    index: Annotated[float, Field(ge=1, le=2)] = 1.333
    u_surface_mm: NotNegative = 0.1
    u_index: NotNegative = 0.003


class CameraFrame(BaseModel):
    """A camera over the printer.

    Attributes
    ----------
    made : datetime
        When the pictures were taken.
    tied : insert, touched or printed
        Whose frame it is: the insert's own, or the printer's by touched crosses or printed lines.
    lens : Lens
        As fitted together with the pose.
    turn_vector : (x, y, z), rad
        From the printer's axes to the camera's (x right, y down, z ahead), a rotation vector.
    eye_mm : (x, y, z), mm
        The camera's centre.
    covariance : (14, 14)
        Of a turn about the printer's axes, the eye, and the lens' numbers.
    middle_mm : (x, y, z), mm
        Of the insert, at its marks.
    insert : Insert
        As drawn; its hole is the field that the frame is for.
    marks_z_slope : (x, y)
        Rise of the marks' plane along x and y.
    seen : SeenAtFit
    off_px : float
        RMS of the corners about the fit.
    insert_scale : float
        Made over drawn.
    bath : Bath, optional
        None: what is looked at lies in air.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    printctl_frame: Literal[1] = 1
    made: datetime
    tied: Literal["insert", "touched", "printed"]
    lens: Lens
    turn_vector: Three
    eye_mm: Three
    covariance: Annotated[
        tuple[Annotated[tuple[Number, ...], Field(min_length=14, max_length=14)], ...],
        Field(min_length=14, max_length=14),
    ]
    middle_mm: Three
    insert: Insert
    marks_z_slope: tuple[Number, Number]
    seen: SeenAtFit
    off_px: NotNegative
    insert_scale: Number
    bath: Bath | None = None

    @property
    def view(self) -> View:
        """The numbers that project."""
        bath = () if self.bath is None else (self.bath.surface_z_mm, self.bath.index)
        return View(self.lens.numbers, turned(self.turn_vector), np.array(self.eye_mm), *bath)

    def to_pixels(self, points_mm: FloatArray) -> FloatArray:
        """Pixels (n, 2) of places (n, 3) mm, printer's frame; (0, 0) is the first pixel's middle.

        NaN for places behind the camera. What lies out of the picture gets pixels out of it.
        """
        return project(self.view, points_mm)

    def to_printer(self, pixels: FloatArray, z_mm: float) -> FloatArray:
        """Places (n, 2) mm, printer's frame, at a height that pixels (n, 2) show.

        NaN where a pixel looks past that plane.
        """
        return meet(self.view, pixels, z_mm)

    @property
    def um_per_px(self) -> float:
        """Root of a pixel's area at the dish's middle, at the marks' height, µm."""
        middle = self.to_pixels(np.array([self.middle_mm]))
        a, b, c = self.to_printer(
            middle + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), self.middle_mm[2]
        )
        (x0, y0), (x1, y1) = b - a, c - a
        return float(1e3 * math.sqrt(abs(x0 * y1 - y0 * x1)))

    @property
    def u_mm(self) -> float:
        """Standard uncertainty of `to_printer` along its worst axis, root mean square in the dish.

        At the marks' height, without that of the pixel itself.
        """
        return float(np.sqrt((self.spread_mm(self.field()) ** 2).mean()))

    def field(self) -> FloatArray:
        """Pixels (n, 2) of places all over the dish, at the marks' height."""
        x, y = np.meshgrid(*(np.linspace(-0.46, 0.46, 7) * side for side in self.insert.hole_mm))
        flat = np.column_stack([x.ravel(), y.ravel()])
        inside = np.hypot(*(flat / np.array(self.insert.hole_mm)).T) < 0.5
        places = np.column_stack([flat, np.zeros(len(flat))])[inside] + self.middle_mm
        return self.to_pixels(places)

    def spread_mm(self, pixels: FloatArray, z_mm: float | None = None) -> FloatArray:
        """Standard uncertainty of `to_printer` along its worst axis, (n,) mm."""
        covariance = self.covariance_mm2(pixels, self.middle_mm[2] if z_mm is None else z_mm)
        return np.asarray(np.sqrt(np.linalg.eigvalsh(covariance)[:, -1]))

    def covariance_mm2(
        self, pixels: FloatArray, z_mm: float, u_px: float = 0.0, u_z_mm: float = 0.0
    ) -> FloatArray:
        """Covariance (n, 2, 2) mm² of `to_printer`.

        Parameters
        ----------
        pixels : (n, 2) float64
        z_mm : float, mm
        u_px, u_z_mm : float
            Standard uncertainties of the pixels along each axis, and of the height.
        """
        pixels = np.asarray(pixels, dtype=np.float64)
        slopes = self.slopes(pixels, z_mm)
        known = np.array(self.covariance)
        covariance: FloatArray = np.einsum("nik,kl,njl->nij", slopes, known, slopes)
        at = self.to_printer(pixels, z_mm)
        for step in np.eye(2):
            slope = (self.to_printer(pixels + 0.01 * step, z_mm) - at) / 0.01
            covariance += u_px**2 * slope[:, :, None] * slope[:, None]
        slope = (self.to_printer(pixels, z_mm + 1e-3) - at) / 1e-3
        covariance += u_z_mm**2 * slope[:, :, None] * slope[:, None]
        return covariance + self._by_bath(pixels, z_mm, at)

    def slopes(self, pixels: FloatArray, z_mm: float) -> FloatArray:
        """How `to_printer` changes with the numbers of `covariance`, (n, 2, 14)."""
        view, at = self.view, self.to_printer(pixels, z_mm)
        slopes = np.empty((len(at), 2, 14))
        sizes = np.sqrt(np.maximum(np.diag(np.array(self.covariance)), 1e-24))
        for n, size in enumerate(sizes):
            step = max(0.01 * float(size), 1e-9)
            moved = varied(view, n, step)
            slopes[:, :, n] = (meet(moved, pixels, z_mm) - at) / step
        return slopes

    def _by_bath(self, pixels: FloatArray, z_mm: float, at: FloatArray) -> FloatArray:
        """What the bath's surface and index add to the covariance, (n, 2, 2) mm²."""
        covariance = np.zeros((len(at), 2, 2))
        if self.bath is None:
            return covariance
        view, bath = self.view, self.bath
        for up, more, sure in ((1e-3, 0.0, bath.u_surface_mm), (0.0, 1e-4, bath.u_index)):
            moved = View(
                view.lens, view.turn, view.eye_mm, bath.surface_z_mm + up, bath.index + more
            )
            slope = (meet(moved, pixels, z_mm) - at) / (up + more)
            covariance += sure**2 * slope[:, :, None] * slope[:, None]
        return covariance

    def under(self, bath: Bath | None) -> CameraFrame:
        """The same camera, looking through a bath's surface, or none."""
        return self.model_copy(update={"bath": bath})

    def age_days(self, now: datetime) -> float:
        """Since the pictures were taken."""
        return (now - self.made).total_seconds() / 86400


def varied(view: View, number: int, step: float) -> View:
    """The view with one number of the covariance's 14 changed."""
    if number < 3:
        vector = np.zeros(3)
        vector[number] = step
        return View(view.lens, view.turn @ turned(vector).T, view.eye_mm, *_through(view))
    if number < 6:
        eye = view.eye_mm.copy()
        eye[number - 3] += step
        return View(view.lens, view.turn, eye, *_through(view))
    lens = view.lens.copy()
    lens[number - 6] += step
    return View(lens, view.turn, view.eye_mm, *_through(view))


def _through(view: View) -> tuple[float | None, float]:
    return view.surface_z_mm, view.index


def read_frame(path: Path) -> CameraFrame:
    """Read a frame.

    Raises
    ------
    PictureError
        When the file is missing, or isn't one.
    """
    return read_model(path, CameraFrame, "frame", "printctl observe frame")
