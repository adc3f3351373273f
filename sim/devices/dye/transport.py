"""Laminar transport of dye along the lumens, for simulated dye videos.

Modelled: in each vessel Poiseuille's profile, cut into annuli of equal area, each carried at its
own speed by a second-order finite-volume scheme (upwind with minmod slopes); at a node flows mix
wholly, or keep their annulus (`mixing` between 1 and 0 blends the two); occlusions; a feed tube of
some volume. Not modelled: diffusion (Péclet numbers are 10⁴ and more), entrance lengths, secondary
flow in bends, the way streamlines really divide at a bifurcation, pulsation, stretching walls.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from kernels.arrays import FloatArray, IntArray
from sim.devices.dye.lumens import DyeVessels, Occlusion, Stretch, stretch_flow, stretches

ANNULI = 16
_MOST_CELLS, _COURANT, _MOST_STEPS, _FINEST = 160, 0.9, 24, 40.0


@dataclass(frozen=True)
class DyeFlow:
    """A flow that dye can be let into.

    Attributes
    ----------
    parts : sequence of Stretch
        Turned so that flow runs from first to last.
    flow_ul_s : (n,) float64
        Of each, not negative.
    inlets : tuple of int
    feed_s : float, s
        Mean transit of a feed tube before the inlets, entered by the dye at time zero.
    mixing : float
        1: flows mix wholly at nodes; 0: dye stays in its annulus.
    """

    parts: Sequence[Stretch]
    flow_ul_s: FloatArray
    inlets: tuple[int, ...]
    feed_s: float = 0.0
    mixing: float = 1.0

    def entering(self, time_s: float) -> float:
        """Concentration at the inlets; a laminar tube's response to a step, 1 - (T/2t)²."""
        if time_s < self.feed_s / 2.0 or time_s < 0.0:
            return 0.0
        return 1.0 - (self.feed_s / (2.0 * time_s)) ** 2 if self.feed_s > 0.0 else 1.0


def dye_flow(
    lumens: DyeVessels,
    inflow_ul_s: float,
    occlusions: Sequence[Occlusion] = (),
    feed_ul: float = 0.0,
    mixing: float = 1.0,
) -> DyeFlow:
    """Solve the flow of what the occlusions leave.

    Raises
    ------
    ValueError
        When the lumens have no inlet or no outlet.
    """
    first, last = (set(column.tolist()) for column in lumens.vessel_nodes.T)
    inlets, outlets = sorted(first - last), sorted(last - first)
    if not inlets or not outlets:
        raise ValueError("lumens without an inlet or outlet: no node that vessels only leave")
    parts, sinks = stretches(lumens, occlusions)
    flow = stretch_flow(parts, inlets, outlets, inflow_ul_s, sinks)
    turned = [
        part if q >= 0.0 else Stretch(part.points[::-1], part.radius[::-1], part.last, part.first)
        for part, q in zip(parts, flow, strict=True)
    ]
    return DyeFlow(turned, np.abs(flow), tuple(inlets), feed_ul / inflow_ul_s, mixing)


class Transport:
    """Concentrations in cells of equal volume along each stretch, annulus by annulus.

    Attributes
    ----------
    first : (n + 1,) int64
        Cells of stretch ``i`` are ``first[i]:first[i + 1]``.
    dye : (cells, ANNULI) float64
        Concentration, 1 in the feed; the innermost annulus first.
    """

    def __init__(self, flow: DyeFlow, frame_s: float):
        self._flow = flow
        volume = np.array([part.volumes()[-1] for part in flow.parts])
        with np.errstate(divide="ignore"):
            transit = np.where(flow.flow_ul_s > 0.0, volume / flow.flow_ul_s, np.inf)
        quick = float(transit.min()) / _FINEST
        self.steps = int(np.clip(np.ceil(frame_s / (_COURANT * quick)), 1, _MOST_STEPS))
        self._dt = frame_s / self.steps
        with np.errstate(invalid="ignore"):
            count = np.clip(_COURANT * transit / (2.0 * self._dt), 1, _MOST_CELLS).astype(np.int64)
        self.first: IntArray = np.concatenate([[0], np.cumsum(count)])
        share = (np.arange(ANNULI) + 0.5) / ANNULI
        self._profile = 2.0 * (1.0 - share)
        of_cell = np.repeat(np.arange(len(count)), count)
        turnover = (flow.flow_ul_s * self._dt / (volume / count))[of_cell]
        self._courant = np.minimum(turnover[:, None] * self._profile, 1.0)
        self.dye: FloatArray = np.zeros((len(of_cell), ANNULI))
        self._ends = np.array([(p.first, p.last) for p in flow.parts])
        self._time = 0.0

    def frames(self, times_s: FloatArray, start_s: float) -> Iterator[FloatArray]:
        """The concentrations at each of evenly spaced times; dye enters the feed at ``start_s``."""
        self._time = float(times_s[0]) - start_s
        yield self.dye
        for _ in times_s[1:]:
            for _ in range(self.steps):
                self._step()
            yield self.dye

    def _step(self) -> None:
        heads, tails = self.first[:-1], self.first[1:] - 1
        before = np.empty_like(self.dye)
        before[1:] = self.dye[:-1]
        before[heads] = self._at_nodes()[self._ends[:, 0]]
        after = np.empty_like(self.dye)
        after[:-1] = self.dye[1:]
        after[tails] = self.dye[tails]
        low, high = self.dye - before, after - self.dye
        slope = np.where(low * high > 0.0, np.sign(low) * np.minimum(abs(low), abs(high)), 0.0)
        leaving = self._courant * (self.dye + 0.5 * (1.0 - self._courant) * slope)
        entering = np.empty_like(leaving)
        entering[1:] = leaving[:-1]
        entering[heads] = self._courant[heads] * before[heads]
        self.dye = self.dye + entering - leaving
        self._time += self._dt

    def _at_nodes(self) -> FloatArray:
        """Concentration that enters each annulus of what leaves a node, (m, ANNULI)."""
        count = int(self._ends.max()) + 1
        arriving = self.dye[self.first[1:] - 1]
        flow, node = self._flow.flow_ul_s, self._ends[:, 1]
        into = np.bincount(node, weights=flow, minlength=count)
        kept = np.zeros((count, ANNULI))
        np.add.at(kept, node, flow[:, None] * arriving)
        kept /= np.maximum(into, 1e-300)[:, None]
        mixed = kept @ (self._profile / ANNULI)
        made: FloatArray = self._flow.mixing * mixed[:, None] + (1.0 - self._flow.mixing) * kept
        made[list(self._flow.inlets)] = self._flow.entering(self._time)
        return made
