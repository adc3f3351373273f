"""Lumens of a simulated dye video: vessels cut at their occlusions, and the flow in each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
