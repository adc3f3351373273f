"""Correct OCT voxel positions for beam fan, bow, depth scale and refraction."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from kernels.arrays import FloatArray
from registration.devices.optics.surface import SampleSurface
from registration.errors import RegistrationError
from registration.scan import Scan
from registration.wall_reference import WallCalibration


def refract(direction: FloatArray, normal: FloatArray, index: float) -> FloatArray:
    """Unit directions of light that enters a medium from air.

    Vector form of Snell's law: with c = -n·d, r = 1/index, d' = r d + (r c - √(1 - r²(1 - c²))) n.

    Parameters
    ----------
    direction : (..., 3) float64
        Unit directions in air.
    normal : (..., 3) float64
        Unit normals of the surface, towards the air.
    index : float
        Of the medium over that of air.

    Returns
    -------
    (..., 3) float64
        Unit directions in the medium.
    """
    ratio = 1 / index
    cosine = -np.sum(direction * normal, axis=-1, keepdims=True)
    inside = np.sqrt(1 - ratio**2 * (1 - cosine**2))
    bent: FloatArray = ratio * direction + (ratio * cosine - inside) * normal
    return bent


def refraction_bound(tilt_deg: float, depth_mm: float, index: float) -> tuple[float, float]:
    """How far a point lies from where a straight vertical ray would put it.

    Below a flat surface tilted by θ light runs at δ = θ - asin(sin θ / n) from the vertical, so
    that a geometric path ℓ ends ℓ sin δ aside and ℓ (1 - cos δ) too high (Westphal et al. 2002,
    Opt. Express 10, 397).

    Parameters
    ----------
    tilt_deg : float, degrees
        Of the surface, below 90.
    depth_mm : float, mm
        Geometric path below the surface.
    index : float
        Of the sample.

    Returns
    -------
    aside, up : float, mm

    Raises
    ------
    RegistrationError
        When tilt or index is impossible.
    """
    if not (0 <= tilt_deg < 90 and index >= 1):
        raise RegistrationError(
            f"tilt {tilt_deg:g}° must lie in 0 to 90 and index {index:g} be at least 1"
        )
    tilt = math.radians(tilt_deg)
    turned = tilt - math.asin(math.sin(tilt) / index)
    return depth_mm * math.sin(turned), depth_mm * (1 - math.cos(turned))


COVERAGE = 1.96
"""Standard uncertainties in half of a 95 % interval."""
_STEEPEST = 0.3
_ROUNDS = 30
_CLOSE_MM = 1e-6
_STEP_MM = 1e-3


@dataclass(frozen=True)
class OctCalibration:
    """What targets have shown of an OCT device; the default changes nothing.

    Attributes
    ----------
    lateral : ((float, float), (float, float))
        M: true mm for mm of the scan's x and y; its lower left is 0 (a rotation is the pose's).
    fan_per_mm : (float, float), 1/mm
        f: slope of the beam for a mm of x, y.
    bow_per_mm : (float, float, float), 1/mm
        q: xx, xy, yy.
    depth_scale : float
        k: true path for the path that the file says.
    refractive_index : float or None
        Group index of the medium, where a step was measured in it.
    depth_standard : bool
        Whether a step of known height in the medium stands behind the depth. One in air doesn't
        do: the medium's index still is an assumption.
    intervals : mapping of str to (low, high)
        95 % of each measured number.
    walls : WallCalibration or None
        What a reference has shown of walls; no part of the beam.
    """

    lateral: tuple[tuple[float, float], tuple[float, float]] = ((1.0, 0.0), (0.0, 1.0))
    fan_per_mm: tuple[float, float] = (0.0, 0.0)
    bow_per_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    depth_scale: float = 1.0
    refractive_index: float | None = None
    depth_standard: bool = False
    intervals: dict[str, tuple[float, float]] = field(default_factory=dict)
    walls: WallCalibration | None = None

    def relative_error(self, *names: str) -> float | None:
        """Largest relative standard uncertainty of some measured numbers; None if not measured."""
        known = [self.intervals[name] for name in names if name in self.intervals]
        if not known:
            return None
        return max(abs(high - low) / (2 * COVERAGE) / (abs(high + low) / 2) for low, high in known)


@dataclass(frozen=True)
class Beam:
    """The way of light through one scan.

    Attributes
    ----------
    calibration : OctCalibration
        Of the device.
    middle_mm : (2,) float64, mm
        Middle of the field in the scan's frame.
    index : float
        Group index of the sample.
    surface : SampleSurface or None
        Where the sample begins under air; None where its medium fills the view.
    """

    calibration: OctCalibration
    middle_mm: FloatArray
    index: float
    surface: SampleSurface | None = None

    @staticmethod
    def of(scan: Scan, calibration: OctCalibration, surface: SampleSurface | None = None) -> Beam:
        """The beam of a scan whose field is centred on the optical axis."""
        _, ny, nx = scan.volume.shape
        _, dy, dx = scan.voxel_mm
        middle = np.array([(nx - 1) / 2 * dx, (ny - 1) / 2 * dy])
        return Beam(calibration, middle, scan.refractive_index, surface)

    def to_true(self, points: FloatArray) -> FloatArray:
        """True positions of scan positions; both (n, 3), mm, the latter's z optical path.

        Raises
        ------
        RegistrationError
            When fan or surface is steeper than this model holds.
        """
        u = points[:, :2] - self.middle_mm
        start, direction = self._launch(u)
        if self.surface is None:
            path = self._path(u, points[:, 2]) / self.index
            return self._placed(start + direction * path[:, None])
        upper = self.surface.depth_mm(points[:, 0], points[:, 1])
        air = self._path(u, np.minimum(points[:, 2], upper))
        entry = start + direction * air[:, None]
        below = self.calibration.depth_scale * np.maximum(points[:, 2] - upper, 0) / self.index
        bent = refract(direction, self._normals(points[:, :2], self.surface), self.index)
        return self._placed(entry + bent * below[:, None])

    def to_scan(self, points: FloatArray) -> FloatArray:
        """Scan positions (z optical path) of true positions; both (n, 3), mm.

        Raises
        ------
        RegistrationError
            When fan or surface is steeper than this model holds.
        """
        places = points[:, :2].copy()
        positions = np.empty_like(points)
        for _ in range(_ROUNDS):
            positions = np.column_stack([places, self._depth_at(places, points[:, 2])])
            off = points[:, :2] - self.to_true(positions)[:, :2]
            places = places + off
            if np.abs(off).max(initial=0.0) < _CLOSE_MM:
                return positions
        raise RegistrationError(
            f"the correction doesn't settle (still {np.abs(off).max():.2g} mm off): fan or surface "
            "is too steep; level the sample or check the calibration"
        )

    def _depth_at(self, places: FloatArray, height: FloatArray) -> FloatArray:
        """Optical path at which the beam of scan positions reaches a true depth."""
        u = places - self.middle_mm
        start, direction = self._launch(u)
        scale, bow = self.calibration.depth_scale, self._path(u, np.zeros(len(u)))
        along = (height - start[:, 2]) / direction[:, 2]
        if self.surface is None:
            return (along * self.index - bow) / scale
        upper = self.surface.depth_mm(places[:, 0], places[:, 1])
        air = self._path(u, upper)
        bent = refract(direction, self._normals(places, self.surface), self.index)
        below = (height - start[:, 2] - direction[:, 2] * air) / bent[:, 2]
        return np.where(below > 0, upper + below * self.index / scale, (along - bow) / scale)

    def _launch(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Where the beams leave the plane z = 0, and their unit directions."""
        slope = u * np.array(self.calibration.fan_per_mm)
        if np.abs(slope).max(initial=0.0) > _STEEPEST:
            raise RegistrationError(
                f"the beam's slope reaches {np.abs(slope).max():.2g} (limit {_STEEPEST}); check "
                "fan_per_mm of the calibration"
            )
        if self.surface is None:
            slope = slope / self.index
        direction = np.column_stack([slope, np.ones(len(u))])
        direction /= np.linalg.norm(direction, axis=1)[:, None]
        start = np.column_stack([u @ np.array(self.calibration.lateral).T, np.zeros(len(u))])
        return start, direction

    def _path(self, u: FloatArray, z: FloatArray) -> FloatArray:
        xx, xy, yy = self.calibration.bow_per_mm
        x, y = u.T
        return np.asarray(self.calibration.depth_scale * z + xx * x * x + xy * x * y + yy * y * y)

    def _normals(self, places: FloatArray, surface: SampleSurface) -> FloatArray:
        """Unit normals of the true surface, towards the air, from its entry points."""
        here, along_x, along_y = (
            self._entry(places + np.array(step), surface)
            for step in ((0.0, 0.0), (_STEP_MM, 0.0), (0.0, _STEP_MM))
        )
        normal = -np.cross(along_x - here, along_y - here)
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        if len(normal) and float(-normal[:, 2].max()) < np.cos(np.arctan(2 * _STEEPEST)):
            raise RegistrationError(
                "the sample's surface is steeper than 31° somewhere; level it, or leave out "
                "--air-above"
            )
        return normal

    def _entry(self, places: FloatArray, surface: SampleSurface) -> FloatArray:
        u = places - self.middle_mm
        start, direction = self._launch(u)
        path = self._path(u, surface.depth_mm(places[:, 0], places[:, 1]))
        return start + direction * path[:, None]

    def _placed(self, points: FloatArray) -> FloatArray:
        points[:, :2] += self.middle_mm
        return points
