"""Triangulate a needle's tip from pictures at known printer positions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from firmware_profiles import Needle
from kernels.arrays import FloatArray
from registration.devices.camera_frame.frame import CameraFrame, View, project, varied
from registration.devices.camera_frame.tip import SeenTip, find_tip
from registration.errors import PictureError

_MEDIAN_OF: Final = 3
"""Pictures from which a median shows no needle."""
_CLEAR: Final = 3.0
"""Diameters between two needles, beyond the reach, for one to be ground of the other."""


def grounds(
    pictures: Sequence[NDArray[Any]],
    frame: CameraFrame,
    places_mm: FloatArray,
    outer_mm: float,
    reach_mm: float,
) -> list[NDArray[Any] | None]:
    """Return each picture's ground out of the others, None where none will do.

    Parameters
    ----------
    pictures : sequence of (h, w) or (h, w, 3)
        Of one camera that doesn't move.
    frame : CameraFrame
    places_mm : (n, 3) float64, mm
        The printer's positions.
    outer_mm, reach_mm : float, mm
    """
    images: list[NDArray[Any] | None] = []
    for k, place in enumerate(places_mm):
        ray = np.array(frame.eye_mm) - place
        side = np.array([-ray[1], ray[0], 0.0]) / max(float(np.hypot(ray[0], ray[1])), 1e-9)
        aside = np.abs((places_mm - place) @ side)
        free = [
            n for n in range(len(pictures)) if aside[n] > reach_mm + _CLEAR * outer_mm and n != k
        ]
        if len(free) >= _MEDIAN_OF:
            stack = np.stack([pictures[n] for n in free])
            images.append(np.median(stack, axis=0).astype(stack.dtype))
        elif free:
            images.append(pictures[max(free, key=lambda n: aside[n])])
        else:
            images.append(None)
    return images


_WORN: Final = 0.22
"""Tangent of the end's slope, beyond its scatter, from which a tip counts as worn."""
_RAGGED: Final = 0.08
"""RMS of the end about a flat one, of the width."""
_BENT: Final = 0.04
_OFF_WIDTH: Final = 0.06
"""Of the diameter by the profile: another needle, ink on it, or a burr."""
_WORST: Final = 4.0
"""Root mean square deviation of the pictures, of their standard uncertainties."""
_SURE_MM: Final = 0.02
_T95: Final = 1.96


@dataclass(frozen=True, eq=False)
class TipView:
    """A tip in one picture, and where the printer stood.

    Attributes
    ----------
    frame : CameraFrame
    seen : SeenTip
    at_mm : (3,) float64, mm
        The printer's position: where the tip would be without offset.
    """

    frame: CameraFrame
    seen: SeenTip
    at_mm: FloatArray


@dataclass(frozen=True, eq=False)
class Tip:
    """A needle's tip.

    Attributes
    ----------
    offset_mm : (3,) float64, mm
        From the printer's position to the tip.
    covariance_mm2 : (3, 3) float64
        Of the offset, frames included.
    outer_mm, u_outer_mm : float, mm
    worn : tuple of str
        What is odd about it; empty for a straight needle with a flat end.
    misfit : float
        Root of the sum of squares over the degrees of freedom; NaN without any.
    views : int
    """

    offset_mm: FloatArray
    covariance_mm2: FloatArray
    outer_mm: float
    u_outer_mm: float
    worn: tuple[str, ...]
    misfit: float
    views: int

    @property
    def u_mm(self) -> FloatArray:
        """Standard uncertainties along x, y, z, (3,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance_mm2)))

    def notes(self) -> list[str]:
        """What is odd about the tip, and which axis the pictures don't tell well enough."""
        if self.u_mm.max() <= _SURE_MM:
            return list(self.worn)
        axis = "xyz"[int(self.u_mm.argmax())]
        return [
            *self.worn,
            f"{axis} is known to {_T95 * 1e3 * self.u_mm.max():.0f} µm only: give more pictures "
            "with the needle farther apart, or one from another side",
        ]


def find_tips(
    images: Sequence[NDArray[Any]],
    names: Sequence[str],
    frames: Sequence[CameraFrame],
    places_mm: FloatArray,
    needle: Needle,
    *,
    reach_mm: float = 2.0,
    ground: NDArray[Any] | None = None,
) -> tuple[list[TipView], list[str]]:
    """Find the tip in each picture; return where it is found, and why not in the others.

    Parameters
    ----------
    images : sequence of (h, w) or (h, w, 3)
    names : sequence of str
        Of the pictures, for messages.
    frames : sequence of CameraFrame
        Of the camera that took each; the same object for the same camera.
    places_mm : (n, 3) float64, mm
        The printer's positions.
    needle : Needle
    reach_mm : float, mm
        How far off the tip may be.
    ground : (h, w) or (h, w, 3), optional
        The scene without the needle, of one camera; else pictures are each other's (`grounds`).
    """
    behind: list[NDArray[Any] | None] = [ground] * len(images)
    cameras = {id(each): each for each in frames} if ground is None else {}
    for camera in cameras.values():
        own = [n for n, each in enumerate(frames) if each is camera]
        pictures = [images[n] for n in own]
        picked = grounds(pictures, camera, places_mm[own], needle.outer_mm, reach_mm)
        for n, other in zip(own, picked, strict=True):
            behind[n] = other
    views, missed = [], []
    for image, name, frame, place, back in zip(
        images, names, frames, places_mm, behind, strict=True
    ):
        try:
            seen = find_tip(
                image, frame, place, needle.outer_mm, reach_mm=reach_mm,
                length_mm=needle.length_mm, ground=back, source=name,
            )  # fmt: skip
        except PictureError as exc:
            missed.append(f"{name}: not found: {exc}")
            continue
        views.append(TipView(frame, seen, place))
    return views, missed


def locate_tip(
    views: Sequence[TipView],
    outer_mm: float,
    *,
    u_first_mm: FloatArray | None = None,
) -> Tip:
    """Find the offset that all pictures see; two that look from different sides tell all of it.

    One camera will do with the needle at several known places: it sees each from another side.

    Parameters
    ----------
    views : sequence of TipView
    outer_mm : float, mm
        By the needle's profile.
    u_first_mm : (3,) float64, mm, optional
        How well an offset of 0 was known beforehand, such as z by touching off; 5 mm each, if not
        given.

    Raises
    ------
    PictureError
        When there is no picture, or they contradict each other.
    """
    if not views:
        raise PictureError("no picture shows the tip; give one or more")
    first = np.full(3, 5.0) if u_first_mm is None else np.asarray(u_first_mm, dtype=np.float64)
    offset, levers = _settled(views, first)
    misfit = _misfit(views, offset)
    _refuse_contradiction(views, first, misfit)
    flat = levers.reshape(-1, 3)
    covariance = np.asarray(np.linalg.inv(flat.T @ flat + np.diag(first**-2.0)))
    if misfit > 1:  # not where there is none
        covariance = covariance * misfit**2
    whole: FloatArray = covariance + _by_frames(views, offset, covariance, levers)
    wide = np.array([v.seen.width_mm for v in views])
    sure = np.array([v.seen.u_width_mm for v in views]) ** -2.0
    width = float((wide * sure).sum() / sure.sum())
    u_width = float(np.hypot(sure.sum() ** -0.5, 0.01 * width))  # edges of round steel
    worn = _worn(views, width, u_width, outer_mm)
    return Tip(offset, whole, width, u_width, worn, misfit, len(views))


def _settled(views: Sequence[TipView], first: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Offset by least squares, and slopes of the whitened pixels (n, 2, 3)."""

    def left(offset: FloatArray) -> FloatArray:
        each = [_whitened(v, v.frame.under(None).view, offset) for v in views]
        return np.concatenate([*each, offset / first])

    found = least_squares(left, np.zeros(3))
    return found.x, found.jac[: 2 * len(views)].reshape(-1, 2, 3)


def _whitened(view: TipView, camera: View, offset: FloatArray) -> FloatArray:
    """Deviation of the seen pixel, of its standard uncertainties, (2,)."""
    off = project(camera, (view.at_mm + offset)[None])[0] - view.seen.pixel
    lower = np.linalg.cholesky(view.seen.covariance_px2)
    return np.asarray(np.linalg.solve(lower, np.nan_to_num(off, nan=1e6)))


def _misfit(views: Sequence[TipView], offset: FloatArray) -> float:
    """Root of the sum of squares over the degrees of freedom; NaN without any."""
    free = 2 * len(views) - 3
    left = np.array([_whitened(v, v.frame.under(None).view, offset) for v in views])
    return float(np.sqrt((left**2).sum() / free)) if free > 0 else float("nan")


def _refuse_contradiction(views: Sequence[TipView], first: FloatArray, misfit: float) -> None:
    """Raise where the pictures can't be of one tip, naming the one without which they can."""
    if not misfit > _WORST:
        return
    rest = []
    for n in range(len(views)) if len(views) > 2 else ():
        others = [*views[:n], *views[n + 1 :]]
        rest.append(_misfit(others, _settled(others, first)[0]))
    who = "the pictures don't fit each other"
    if rest and min(rest) < misfit / 2:
        who = f"picture {int(np.argmin(rest)) + 1} doesn't fit the others"
    raise PictureError(
        f"{who}: their tips lie {misfit:.0f} of their standard uncertainties apart ({_WORST:g} at "
        "most). Are all places (--at) right? Does the frame still hold (printctl observe check)?"
    )


def _by_frames(
    views: Sequence[TipView], offset: FloatArray, inner: FloatArray, levers: FloatArray
) -> FloatArray:
    """Covariance that the frames bring, each common to its own pictures, (3, 3)."""
    covariance = np.zeros((3, 3))
    for frame in {id(view.frame): view.frame for view in views}.values():
        known = np.array(frame.covariance)
        sizes = np.sqrt(np.maximum(np.diag(known), 1e-24))
        moved = np.zeros((3, len(sizes)))
        for n, size in enumerate(sizes):
            step = 0.01 * float(size) + 1e-12
            for view, lever in zip(views, levers, strict=True):
                if view.frame is frame:
                    plain = frame.under(None).view
                    then = _whitened(view, varied(plain, n, step), offset)
                    change = (then - _whitened(view, plain, offset)) / step
                    moved[:, n] -= inner @ lever.T @ change
        covariance += moved @ known @ moved.T
    return covariance


def _worn(
    views: Sequence[TipView], width: float, u_width: float, outer_mm: float
) -> tuple[str, ...]:
    said = []
    slopes = np.array([v.seen.slope for v in views])
    # Light from aside shifts the end of a sound tip a little, in one view more than another.
    slope = abs(float(np.median(slopes)))
    if slope - 2 * float(slopes.std()) / np.sqrt(len(slopes)) > _WORN:
        angle = np.degrees(np.arctan(slope))
        said.append(f"its end is worn or cut aslant: {angle:.0f} degrees off straight across")
    rough = float(np.median([v.seen.rough for v in views]))
    if rough > _RAGGED:
        said.append(f"its end is uneven: {rough:.0%} of the diameter RMS (burr, drop of ink?)")
    lean = float(np.median([abs(v.seen.lean) for v in views]))
    if lean > _BENT:
        said.append(f"it is bent or tilted by {np.degrees(np.arctan(lean)):.1f} degrees")
    if abs(width - outer_mm) > _OFF_WIDTH * outer_mm + 2 * u_width:
        said.append(f"its diameter is {width:.3f} mm, {outer_mm:.3f} by the profile")
    return tuple(said)
