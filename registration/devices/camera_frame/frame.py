"""Camera frame class: pixels to printer coordinates and back, with uncertainty; file I/O."""

from __future__ import annotations

import math
from datetime import datetime
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from kernels.arrays import FloatArray
from registration.devices.camera_frame.insert import Insert
from registration.devices.camera_frame.projection import View, meet, project
from registration.devices.camera_frame.rotations import turned
from registration.devices.lens import Lens
from registration.devices.lens.model_file import read_model, write_model

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


def write_frame(path: Path, frame: CameraFrame) -> None:
    """Write a frame that `read_frame` reads back exactly.

    Raises
    ------
    OSError
        When the disk is full or the folder can't be written.
    """
    write_model(path, frame)


def read_frame(path: Path) -> CameraFrame:
    """Read a frame.

    Raises
    ------
    PictureError
        When the file is missing, or isn't one.
    """
    return read_model(path, CameraFrame, "frame", "printctl observe frame")
