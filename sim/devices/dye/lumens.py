"""Lumens of a simulated dye video: vessels cut at their occlusions, and the flow in each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve

from kernels.arrays import FloatArray, IntArray

_STAGNANT = 1e-9


class DyeVessels(Protocol):
    """Vessels as polylines with a radius at each point, mm; see `design.network`."""

    @property
    def nodes(self) -> FloatArray:
        """Where vessels meet or end, (m, 3), mm."""

    @property
    def vessel_nodes(self) -> IntArray:
        """First and last node of each vessel, (v, 2)."""

    @property
    def offset(self) -> IntArray:
        """Points of vessel i are ``offset[i]:offset[i + 1]``."""

    @property
    def points(self) -> FloatArray:
        """Polylines, (p, 3), mm."""

    @property
    def radius(self) -> FloatArray:
        """Lumen radius at each point, (p,), mm."""


@dataclass(frozen=True)
class Occlusion:
    """Closed vessel of a simulated dye video.

    Attributes
    ----------
    vessel : int
    at : float
        Where, as a share of its length from its first node.
    seep_ul_s : float, µL/s
        What leaks into the gel at the closure; 0 leaves the liquid before it at rest.
    """

    vessel: int
    at: float = 0.5
    seep_ul_s: float = 0.0


@dataclass(frozen=True)
class Stretch:
    """A vessel, or what an occlusion leaves of one.

    Attributes
    ----------
    points : (k, 3) float64, mm
    radius : (k,) float64, mm
    first, last : int
        Nodes.
    """

    points: FloatArray
    radius: FloatArray
    first: int
    last: int

    def along(self) -> FloatArray:
        """Length from the first point to each, (k,), mm."""
        steps = np.linalg.norm(np.diff(self.points, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    def volumes(self) -> FloatArray:
        """Volume from the first point to each, (k,), µL; every piece a frustum."""
        a, b = self.radius[:-1], self.radius[1:]
        parts = np.pi / 3.0 * np.diff(self.along()) * (a * a + a * b + b * b)
        return np.concatenate([[0.0], np.cumsum(parts)])

    def resistance(self) -> float:
        """Poiseuille's at unit viscosity, (8/π) Σ ℓ (a² + ab + b²)/(3 a³ b³), mm⁻³."""
        a, b = self.radius[:-1], self.radius[1:]
        shape = (a * a + a * b + b * b) / (3.0 * (a * b) ** 3)
        return float(8.0 / np.pi * (np.diff(self.along()) * shape).sum())


def stretches(
    lumens: DyeVessels, occlusions: Sequence[Occlusion]
) -> tuple[list[Stretch], dict[int, float]]:
    """All that liquid can stand in, and µL/s that leave at the closed nodes of occlusions.

    What lies behind an occlusion hangs on its last node as a dead end.
    """
    made: list[Stretch] = []
    sinks: dict[int, float] = {}
    closed, fresh = {o.vessel: o for o in occlusions}, len(lumens.nodes)
    for vessel, (first, last) in enumerate(lumens.vessel_nodes.tolist()):
        part = slice(int(lumens.offset[vessel]), int(lumens.offset[vessel + 1]))
        whole = Stretch(lumens.points[part], lumens.radius[part], first, last)
        if vessel not in closed:
            made.append(whole)
            continue
        made += _cut(whole, closed[vessel].at, fresh)
        sinks[fresh] = closed[vessel].seep_ul_s
        fresh += 2
    return made, sinks


def _cut(whole: Stretch, share: float, fresh: int) -> list[Stretch]:
    along = whole.along()
    at = float(np.clip(share, 0.02, 0.98)) * along[-1]
    point = np.array([np.interp(at, along, column) for column in whole.points.T])[None]
    radius = np.interp([at], along, whole.radius)
    before, after = along < at, along > at
    return [
        Stretch(np.vstack([whole.points[before], point]),
                np.append(whole.radius[before], radius), whole.first, fresh),
        Stretch(np.vstack([point, whole.points[after]]),
                np.append(radius, whole.radius[after]), fresh + 1, whole.last),
    ]  # fmt: skip


def stretch_flow(
    parts: Sequence[Stretch],
    inlets: Sequence[int],
    outlets: Sequence[int],
    inflow_ul_s: float,
    sinks: Mapping[int, float],
) -> FloatArray:
    """Flow in each stretch from its first node to its last, (n,), µL/s.

    Kirchhoff's equations, inlets at one pressure, outlets at zero; the inlets' pressure follows
    from the inflow. Shares no code with `design.hemodynamics`.
    """
    ends = np.array([(p.first, p.last) for p in parts])
    used, slot = np.unique(ends, return_inverse=True)
    slot = slot.reshape(ends.shape)
    conductance = 1.0 / np.array([part.resistance() for part in parts])
    held = np.isin(used, [*inlets, *outlets])
    driving = np.isin(used, list(inlets)).astype(np.float64)
    lost = np.array([sinks.get(int(node), 0.0) for node in used])
    pulled = _pressure(slot, conductance, held, driving, np.zeros(len(used)))
    seeping = _pressure(slot, conductance, held, np.zeros(len(used)), lost)
    q = [conductance * (p[slot[:, 0]] - p[slot[:, 1]]) for p in (pulled, seeping)]
    enters = [_leaving(slot, flow, len(used))[driving > 0].sum() for flow in q]
    flow: FloatArray = q[1] + (inflow_ul_s - enters[1]) / enters[0] * q[0]
    flow[np.abs(flow) < _STAGNANT * inflow_ul_s] = 0.0
    return flow


def _leaving(slot: IntArray, flow: FloatArray, count: int) -> FloatArray:
    first, last = (np.bincount(end, weights=flow, minlength=count) for end in slot.T)
    return np.asarray(first - last)


def _pressure(
    slot: IntArray,
    conductance: FloatArray,
    held: NDArray[np.bool_],
    given: FloatArray,
    lost: FloatArray,
) -> FloatArray:
    first, last = slot.T
    rows = np.concatenate([first, last, first, last])
    columns = np.concatenate([first, last, last, first])
    values: Any = np.concatenate([conductance] * 2 + [-conductance] * 2)
    size = len(held)
    matrix = coo_array((values, (rows, columns)), shape=(size, size)).tocsr()
    free = np.flatnonzero(~held)
    pressure = np.where(held, given, 0.0)
    # A stagnant dead end still has a pressure: it hangs on one conductance.
    joined = matrix + coo_array((np.full(size, 1e-15), (np.arange(size),) * 2)).tocsr()
    right = (-lost - matrix @ pressure)[free]
    if len(free):
        pressure[free] = spsolve(joined[free][:, free].tocsc(), right)
    return pressure


# Laminar transport of dye along the lumens, for simulated dye videos.
#
# Modelled: in each vessel Poiseuille's profile, cut into annuli of equal area, each carried at its
# own speed by a second-order finite-volume scheme (upwind with minmod slopes); at a node flows mix
# wholly, or keep their annulus (`mixing` between 1 and 0 blends the two); occlusions; a feed tube
# of some volume. Not modelled: diffusion (Péclet numbers are 10⁴ and more), entrance lengths,
# secondary flow in bends, the way streamlines really divide at a bifurcation, pulsation, stretching
# walls.

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
