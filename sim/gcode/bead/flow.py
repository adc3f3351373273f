"""Compute the needle's ink outflow exactly, from plunger motion of piecewise constant speed.

Within a piece the plunger goes evenly, so the compliance's equation (`sim.gcode.bead.nozzle`) has
its own solution: V − V_y − τ Q_p falls off as e^(−t/τ) while ink flows; while |V| ≤ V_y nothing
flows and V goes with the plunger. There are no time steps. Below −V_y the plunger's pull draws ink
back into the needle by the same law (a retraction); what comes out next is that ink.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kernels.arrays import FloatArray
from sim.gcode.bead.nozzle import Nozzle
from sim.gcode.bead.pieces import Pieces


@dataclass(frozen=True)
class NozzleFlow:
    """Outflow of the needle in each piece of motion.

    Attributes
    ----------
    out_ul : (n,) float64, µL
        Out of the needle; below 0 where it is drawn back.
    laid_ul : (n,) float64, µL
        Ink that is laid: what goes out beyond what had been out before.
    held_ul : (n,) float64, µL
        Held back by compliance as the piece ends, V.
    start_ul : float, µL
        V before the first piece.
    """

    out_ul: FloatArray
    laid_ul: FloatArray
    held_ul: FloatArray
    start_ul: float


def nozzle_flow(pieces: Pieces, nozzle: Nozzle) -> NozzleFlow:
    """Integrate over all pieces.

    The needle is full and primed when the motion begins: V = V_y, the most at which nothing flows.
    """
    if nozzle.lag_s == 0:
        out = pieces.push_ul + pieces.jump_ul
        return NozzleFlow(out, _laid(out), np.zeros(len(out)), 0.0)
    out, held = _integrated(pieces, nozzle.lag_s, nozzle.held_ul)
    return NozzleFlow(out, _laid(out), held, nozzle.held_ul)


def _laid(out: FloatArray) -> FloatArray:
    """What goes out beyond the most that had been out: the rest only fills the needle again."""
    most = np.maximum.accumulate(np.maximum(np.cumsum(out), 0.0))
    laid: FloatArray = np.diff(most, prepend=0.0)
    return laid


def _integrated(pieces: Pieces, lag: float, yields: float) -> tuple[FloatArray, FloatArray]:
    """Outflow and held volume of each piece, µL."""
    out, held = np.zeros(len(pieces)), np.zeros(len(pieces))
    volume = yields
    columns = (pieces.duration.tolist(), pieces.push_ul.tolist(), pieces.jump_ul.tolist())
    for i, (duration, push, jump) in enumerate(zip(*columns, strict=True)):
        before = volume + jump
        volume = before + push if duration <= 0 else _after(before, push, duration, lag, yields)
        out[i] = before + push - volume
        held[i] = volume
    return out, held


def _after(volume: float, push: float, duration: float, lag: float, yields: float) -> float:
    """V after one piece: through as many of its regimes (out, still, back) as it meets."""
    rate, left = push / duration, duration
    while left > 0:
        side = _side(volume, rate, yields)
        if side == 0:
            if rate == 0:
                return volume
            edge = math.copysign(yields, rate)
            takes = (edge - volume) / rate
            if takes >= left:
                return volume + rate * left
            volume, left = edge, left - takes
            continue
        # Flow Q = (V − side V_y)/τ tends to the plunger's rate, and stops where it meets 0.
        flow = (volume - side * yields) / lag
        takes = lag * math.log1p(-flow / rate) if rate * side < 0 else math.inf
        if takes >= left:
            decay = math.exp(-left / lag)
            return side * yields + lag * (rate + (flow - rate) * decay)
        volume, left = side * yields, left - takes
    return volume


def _side(volume: float, rate: float, yields: float) -> int:
    """1 where ink flows out, -1 where it is drawn back, 0 where the yield stress holds it."""
    if volume > yields or (volume == yields and rate > 0):
        return 1
    if volume < -yields or (volume == -yields and rate < 0):
        return -1
    return 0
