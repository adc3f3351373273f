"""Classify each head's moves as write, travel or lift; locate written ones along the vessels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from kernels.arrays import FloatArray, IntArray
from sim.gcode.clearance.motion import NeedleMotion
from sim.gcode.clearance.network import WrittenNetwork
from sim.gcode.clearance.passes import Passes, passes_of

WRITE, TRAVEL, LIFT, DESCENT, HEAD_CHANGE = range(5)
KINDS: Final = ("write", "travel", "lift", "descent", "head change")


@dataclass(frozen=True)
class Head:
    """Rows of one head.

    Attributes
    ----------
    tips : (n, 2, 3) float64, mm
    passes : Passes
    along : (n, 2) float64, mm
        Of a written row's ends, along its vessel.
    """

    tips: FloatArray
    passes: Passes
    along: FloatArray


def heads_of(motion: NeedleMotion, network: WrittenNetwork) -> list[Head]:
    """Passes of every head, and where along its vessel each written row lies."""
    heads = []
    for k, tips in enumerate(motion.tips):
        writes = motion.writes & (motion.tool == k)
        along = np.zeros((len(tips), 2))
        rows = np.flatnonzero(writes)
        along[rows] = network.spans(motion.vessel[rows], tips[rows, 0], tips[rows, 1])[0]
        heads.append(Head(tips, passes_of(tips, writes), along))
    return heads


def kinds_of(tips: FloatArray, writes: NDArray[np.bool_]) -> IntArray:
    """What one head's rows are, (n,): indices of `KINDS`."""
    step = tips[:, 1] - tips[:, 0]
    upright = np.hypot(step[:, 0], step[:, 1]) < 1e-6
    kind = np.full(len(tips), TRAVEL)
    kind[upright & (step[:, 2] > 0)] = LIFT
    kind[upright & (step[:, 2] < 0)] = DESCENT
    kind[(step == 0).all(axis=1)] = HEAD_CHANGE
    kind[writes] = WRITE
    return kind
