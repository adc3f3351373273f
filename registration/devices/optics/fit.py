"""Calibrate an OCT device from scans of a dot grid and of a step."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import stdtrit

from kernels.arrays import FloatArray
from registration.devices.optics.beam import COVERAGE, Beam, OctCalibration
from registration.devices.optics.targets import GridView, Step
from registration.errors import SegmentationError

_NAMES = ("scale_x", "shear", "scale_y", "bow_xx", "bow_xy", "bow_yy", "fan_x", "fan_y")
_WITHOUT_FAN = 6
_FAN_SPAN_MM = 0.5


@dataclass(frozen=True)
class GridFit:
    """Calibration found from a dot grid.

    Attributes
    ----------
    calibration : OctCalibration
        With lateral scale, bow and, where it could be told, fan.
    lateral_um, depth_um : float, µm
        RMS of what is left, in the plane and along depth.
    before_um : float, µm
        RMS of the whole misfit with nothing corrected but the pose of the target.
    dots : int
        How many were used.
    fan_known : bool
        Whether the target stood at two heights at least 0.5 mm apart.
    """

    calibration: OctCalibration
    lateral_um: float
    depth_um: float
    before_um: float
    dots: int
    fan_known: bool


def fit_grid(
    views: Sequence[GridView],
    pitch_mm: float,
    start: OctCalibration | None = None,
    pitch_u_mm: float = 0.0,
) -> GridFit:
    """Least squares of dots against a flat square lattice, its pose free in every view.

    The scans are taken in air. 95 % intervals are those of linear least squares with Student's t.

    Parameters
    ----------
    views : sequence of GridView
        At least one; the fan needs two at different heights.
    pitch_mm : float, mm
        Of the lattice.
    start : OctCalibration or None
        Whose depth scale holds (from a step).
    pitch_u_mm : float, mm
        Expanded uncertainty (k = 2) of the pitch by the target's certificate; it goes into the
        intervals of the lateral scales.

    Raises
    ------
    SegmentationError
        When there is no view.
    """
    # Every registration loads this room; only a calibration waits for optimisers to load.
    from scipy.optimize import least_squares

    if not views:
        raise SegmentationError("no view of a grid; give at least one scan of it")
    base = start or OctCalibration()
    heights = [float(np.median(view.points[:, 2])) for view in views]
    fan_known = max(heights) - min(heights) >= _FAN_SPAN_MM
    count = len(_NAMES) if fan_known else _WITHOUT_FAN
    poses = np.concatenate([_first_pose(view, pitch_mm) for view in views])

    def misfit(values: FloatArray, fixed: int) -> FloatArray:
        shape = np.concatenate([values[:fixed], _identity()[fixed:]])
        return _residuals(shape, values[fixed:], views, pitch_mm, base)

    plain = least_squares(misfit, poses, args=(0,), x_scale="jac")
    first = np.concatenate([_identity()[:count], plain.x])
    best = least_squares(misfit, first, args=(count,), x_scale="jac")
    left = best.fun.reshape(-1, 3)
    calibration = _calibration(np.concatenate([best.x[:count], _identity()[count:]]), base)
    return GridFit(
        replace(
            calibration,
            intervals={
                **{name: pair for name, pair in base.intervals.items() if name not in _NAMES},
                **_certified(_intervals(best, count), pitch_u_mm / pitch_mm),
            },
        ),
        float(1e3 * np.sqrt(np.mean(np.sum(left[:, :2] ** 2, axis=1)))),
        float(1e3 * np.sqrt(np.mean(left[:, 2] ** 2))),
        float(1e3 * np.sqrt(np.mean(np.sum(plain.fun.reshape(-1, 3) ** 2, axis=1)))),
        len(left),
        fan_known,
    )


def with_step(
    base: OctCalibration,
    step: Step,
    height_mm: float,
    *,
    immersed: bool,
    height_u_mm: float = 0.0,
) -> OctCalibration:
    """The calibration with what a step of known height says of depth.

    In air the true height over the path is the depth scale; in a medium the (scaled) path over
    the height is its group index. The expanded uncertainty (k = 2) of the height by the step's
    certificate goes into the interval.

    Raises
    ------
    SegmentationError
        When the result is impossible: the wrong height, or the wrong medium.
    """
    relative = COVERAGE * math.hypot(step.error_mm / step.path_mm, height_u_mm / 2 / height_mm)
    value = base.depth_scale * step.path_mm / height_mm if immersed else height_mm / step.path_mm
    low, high = (1.0, 2.0) if immersed else (0.8, 1.25)
    if not low <= value <= high:
        raise SegmentationError(
            f"a path of {step.path_mm:.4g} mm for a step of {height_mm:g} mm makes "
            f"{'an index' if immersed else 'a depth scale'} of {value:.3g} (plausible: {low:g} to "
            f"{high:g}); check --height-um and whether it stood in air or medium"
        )
    interval = (value * (1 - relative), value * (1 + relative))
    if not immersed and base.refractive_index is not None:
        # A step in the medium has told scale over index alone.
        base = _with_index(base, base.refractive_index, value / base.depth_scale)
    name = "refractive_index" if immersed else "depth_scale"
    return replace(
        base,
        depth_scale=base.depth_scale if immersed else value,
        refractive_index=value if immersed else base.refractive_index,
        depth_standard=base.depth_standard or immersed,
        intervals={**base.intervals, name: interval},
    )


def _with_index(base: OctCalibration, index: float, factor: float) -> OctCalibration:
    name = "refractive_index"
    low, high = base.intervals.get(name, (index, index))
    intervals = {**base.intervals, name: (low * factor, high * factor)}
    return replace(base, refractive_index=index * factor, intervals=intervals)


def _identity() -> FloatArray:
    return np.array([1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0])


def _calibration(shape: FloatArray, base: OctCalibration) -> OctCalibration:
    scale_x, shear, scale_y, xx, xy, yy, fan_x, fan_y = (float(value) for value in shape)
    return replace(
        base,
        lateral=((scale_x, shear), (0.0, scale_y)),
        bow_per_mm=(xx, xy, yy),
        fan_per_mm=(fan_x, fan_y),
    )


def _residuals(
    shape: FloatArray,
    poses: FloatArray,
    views: Sequence[GridView],
    pitch_mm: float,
    base: OctCalibration,
) -> FloatArray:
    """True dots less the posed lattice, flattened."""
    off = []
    for view, pose in zip(views, poses.reshape(-1, 6), strict=True):
        true = Beam(_calibration(shape, base), view.middle_mm, 1.0).to_true(view.points)
        lattice = np.column_stack([view.index * pitch_mm, np.zeros(len(view.index))])
        off.append(true - Rotation.from_rotvec(pose[:3]).apply(lattice) - pose[3:])
    return np.concatenate(off).ravel()


def _first_pose(view: GridView, pitch_mm: float) -> FloatArray:
    """Turn in the plane and middle, from the dots themselves."""
    middle = view.points.mean(axis=0)
    lattice = view.index * pitch_mm
    centred = lattice - lattice.mean(axis=0)
    cross = centred.T @ (view.points[:, :2] - middle[:2])
    turn = float(np.arctan2(cross[0, 1] - cross[1, 0], cross[0, 0] + cross[1, 1]))
    place = Rotation.from_rotvec([0, 0, turn]).apply([*lattice.mean(axis=0), 0.0])
    return np.concatenate([[0, 0, turn], middle - place])


def _certified(
    intervals: dict[str, tuple[float, float]], relative_u: float
) -> dict[str, tuple[float, float]]:
    """Intervals with a certificate's relative expanded uncertainty (k = 2) put to the scales'."""
    made = dict(intervals)
    for name in ("scale_x", "scale_y"):
        if name in made:
            low, high = made[name]
            middle = (low + high) / 2
            half = math.hypot((high - low) / 2, COVERAGE * relative_u / 2 * middle)
            made[name] = (middle - half, middle + half)
    return made


def _intervals(best: object, count: int) -> dict[str, tuple[float, float]]:
    """95 % of the shape's parameters, from the Jacobian at the best fit."""
    jacobian, left, values = best.jac, best.fun, best.x  # type: ignore[attr-defined]
    free = max(1, len(left) - len(values))
    spread = np.sqrt(np.diag(np.linalg.pinv(jacobian.T @ jacobian)) * (left @ left) / free)
    half = stdtrit(free, 0.975) * spread
    return {
        name: (float(values[i] - half[i]), float(values[i] + half[i]))
        for i, name in enumerate(_NAMES[:count])
    }
