"""Check that a dye video's frame interval resolves the moving front."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from design.hemodynamics.dye.front import DyeFront
from kernels.arrays import IntArray

FRAMES_IN_A_VESSEL: Final = 2.0
"""Frames while the tip runs through a vessel, for its arrival at both ends to be told apart."""

FRAMES_IN_ALL: Final = 10.0
"""Frames while the tip runs from the inlet to where it leaves last."""


@dataclass(frozen=True)
class FrameCheck:
    """Result of checking a video's frame interval against the dye front.

    Attributes
    ----------
    interval_s : float, s
        Between frames.
    quick : (k,) int64
        Vessels that the tip runs through in less than `FRAMES_IN_A_VESSEL` frames.
    needed_per_s : float, 1/s
        Frames a second that would show half of the vessels, and the whole.
    frames : float
        From the tip at the inlet to the tip where it leaves last.
    warning : str
        Empty where frames are near enough.
    """

    interval_s: float
    quick: IntArray
    needed_per_s: float
    frames: float
    warning: str


def check_frames(front: DyeFront, interval_s: float) -> FrameCheck:
    """Hold a film's interval against the front's tip.

    It warns where more than half of the vessels are too quick, or the whole is.
    """
    tips = front.transit_s / 2.0
    known = np.isfinite(tips)
    quick = np.flatnonzero(known & (tips < FRAMES_IN_A_VESSEL * interval_s))
    whole = float(np.nanmax(front.tip_leaves_s))
    needed = max(FRAMES_IN_A_VESSEL / float(np.median(tips[known])), FRAMES_IN_ALL / whole)
    frames = whole / interval_s
    warning = ""
    if 1.0 / interval_s < needed * (1.0 - 1e-9):
        warning = (
            f"frames {interval_s:.3g} s apart are too far apart: dye's tip runs through "
            f"{len(quick)} of {int(known.sum())} vessels in less than {FRAMES_IN_A_VESSEL:g} "
            f"frames, and through the whole in {frames:.3g}; film {np.ceil(needed):g} frames a "
            f"second or more, or lower the flow ({front.flow_ul_s * 0.06:.3g} mL/min)"
        )
    return FrameCheck(interval_s, quick, needed, frames, warning)
