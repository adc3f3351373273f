"""Find a needle's tip in a picture: its pixel, diameter, and the end's tilt and roughness."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray
from registration.devices.camera_frame.frame import CameraFrame
from registration.devices.camera_frame.marks import check_size
from registration.devices.camera_frame.tip_axis import needle_axis
from registration.devices.camera_frame.tip_end import rough_end
from registration.devices.camera_frame.tip_fit import fit_end
from registration.devices.camera_frame.tip_patch import tip_patch

_FLOOR_ASIDE_PX: Final = 0.05
_FLOOR_UP_PX: Final = 0.1
"""No tip is known better: light on round steel shifts edges, and an end's rim isn't quite sharp."""


@dataclass(frozen=True, eq=False)
class SeenTip:
    """A tip in one picture.

    Attributes
    ----------
    pixel : (2,) float64
        Of the middle of the needle's end.
    covariance_px2 : (2, 2) float64
    width_mm, u_width_mm : float, mm
        Outer diameter above the end.
    slope, u_slope : float
        Of the end against straight across (tangent of the angle seen).
    rough : float
        RMS of the end about a flat one's ellipse, of the width.
    lean : float
        Tangent of the needle's angle seen against upright.
    clear : float
        Of the edges, over the ground's deviation.
    """

    pixel: FloatArray
    covariance_px2: FloatArray
    width_mm: float
    u_width_mm: float
    slope: float
    u_slope: float
    rough: float
    lean: float
    clear: float


def find_tip(
    image: NDArray[Any],
    frame: CameraFrame,
    tip_mm: FloatArray,
    outer_mm: float,
    *,
    reach_mm: float = 2.0,
    length_mm: float = 12.0,
    ground: NDArray[Any] | None = None,
    source: str = "the picture",
) -> SeenTip:
    """Find the tip of a needle that points down.

    Parameters
    ----------
    image : (h, w) or (h, w, 3)
    frame : CameraFrame
    tip_mm : (3,) float64, mm
        Where the tip should be, printer's frame.
    outer_mm : float, mm
        The needle's outer diameter, by its profile.
    reach_mm : float, mm
        How far off the tip may be.
    length_mm : float, mm
        Of the needle below its hub.
    ground : (h, w) or (h, w, 3), optional
        The same scene without the needle, or with it elsewhere.
    source : str
        Named in messages.

    Raises
    ------
    PictureError
        When it isn't found; says why.
    """
    check_size(image, frame.lens, source)
    if ground is not None:
        check_size(ground, frame.lens, f"the ground of {source}")
    view = frame.under(None).view
    patch = tip_patch(
        image,
        view,
        np.asarray(tip_mm, np.float64),
        outer_mm,
        reach_mm,
        ground,
        length_mm,
        frame.seen.gamma,
    )
    far = reach_mm * patch.px_per_mm
    axis = needle_axis(patch, far)
    end = fit_end(patch, axis, rough_end(patch, axis, -far, far))
    turn = np.column_stack([patch.up, patch.aside])
    floor = np.diag([_FLOOR_UP_PX**2, _FLOOR_ASIDE_PX**2])
    return SeenTip(
        patch.pixel(end.above, end.beside),
        turn @ (end.covariance_px2 + floor) @ turn.T,
        end.wide_px / patch.px_per_mm,
        end.u_wide_px / patch.px_per_mm,
        end.tilt + end.lean,
        end.u_tilt,
        end.rough,
        end.lean,
        end.clear,
    )
