"""Fit camera, dish insert and its printing errors in one bundle adjustment."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.special import chdtrc

from kernels.arrays import FloatArray
from registration.devices.camera_frame.frame import View, project, turned
from registration.devices.camera_frame.insert import Insert
from registration.devices.camera_frame.marks import SeenMarks
from registration.errors import PictureError


@dataclass(frozen=True)
class Touch:
    """A cross of the insert that the needle's tip touched.

    Attributes
    ----------
    name : str
        Of the cross.
    x_mm, y_mm : float, mm
        The printer's position with the tip on the cross.
    z_mm : float, mm, or None
        With the tip on the plate; None where it wasn't lowered that far.
    u_mm : float, mm
        Standard uncertainty of each.
    """

    name: str
    x_mm: float
    y_mm: float
    z_mm: float | None = None
    u_mm: float = 0.05


@dataclass(frozen=True, eq=False)
class PrintedPoints:
    """Places that the printer itself drew, as a picture shows them.

    Attributes
    ----------
    places_mm : (n, 3) float64, mm
        By the G-code, printer's frame.
    pixels : (n, 2) float64
    u_mm : (n,) float64, mm
        Standard uncertainty of each along each axis: how well ink lies where the motors went, and
        is measured in the picture.
    common_u_mm : float, mm
        Of what all of them share: the drawing as a whole against the printer's axes.
    """

    places_mm: FloatArray
    pixels: FloatArray
    u_mm: FloatArray
    common_u_mm: float = 0.0


@dataclass(frozen=True)
class Placement:
    """Where the insert lies, as far as it is known beforehand.

    Attributes
    ----------
    origin_mm : (x, y, z), mm
        Of the insert's middle, at the marks' height; printer's frame.
    turned_rad : float
        Of the insert about z, anticlockwise from above.
    u_xy_mm, u_z_mm, u_turned_rad : float
        Standard uncertainties; 0 where these numbers define the frame.
    u_tilt_rad : float
        Of the plate against the printer's plane, about each axis.
    """

    origin_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turned_rad: float = 0.0
    u_xy_mm: float = 0.0
    u_z_mm: float = 0.0
    u_turned_rad: float = 0.0
    u_tilt_rad: float = 0.0


_POSE: Final = slice(0, 6)
_LENS: Final = slice(6, 14)
_PLACED: Final = slice(14, 20)
_SCALE: Final = 20
_GROWN: Final = 21
_SQUARE: Final = slice(22, 24)
_BENT: Final = slice(24, 27)
_OFF: Final = 27
_FIXED: Final = 1e-7
"""Standard uncertainty of what defines the frame."""
_U_GROWN: Final = 0.05
"""Of how much larger marks look, of their size."""
_STEP: Final = 1e-6
"""Of a difference, of the change of an unknown that matters."""
_REST: Final = 1e-10
"""Relative gain of the cost below which it has come to rest."""
_MAX_TRIALS: Final = 200
_MAX_CONDITION: Final = 1e15
"""Of the normal matrix in changes that matter: beyond, an unknown isn't determined."""


class Start(NamedTuple):
    """Camera to begin with: turn (3, 3) and eye (3,) mm, both in the printer's frame."""

    turn: FloatArray
    eye_mm: FloatArray


@dataclass(frozen=True, eq=False)
class Bundle:
    """What is fitted to what.

    Attributes
    ----------
    insert : Insert
    marks : SeenMarks
    lens : (8,) float64
        As `Lens.numbers`, by its board.
    lens_factor : (8, 8) float64
        Its product with its transpose is the lens' covariance.
    placement : Placement
    touches : sequence of Touch
    printed : PrintedPoints or None
    bath : (surface z mm, index), or None
        Above the printed points.
    """

    insert: Insert
    marks: SeenMarks
    lens: FloatArray
    lens_factor: FloatArray
    placement: Placement
    touches: Sequence[Touch] = ()
    printed: PrintedPoints | None = None
    bath: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class Fitted:
    """Result of `fit_bundle`.

    Attributes
    ----------
    view : View
        In air.
    covariance : (14, 14) float64
        Of the turn about the printer's axes (rad), the eye (mm) and the lens' numbers.
    marks_mm : (n, 3) float64, mm
        The insert's marks, where they lie in the printer's frame, all of them.
    scale : float
        Of the insert.
    off_px : float
        RMS of the corners about the fit.
    misfit : float
        Root of the sum of squares over the degrees of freedom: 1 where the stated uncertainties
        hold.
    marks_off : float
        RMS by which marks lie off their places on the insert, of its way of making, as the corners'
        own uncertainties have it: below 1 where plate and lens are what they are said to be.
    shape_off : float
        As `marks_off`, of the plate's bend and of what it is off square.
    worst_touch : float
        Largest deviation of a touched cross, of its standard uncertainty.
    touch_misfit : float
        As `misfit`, of the touched crosses alone.
    touch_chance : float
        Of touches that fit no better, were they as good as stated.
    """

    view: View
    covariance: FloatArray
    marks_mm: FloatArray
    scale: float
    off_px: float
    misfit: float
    marks_off: float
    shape_off: float
    worst_touch: float
    touch_misfit: float
    touch_chance: float


def fit_bundle(bundle: Bundle, start: Start) -> Fitted:
    """Fit, and propagate all uncertainties.

    Raises
    ------
    PictureError
        When the numbers don't come to rest.
    """
    count = _OFF + 2 * len(bundle.insert.marks)
    unknown, normal = _solved(bundle, start, np.zeros(count))
    misfit = _misfit(bundle, start, unknown)
    off = unknown[_OFF:].reshape(-1, 2)[bundle.marks.index] / bundle.insert.u_mark_mm
    shape = (unknown / _sizes(bundle))[_SQUARE.start : _BENT.stop]
    shape_off = float(np.sqrt((shape**2).mean()))
    touched = _touch_errors(bundle, unknown)
    touch_misfit, chance = _touch_misfit(bundle, unknown, normal)
    if max(misfit, touch_misfit) > 1:
        # What scatters more than was stated is weighed by what is seen.
        marks = replace(bundle.marks, u_px=bundle.marks.u_px * max(misfit, 1.0))
        touches = [replace(t, u_mm=t.u_mm * max(touch_misfit, 1.0)) for t in bundle.touches]
        bundle = replace(bundle, marks=marks, touches=touches)
        unknown, normal = _solved(bundle, start, unknown)
    covariance = np.linalg.inv(normal)[: _LENS.stop, : _LENS.stop]
    spread = np.eye(_LENS.stop)
    spread[_LENS, _LENS] = bundle.lens_factor
    covariance = spread @ covariance @ spread.T
    if bundle.printed is not None:
        covariance[3, 3] += bundle.printed.common_u_mm**2
        covariance[4, 4] += bundle.printed.common_u_mm**2
    view = _view(bundle, start, unknown)
    return Fitted(
        view,
        np.asarray(covariance, dtype=np.float64),
        _laid(bundle, unknown, _middles(bundle, unknown)),
        float(unknown[_SCALE]) + bundle.insert.scale,
        float(np.sqrt((_corner_errors(bundle, view, unknown) ** 2).sum(axis=2).mean())),
        misfit,
        float(np.sqrt((off**2).mean())),
        shape_off,
        float(np.abs(touched).max(initial=0.0)),
        touch_misfit,
        chance,
    )


def _solved(bundle: Bundle, start: Start, unknown: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Least squares: unknowns, and the products of all slopes there."""

    def residuals(tried: FloatArray) -> FloatArray:
        return np.concatenate([part.ravel() for part in _residuals(bundle, start, tried)])

    def jacobian(tried: FloatArray) -> FloatArray:
        return _slopes(residuals, tried, sizes)

    sizes = _sizes(bundle)
    limits: dict[str, object] = {"ftol": _REST, "xtol": _REST, "max_nfev": _MAX_TRIALS}
    with suppress(ValueError):  # residuals that aren't numbers
        found = least_squares(residuals, unknown, jacobian, method="lm", x_scale=sizes, **limits)
        normal = found.jac.T @ found.jac
        if found.success and np.linalg.cond(normal * np.outer(sizes, sizes)) < _MAX_CONDITION:
            return found.x, normal
    raise PictureError(
        "camera and marks don't fit each other; is it this camera's lens file (--lens), and this "
        "fiducial plate (--insert)?"
    )


def _slopes(
    residuals: Callable[[FloatArray], FloatArray], at: FloatArray, sizes: FloatArray
) -> FloatArray:
    """Return slopes (k, n) of residuals (k,) at the unknowns (n,), by differences."""
    left, columns = residuals(at), []
    for n, size in enumerate(sizes):
        moved = at.copy()
        moved[n] += _STEP * size
        columns.append((residuals(moved) - left) / (_STEP * size))
    return np.stack(columns, axis=1)


def _sizes(bundle: Bundle) -> FloatArray:
    """Changes of the unknowns that matter: 1 mrad, 0.1 mm, the lens' own uncertainties."""
    sizes = np.full(_OFF + 2 * len(bundle.insert.marks), bundle.insert.u_mark_mm)
    sizes[:3], sizes[3:6] = 1e-3, 0.1
    sizes[_LENS] = 1.0
    sizes[_PLACED] = [0.1, 0.1, 0.1, 1e-3, 1e-3, 1e-3]
    sizes[_SCALE] = bundle.insert.u_scale
    sizes[_GROWN] = 0.01
    sizes[_SQUARE] = bundle.insert.tolerance.square
    sizes[_BENT] = bundle.insert.tolerance.bent_mm
    return sizes


def _misfit(bundle: Bundle, start: Start, unknown: FloatArray) -> float:
    """Root of the corners' sum of squares over its degrees of freedom."""
    corners = _residuals(bundle, start, unknown)[0]
    # A mark's own errors take up two of its eight numbers.
    free = corners.size - 6 - 2 * len(corners)
    return float(np.sqrt((corners**2).sum() / max(free, 1)))


def _touch_misfit(bundle: Bundle, unknown: FloatArray, normal: FloatArray) -> tuple[float, float]:
    """Root of the touches' sum of squares over its degrees of freedom, and its chance.

    What the fit has taken up of them is the trace of their share in it.
    """
    left = _touch_errors(bundle, unknown)
    by = _slopes(lambda tried: _touch_errors(bundle, tried), unknown, _sizes(bundle))
    free = len(left) - float((by * np.linalg.solve(normal, by.T).T).sum())
    if free < 0.5:  # two crosses without heights leave next to nothing
        return 0.0, 1.0
    total = float(left @ left)
    return float(np.sqrt(total / free)), float(chdtrc(free, total))


def _view(bundle: Bundle, start: Start, unknown: FloatArray) -> View:
    pose = unknown[_POSE]
    # A turn of the camera about the printer's axes.
    turn = start.turn @ turned(pose[:3]).T
    numbers = bundle.lens + bundle.lens_factor @ unknown[_LENS]
    return View(numbers, turn, start.eye_mm + pose[3:])


def _residuals(bundle: Bundle, start: Start, unknown: FloatArray) -> list[FloatArray]:
    """Deviations over standard uncertainties: corners (n, 4, 2), touches, printed, priors."""
    view = _view(bundle, start, unknown)
    u_px = bundle.marks.u_px[:, None, None]
    corners = _corner_errors(bundle, view, unknown) / u_px
    return [
        corners,
        _touch_errors(bundle, unknown),
        _printed_errors(bundle, view),
        unknown[_LENS],
        _placement_errors(bundle, unknown),
        unknown[_SCALE : _SCALE + 1] / bundle.insert.u_scale,
        unknown[_GROWN : _GROWN + 1] / _U_GROWN,
        unknown[_SQUARE] / bundle.insert.tolerance.square,
        unknown[_BENT] / bundle.insert.tolerance.bent_mm,
        unknown[_OFF:] / bundle.insert.u_mark_mm,
    ]


def _corner_errors(bundle: Bundle, view: View, unknown: FloatArray) -> FloatArray:
    """Pixels from where each seen corner should be, (n, 4, 2)."""
    index = bundle.marks.index
    drawn = bundle.insert.corners()[index]
    middle = drawn.mean(axis=1, keepdims=True)
    off = unknown[_OFF:].reshape(-1, 1, 2)[index]
    plane = middle + (drawn - middle) * (1 + unknown[_GROWN]) + off
    seen = project(view, _laid(bundle, unknown, plane.reshape(-1, 2)))
    return np.nan_to_num(seen.reshape(plane.shape), nan=1e6) - bundle.marks.corners


def _middles(bundle: Bundle, unknown: FloatArray) -> FloatArray:
    """Middles of all marks on the insert as made, (n, 2) mm, but for its scale."""
    middles = bundle.insert.corners().mean(axis=1)
    return np.asarray(middles + unknown[_OFF:].reshape(-1, 2))


def _laid(bundle: Bundle, unknown: FloatArray, plane: FloatArray) -> FloatArray:
    """Places of the insert's upper face (n, 2) mm in the printer's frame, (n, 3)."""
    x, y, z, tilt_x, tilt_y, turned = unknown[_PLACED]
    angle = bundle.placement.turned_rad + turned
    c, s = np.cos(angle), np.sin(angle)
    taller, skew = unknown[_SQUARE]
    made = plane @ np.array([[1.0, 0.0], [skew, 1.0 + taller]])
    flat = (bundle.insert.scale + unknown[_SCALE]) * made @ np.array([[c, s], [-s, c]])
    up = z + tilt_y * flat[:, 0] - tilt_x * flat[:, 1] + _bends(bundle, plane) @ unknown[_BENT]
    origin = np.array(bundle.placement.origin_mm)
    return origin + np.column_stack([flat + [x, y], up])


def _bends(bundle: Bundle, plane: FloatArray) -> FloatArray:
    """Height of each way to bend by 1 mm at the plate's edge, (n, 3); its mean height stays."""
    share = 2 * plane / np.array(bundle.insert.plate_mm)
    x, y = share.T
    # Marks lie along a square's sides, where x² is 2/3 on the mean.
    return np.column_stack([x**2 - 2 / 3, y**2 - 2 / 3, x * y])


def _touch_errors(bundle: Bundle, unknown: FloatArray) -> FloatArray:
    places = {cross.name: (cross.x_mm, cross.y_mm) for cross in bundle.insert.crosses}
    if not bundle.touches:
        return np.zeros(0)
    laid = _laid(bundle, unknown, np.array([places[t.name] for t in bundle.touches]))
    errors: list[Any] = []
    for touch, place in zip(bundle.touches, laid, strict=True):
        u_mm = np.hypot(touch.u_mm, bundle.insert.u_mark_mm)
        errors += [(place[0] - touch.x_mm) / u_mm, (place[1] - touch.y_mm) / u_mm]
        if touch.z_mm is not None:
            errors.append((place[2] - touch.z_mm) / touch.u_mm)
    return np.array(errors)


def _printed_errors(bundle: Bundle, view: View) -> FloatArray:
    """Deviations on the printed points' own plane, in mm over their uncertainty."""
    printed = bundle.printed
    if printed is None:
        return np.zeros(0)
    if bundle.bath is not None:
        view = View(view.lens, view.turn, view.eye_mm, *bundle.bath)
    seen = project(view, printed.places_mm)
    px_per_mm = view.lens[0] / np.linalg.norm(view.eye_mm - printed.places_mm.mean(axis=0))
    return np.nan_to_num(seen - printed.pixels, nan=1e6) / (px_per_mm * printed.u_mm[:, None])


def _placement_errors(bundle: Bundle, unknown: FloatArray) -> FloatArray:
    known = bundle.placement
    sure = np.array([known.u_xy_mm] * 2 + [known.u_z_mm] + [known.u_tilt_rad] * 2
                    + [known.u_turned_rad])  # fmt: skip
    return unknown[_PLACED] / np.maximum(sure, _FIXED)
