"""Compute each ink fault's factor on flow: clog, drift, temperature swing, bubble, empty."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from kernels.arrays import FloatArray
from sim.gcode.deposit.ink_faults import Bubble, Clog, Drift, Empty, InkFault, Temperature
from sim.gcode.deposit.ink_timeline import Timeline, at, when

_STEPS: Final = 40
"""Of a ramp, and of a period."""
_MOST_CUTS: Final = 100_000


@dataclass(frozen=True)
class FlowChange:
    """What a fault does to the flow.

    Attributes
    ----------
    cuts : (k,) float64
        Places at which lines must be cut for the factor to hold within each piece.
    factor : callable
        Of places (n,): flow over what is pushed, (n,).
    """

    cuts: FloatArray
    factor: Callable[[FloatArray], FloatArray]


def flow_change(fault: InkFault, line: Timeline) -> FlowChange | None:
    """Return what a fault does to the flow; None for nothing, or not yet."""
    begin = line.begins(fault)
    if math.isinf(begin):
        return None
    match fault:
        case Clog():
            return _clog(fault, line, begin)
        case Drift():
            return _ramp(line.written_mm, begin, fault.over_mm, fault.factor)
        case Temperature():
            return _swing(fault, line, begin)
        case Bubble():
            return _bubble(fault, line, begin)
        case Empty():
            return _ramp(line.pushed_ul, begin, fault.fades_ul, 0.0)
    return None


def _clog(fault: Clog, line: Timeline, begin: float) -> FlowChange:
    end = math.inf
    if fault.lasts_mm is not None:
        end = when(line.written_mm, float(at(line.written_mm, begin)) + fault.lasts_mm)
    if fault.clears_ul is not None:
        end = min(end, when(line.purged_ul, float(at(line.purged_ul, begin)) + fault.clears_ul))
    cuts = np.array([place for place in (begin, end) if math.isfinite(place)])
    return FlowChange(
        cuts, lambda place: np.where((place >= begin) & (place < end), fault.passes, 1.0)
    )


def _ramp(total: FloatArray, begin: float, over: float, to: float) -> FlowChange:
    """From 1 to `to` while a running sum grows by `over`; at once for 0."""
    first = float(at(total, begin))
    if over <= 0:
        return FlowChange(np.array([begin]), lambda place: np.where(place >= begin, to, 1.0))

    def factor(place: FloatArray) -> FloatArray:
        done = np.clip((at(total, place) - first) / over, 0.0, 1.0)
        return np.where(place >= begin, 1.0 + (to - 1.0) * done, 1.0)

    return FlowChange(_reached(total, first + over * np.linspace(0, 1, _STEPS + 1)), factor)


def _swing(fault: Temperature, line: Timeline, begin: float) -> FlowChange:
    zero = float(line.seconds(np.array([begin]))[0])
    last = float(line.time_s[-1, 1])
    step = max(fault.period_s / _STEPS, (last - zero) / _MOST_CUTS)
    cuts = line.at_times(np.arange(zero, last, step))

    def factor(place: FloatArray) -> FloatArray:
        phase = 2 * np.pi * (line.seconds(place) - zero) / fault.period_s
        return np.where(place >= begin, 1.0 + fault.amplitude * np.sin(phase), 1.0)

    return FlowChange(np.append(begin, cuts), factor)


def _bubble(fault: Bubble, line: Timeline, begin: float) -> FlowChange:
    first = float(at(line.pushed_ul, begin))

    def factor(place: FloatArray) -> FloatArray:
        passed = (at(line.pushed_ul, place) - first) / fault.ul
        after = np.where(passed < 2.0, 1.0 + fault.catches_up, 1.0)
        return np.where(place < begin, 1.0, np.where(passed < 1.0, 0.0, after))

    cuts = _reached(line.pushed_ul, first + fault.ul * np.array([1.0, 2.0]))
    return FlowChange(np.concatenate([[begin], cuts]), factor)


def _reached(total: FloatArray, values: FloatArray) -> FloatArray:
    places = np.array([when(total, float(value)) for value in values])
    return places[np.isfinite(places)]
