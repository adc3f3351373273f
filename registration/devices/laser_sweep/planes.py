"""Fit the planes of a swept laser's light; the laser's file."""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Annotated, Final, Literal, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, Field
from scipy.optimize import least_squares

from kernels.arrays import FloatArray
from registration.devices.camera_frame.frame import CameraFrame
from registration.devices.laser_sweep.profiles import FEWEST, Profile, Traced, straight_line
from registration.devices.lens.lens import read_model
from registration.errors import PictureError

_KEY: Final = "printctl_laser"
Number = Annotated[float, Field(allow_inf_nan=False)]


class LaserSweep(BaseModel):
    """A line laser on a pivot or stage.

    Attributes
    ----------
    made : datetime
    point : (x, y, z, w), mm and 1
        Through which all planes of light pass, printer's frame: x/w, y/w, z/w; with w 0 the
        direction in which they all run.
    flat_z_mm : float, mm
        Of the face that the sweep was fitted over.
    off_um : float, µm
        RMS of the heights told of that face, per picture.
    u_um : (at the face, 5 mm above), µm
        Standard uncertainty of a height, of one picture.
    frame : CameraFrame
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    printctl_laser: Literal[1] = 1
    made: datetime
    point: tuple[Number, Number, Number, Number]
    flat_z_mm: Number
    off_um: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    u_um: tuple[Number, Number]
    frame: CameraFrame

    def heights(self, ends: FloatArray, slopes: FloatArray) -> FloatArray:
        """Heights z (n,) at which rays meet a picture's plane of light, printer's frame, mm.

        Parameters
        ----------
        ends : (2, 3) float64, mm
            Two places of the laser's line on the insert.
        slopes : (n, 2) float64
            x and y per z of rays from the camera.
        """
        return heights_of(np.array(self.point), np.array(self.frame.eye_mm), ends, slopes)


def heights_of(
    point: FloatArray, eye: FloatArray, ends: FloatArray, slopes: FloatArray
) -> FloatArray:
    """Heights z (n,) at which rays meet the plane through two ends and a point (x, y, z, w), mm."""
    normal = np.cross(ends[1] - ends[0], point[:3] - point[3] * ends[0])
    down = normal @ (eye - ends[0])
    return np.asarray(eye[2] - down / (slopes @ normal[:2] + normal[2]))


def is_laser_file(path: Path) -> bool:
    """Whether a file is a laser's, which `read_laser` reads."""
    try:
        with path.open(encoding="utf-8") as file:
            return file.readline().startswith(_KEY)
    except (OSError, UnicodeDecodeError):
        return False


def read_laser(path: Path) -> LaserSweep:
    """Read a laser's file.

    Raises
    ------
    PictureError
        When the file is missing, or isn't one.
    """
    return read_model(path, LaserSweep, "laser", "printctl observe sweep")


_SIZE_MM: Final = 50.0
"""Unit of length in the fit, so that its four numbers are of one size."""
_FREE: Final = 1.0
"""Standard uncertainty, in that unit's homogeneous numbers, of the point along the lines."""
_U_MM: Final = 0.01
_LEAST_APART_MM: Final = 0.5
_LEAST_SHARE: Final = 0.3
"""Of the hole's width that the lines on the flat face must cover, each way."""
_MOST_OFF_MM: Final = 0.06
_FAR: Final = 5.0
"""Usual deviations from which a picture is left out."""
_ABOVE_MM: Final = 5.0


@dataclass(frozen=True)
class FittedSweep:
    """A laser, and how it was fitted.

    Attributes
    ----------
    laser : LaserSweep
    pictures : int
        With a line both on the insert and on the flat face, that agree.
    """

    laser: LaserSweep
    pictures: int


class _Pair(NamedTuple):
    """A picture's line on the insert (2, 3), and rays to ends and middle of that on the face."""

    ends: FloatArray
    slopes: FloatArray


def fit_laser(traced: Traced, frame: CameraFrame, flat_z_mm: float, now: datetime) -> FittedSweep:
    """Fit a laser's sweep over a flat face in the dish.

    Parameters
    ----------
    traced : Traced
    frame : CameraFrame
    flat_z_mm : float, mm
        Height of the face, printer's frame.
    now : datetime

    Raises
    ------
    PictureError
        When the height is no number, the face lies as high as the insert, is seen in too few
        pictures or places, or the planes share no point.
    """
    if not math.isfinite(flat_z_mm):
        raise PictureError(
            f"the flat face's height is {flat_z_mm} mm; touch the face with the needle and give "
            "its Z (--floor-z)"
        )
    apart = abs(flat_z_mm - frame.middle_mm[2])
    if apart < _LEAST_APART_MM:
        raise PictureError(
            f"the flat face at z {flat_z_mm:g} mm lies {apart:.2f} mm from the plate's face "
            f"({_LEAST_APART_MM:g} mm wanted), so it doesn't tell how the laser's plane leans; lay "
            "a plate of another thickness into the dish"
        )
    eye = np.array(frame.eye_mm)
    pairs = [pair for one in traced.profiles if (pair := _pair(one, eye, flat_z_mm))]
    if len(pairs) < FEWEST:
        raise PictureError(
            f"the line is straight on the flat face in {len(pairs)} of {traced.pictures} pictures "
            f"({FEWEST} wanted); sweep over something matt and flat that fills the dish"
        )
    _check_cover(pairs, eye, flat_z_mm, frame)
    fit = _Fit.of(pairs, eye, flat_z_mm)
    far = np.abs(fit.off_mm).max(axis=1)
    good = far < max(_FAR * float(np.median(far)), _U_MM)
    if 2 * good.sum() > len(pairs) and good.sum() >= FEWEST:
        pairs = [pair for pair, one in zip(pairs, good, strict=True) if one]
        fit = _Fit.of(pairs, eye, flat_z_mm)
    rms = float(np.sqrt(np.mean(fit.off_mm**2)))
    if rms > _MOST_OFF_MM:
        raise PictureError(
            f"the flat face is told {1e3 * rms:.0f} µm off its height ({1e3 * _MOST_OFF_MM:g} µm "
            "at most): the planes of light share no point. Let the laser turn about one axis or "
            "move along one line, and check that the face is flat and the laser fastened"
        )
    laser = LaserSweep(
        made=now,
        point=tuple(fit.point(fit.numbers).tolist()),
        flat_z_mm=flat_z_mm,
        off_um=1e3 * rms,
        u_um=(
            1e3 * fit.u_mm(pairs, flat_z_mm, rms),
            1e3 * fit.u_mm(pairs, flat_z_mm + _ABOVE_MM, rms * (1 + _ABOVE_MM / apart)),
        ),
        frame=frame,
    )
    return FittedSweep(laser, len(pairs))


def _pair(profile: Profile, eye: FloatArray, z_mm: float) -> _Pair | None:
    at = eye[:2] + (z_mm - eye[2]) * profile.slopes
    if len(at) < 2 * FEWEST:
        return None
    along = at @ (profile.ends[1] - profile.ends[0])[:2]
    line = straight_line(at, along < np.median(along), FEWEST)
    if line is None:
        return None
    places = np.array([line.ends[0], line.ends.mean(axis=0), line.ends[1]])
    return _Pair(profile.ends, (places - eye[:2]) / (z_mm - eye[2]))


def _check_cover(pairs: list[_Pair], eye: FloatArray, z_mm: float, frame: CameraFrame) -> None:
    """Refuse lines that lie in a small part of the dish: the rest would be extrapolated."""
    places = eye[:2] + (z_mm - eye[2]) * np.concatenate([pair.slopes for pair in pairs])
    x, y, _ = _mean_way(pairs)
    wide = np.ptp(places @ np.array([[x, -y], [y, x]]), axis=0)
    hole = min(frame.insert.hole_mm)
    if (wide < _LEAST_SHARE * hole).any():
        raise PictureError(
            f"the lines on the flat face are {wide[0]:.1f} mm long and cover {wide[1]:.1f} mm, in "
            f"a hole of {hole:g} mm ({_LEAST_SHARE:.0%} wanted of each); use a larger plate, and "
            "sweep farther"
        )


@dataclass(frozen=True)
class _Fit:
    """The shared point, in numbers of one size about the insert's middle.

    Attributes
    ----------
    numbers : (4,) float64
    covariance : (4, 4) float64
    middle, eye : (3,) float64, mm
    off_mm : (n, 3) float64, mm
        How far the flat face's heights are told off it.
    """

    numbers: FloatArray
    covariance: FloatArray
    middle: FloatArray
    eye: FloatArray
    off_mm: FloatArray

    @staticmethod
    def of(pairs: list[_Pair], eye: FloatArray, z_mm: float) -> _Fit:
        """Fit heights of the flat face, by Levenberg and Marquardt's method.

        Where the planes share more than a point (an axis; all directions of parallel planes), the
        one without a part along the lines is taken: a point on a line tells no plane.
        """
        middle = np.mean([pair.ends.mean(axis=0) for pair in pairs], axis=0)
        along = _mean_way(pairs)

        def off(numbers: FloatArray) -> FloatArray:
            point = _point(numbers, middle)
            each = np.array([heights_of(point, eye, *pair) - z_mm for pair in pairs])
            return np.clip(np.nan_to_num(each, nan=_SIZE_MM), -_SIZE_MM, _SIZE_MM)

        def weighed(numbers: FloatArray) -> FloatArray:
            length = float(np.linalg.norm(numbers))
            own = [float(numbers[:3] @ along) / length / _FREE, length - 1.0]
            return np.concatenate([off(numbers).ravel() / _U_MM, own])

        begin = _shared_point(pairs, eye, z_mm, middle, along)
        found = least_squares(weighed, begin, method="lm")
        each = off(found.x)
        # The three heights of a picture are wrong together.
        scale = max(1.0, 3 * float(np.mean(each**2)) / _U_MM**2)
        covariance = scale * np.linalg.inv(found.jac.T @ found.jac)
        return _Fit(found.x, covariance, middle, eye, each)

    def point(self, numbers: FloatArray) -> FloatArray:
        """Point (x, y, z, w), mm, of the fit's numbers."""
        return _point(numbers, self.middle)

    def u_mm(self, pairs: list[_Pair], z_mm: float, own_mm: float) -> float:
        """Standard uncertainty of a height near ``z_mm``, of one picture whose own is given, mm."""
        total, share = own_mm**2, 1.0 / len(pairs)
        sizes, ways = np.linalg.eigh(self.covariance)
        for ends, slopes in pairs:
            now = heights_of(self.point(self.numbers), self.eye, ends, slopes)
            # The same places of the dish, at the height that is asked for, by the same plane.
            moved = slopes * ((now - self.eye[2]) / (z_mm - self.eye[2]))[:, None]
            there = heights_of(self.point(self.numbers), self.eye, ends, moved)
            for size, way in zip(sizes, ways.T, strict=True):
                other = self.point(self.numbers + np.sqrt(max(size, 0.0)) * way)
                change = heights_of(other, self.eye, ends, moved) - there
                total += share * float(np.mean(change**2))
        return float(np.sqrt(total))


def _point(numbers: FloatArray, middle: FloatArray) -> FloatArray:
    own = numbers / np.linalg.norm(numbers)
    return np.append(_SIZE_MM * own[:3] + own[3] * middle, own[3])


def _mean_way(pairs: list[_Pair]) -> FloatArray:
    """Unit direction (3,) of the lines on the insert."""
    ways = np.array([pair.ends[1] - pair.ends[0] for pair in pairs])
    ways *= np.where(ways @ ways[0] < 0, -1.0, 1.0)[:, None]
    mean = ways.sum(axis=0)
    return np.asarray(mean / np.linalg.norm(mean))


def _shared_point(
    pairs: list[_Pair], eye: FloatArray, z_mm: float, middle: FloatArray, along: FloatArray
) -> FloatArray:
    """Numbers (4,) of about the point that the planes share, across the lines."""
    planes = np.empty((len(pairs), 4))
    for row, (ends, slopes) in zip(planes, pairs, strict=True):
        a, b = (ends - middle) / _SIZE_MM
        place = eye + (z_mm - eye[2]) * np.append(slopes[1], 1.0)
        normal = np.cross(b - a, (place - middle) / _SIZE_MM - a)
        row[:] = np.append(normal, -normal @ a) / np.linalg.norm(normal)
    free = np.linalg.svd(np.append(along, 0.0)[None])[2][1:]
    return np.asarray(np.linalg.svd(planes @ free.T)[2][-1] @ free)
