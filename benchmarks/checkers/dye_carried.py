"""Dye in a network of straight tubes, along streamlines, without product code.

Poiseuille's profile, no diffusion, flows that mix wholly at nodes, a step of dye at the inlet. What
leaves a tube is the sum over its streamlines of what entered, each as much later as it is slow:
done in time, where the product has Laplace transforms and the simulator finite volumes.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

STEP_S = 0.01
_LINES = 400


@dataclass(frozen=True)
class Tubes:
    """A network of straight tubes, dye let in at one end at ``start_s``.

    Attributes
    ----------
    node : (m, 3) float64, mm
    vessel : (n, 2) int64
        Ends of each.
    radius : (n,) float64, mm
    flow : (n,) float64, µL/s
        From first end to last; 0 in closed ones and in what they cut off.
    entered : (m, k) float64
        Concentration at each node at multiples of `STEP_S`.
    """

    node: FloatArray
    vessel: IntArray
    radius: FloatArray
    flow: FloatArray
    entered: FloatArray

    def length(self) -> FloatArray:
        """Of each tube, mm."""
        ends = self.node[self.vessel]
        return np.asarray(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1))

    def transit(self) -> FloatArray:
        """Volume over flow, s; without end in those at rest."""
        volume = np.pi * self.radius**2 * self.length()
        with np.errstate(divide="ignore"):
            return np.asarray(volume / np.abs(self.flow))

    def begin(self, vessel: int) -> int:
        """Node that flow enters a vessel by."""
        return int(self.vessel[vessel, 0 if self.flow[vessel] >= 0 else 1])

    def mean(self, vessel: int, share: float) -> FloatArray:
        """Mean concentration over the section at a share of the length from the first end, (k,)."""
        if self.flow[vessel] == 0.0:
            return np.zeros(self.entered.shape[1])
        along = share if self.flow[vessel] > 0 else 1.0 - share
        line = (np.arange(_LINES) + 0.5) / _LINES
        delay = along * self.transit()[vessel] / (2.0 * (1.0 - line))
        return _later(self.entered[self.begin(vessel)], delay, np.full(_LINES, 1.0 / _LINES))

    def arrival(self, vessel: int, share: float, seconds: float) -> float:
        """When half of the level at the film's end, its last tenth, is reached, s."""
        curve = self.mean(vessel, share)[: round(seconds / STEP_S)]
        half = 0.5 * float(np.median(curve[int(0.9 * len(curve)) :]))
        if half < 1e-3:
            return float("nan")
        k = int(np.argmax(curve >= half))
        return float(STEP_S * (k - 1 + (half - curve[k - 1]) / (curve[k] - curve[k - 1])))


def dyed(
    node: FloatArray,
    vessel: IntArray,
    radius: FloatArray,
    inflow_ul_s: float,
    start_s: float,
    seconds: float,
    closed: Collection[int] = (),
) -> Tubes:
    """Solve the flow without the closed vessels, and carry the dye."""
    flow, pressure = _flow(node, vessel, radius, inflow_ul_s, closed)
    count = round(seconds / STEP_S) + 1
    tubes = Tubes(node, vessel, radius, flow, np.zeros((len(node), count)))
    transit, into = tubes.transit(), np.zeros(len(node))
    entered = tubes.entered
    entered[_inlets(vessel)] = STEP_S * np.arange(count) >= start_s
    line = (np.arange(_LINES) + 0.5) / _LINES
    # By falling pressure of where a vessel begins: all that enters a node comes before what leaves.
    for k in sorted(np.flatnonzero(flow), key=lambda k: -pressure[tubes.begin(int(k))]):
        first = tubes.begin(int(k))
        last = int(vessel[k].sum()) - first
        share = 2.0 * (1.0 - line) / _LINES
        passed = _later(entered[first], transit[k] / (2.0 * (1.0 - line)), share)
        rate = abs(float(flow[k]))
        entered[last] = (into[last] * entered[last] + rate * passed) / (into[last] + rate)
        into[last] += rate
    return tubes


def _later(curve: FloatArray, delay: FloatArray, share: FloatArray) -> FloatArray:
    """Sum of a curve, delayed by each of some times, by shares; fractions of a step by a line."""
    made = np.zeros(len(curve) + 1)
    whole = np.minimum(delay / STEP_S, len(curve)).astype(np.int64)
    part = np.minimum(delay / STEP_S - whole, 1.0)
    np.add.at(made, np.minimum(whole, len(curve)), share * (1.0 - part))
    np.add.at(made, np.minimum(whole + 1, len(curve)), share * part)
    return np.convolve(curve, made[:-1])[: len(curve)]


def _inlets(vessel: IntArray) -> IntArray:
    return np.setdiff1d(vessel[:, 0], vessel[:, 1])


def _flow(
    node: FloatArray, vessel: IntArray, radius: FloatArray, inflow: float, closed: Collection[int]
) -> tuple[FloatArray, FloatArray]:
    """Flow of each vessel and pressure at each node, one inlet, all outlets at 0."""
    length = np.linalg.norm(node[vessel[:, 1]] - node[vessel[:, 0]], axis=1)
    conductance = radius**4 / length
    conductance[list(closed)] = 0.0
    matrix = np.zeros((len(node), len(node)))
    for (a, b), g in zip(vessel.tolist(), conductance.tolist(), strict=True):
        matrix[a, a] += g
        matrix[b, b] += g
        matrix[a, b] -= g
        matrix[b, a] -= g
    right = np.zeros(len(node))
    right[_inlets(vessel)] = inflow
    held = np.setdiff1d(vessel[:, 1], vessel[:, 0])
    free = np.setdiff1d(np.arange(len(node)), held)
    pressure = np.zeros(len(node))
    # Nodes that a closure cuts off have no pressure: least squares leaves them at one.
    pressure[free] = np.linalg.lstsq(matrix[np.ix_(free, free)], right[free], rcond=1e-13)[0]
    flow = conductance * (pressure[vessel[:, 0]] - pressure[vessel[:, 1]])
    flow[np.abs(flow) < 1e-6 * inflow] = 0.0
    return flow, pressure
