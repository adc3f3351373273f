"""Build the result for ink on older ink from one scalar level (height or change) alone."""

from __future__ import annotations

import numpy as np

from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.inspection.ink.ink_image import ACROSS, Template
from registration.inspection.ink.presence import WindowNoise
from registration.inspection.ink.told import LONG, Told
from registration.inspection.pictures.working import Working
from registration.inspection.values import Appearance, FloatImage, Unseen
from registration.inspection.ways import Ways


def told_by_level(
    work: Working,
    ways: Ways,
    use: BoolArray,
    image: FloatImage,
    present: FloatArray,
    why: IntArray,
    noise: WindowNoise | None,
    strange: BoolArray,
    gap_mm: float,
    rate: float,
    log_step: float = 0.0,
) -> Told | None:
    """Return what a level tells at places ``use`` (n,); None where it tells no long gap.

    Parameters
    ----------
    work : Working
    ways : Ways
    use : (n,) bool
    image : (h, w) float32
        In which ink's level is 1, or is above that without it by 1.
    present : (n,) float64
    why : (n,) int64
        `Unseen`.
    noise : WindowNoise or None
    strange : (h, w) bool
        What is neither ink nor its absence.
    gap_mm : float, mm
    rate : float
        False findings per sound layer.
    log_step : float
        As of `Told`.
    """
    way_mm = float(ways.step[use & (why == Unseen.SEEN)].sum())
    needed = rate / max(1.0, way_mm / gap_mm)
    if noise is None or not noise.can_tell(LONG * gap_mm, needed):
        return None
    flat = np.zeros((3, len(ACROSS)))
    flat[0] = 1.0
    nothing = np.zeros(work.channels.shape[2])
    return Told(
        image=image,
        profiles=np.zeros((len(ways), len(ACROSS)), dtype=np.float32),
        present=present,
        plain=present,
        why=np.asarray(why),
        template=Template(flat, 1.0, True),
        noise=noise,
        contrast=noise.contrast(gap_mm),
        strange=strange,
        unlike_bath=np.zeros(work.shape, dtype=np.float32),
        appearance=Appearance(nothing, flat, True, nothing),
        bath_spread=noise.bath,
        log_step=log_step,
        ink=nothing,
        faint=not noise.can_tell(gap_mm, needed),
        level=np.ones(len(ways)),
        strength=np.ones(len(ways)),
    )
