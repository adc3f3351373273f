"""Adjust vessel radii until 3D flow divides among the branches as wanted.

Goes in: a network and the flows wanted. Comes out: adjusted radii and the history of the rounds.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from design.errors import FlowError
from design.hemodynamics.conditions import FlowConditions, rescaled
from design.hemodynamics.three_d.engine import FlowOptions
from design.hemodynamics.three_d.meshing.curve import straighten_edges
from design.hemodynamics.three_d.meshing.mesh import MeshOptions, lumen_mesh
from design.hemodynamics.three_d.steady import solve_steady
from design.hemodynamics.three_d.vessels.effective import Effective, effective_network, inflow_of
from design.hemodynamics.zero_d.steady import flow_and_sensitivity, solve_flow
from design.network import VesselNetwork
from kernels.arrays import FloatArray, IntArray


class _Limits(NamedTuple):
    """Limits of the rounds."""

    patience: int = 2  # rounds without a better one
    gain: float = 0.9  # part of the best deviation below which a round is better
    at_bound: float = 1e-4  # of a radius: nearer to a bound it stands there
    same: float = 1e-9  # change of a scale that changes nothing
    stiffness: float = 1e-3  # weight of radii beside flows, so that none changes without need


_LIMITS: Final = _Limits()
Tell = Callable[[float, str], None]


def match_split(
    network: VesselNetwork,
    conditions: FlowConditions,
    target: Target | None = None,
    options: MatchOptions | None = None,
    tell: Tell = lambda share, doing: None,
) -> MatchedNetwork:
    """Change radii until steady flow in 3D has the wanted flows.

    In each round the reduced model gets every vessel's resistance in 3D (`effective_network`), and
    finds the radii at which it has the wanted flows; with these the lumen is meshed and solved
    again (space mapping: Bandler et al. 2004, doi 10.1109/TMTT.2003.820904). Each vessel's radii
    are scaled as a whole. Ends when the tolerance is met, after `MatchOptions.rounds`, or when
    rounds bring nothing more (bounds on radii, or a tolerance finer than meshes are alike).

    Parameters
    ----------
    network : VesselNetwork
    conditions : FlowConditions
    target : Target, optional
        `ideal_target` by default.
    options : MatchOptions, optional
    tell : callable, optional
        Called with the share done and what is being done.

    Raises
    ------
    FlowError
        As `lumen_mesh`, `solve_steady` and `flow_and_sensitivity`; a radius below
        ``least_radius_mm`` to begin with.
    SolidError
        As `lumen_mesh`.
    """
    how = options or MatchOptions()
    wanted = target or ideal_target(network, conditions)
    free = free_radii(network, how)
    scale, rounds = np.ones(network.vessel_count), list[tuple[Effective, Round]]()
    while True:
        history = [each for _, each in rounds]
        off = f"off by {100.0 * history[-1].worst:.2f} % of the inlet's flow" if history else ""
        tell(len(rounds) / how.rounds, f"round {len(rounds) + 1}, {off or 'the design'}")
        effective, round_facts = _round(rescaled(network, scale), conditions, wanted, scale, how)
        rounds.append((effective, round_facts))
        if (
            round_facts.worst <= how.tolerance
            or len(rounds) == how.rounds
            or _stuck([*history, round_facts])
        ):
            break
        scale = next_scales(network, conditions, wanted, effective, free, scale)
        if np.abs(scale - round_facts.scale).max() < _LIMITS.same:
            break
    return _matched(network, wanted, rounds, free, how.tolerance)


def _round(
    network: VesselNetwork,
    conditions: FlowConditions,
    target: Target,
    scale: FloatArray,
    how: MatchOptions,
) -> tuple[Effective, Round]:
    mesh, _ = straighten_edges(lumen_mesh(network, how.mesh))
    solution = solve_steady(mesh, conditions, how.flow)
    effective = effective_network(network, conditions, solution)
    off = np.abs(effective.flow[target.vessel] - target.flow) / inflow_of(network, effective.flow)
    worst = int(np.nanargmax(off))
    return effective, Round(
        float(off[worst]),
        int(target.vessel[worst]),
        scale,
        float(np.ptp(solution.port_pressure)),
        len(mesh.tets),
    )


def _stuck(history: list[Round]) -> bool:
    worst = [each.worst for each in history]
    before, after = worst[: -_LIMITS.patience], worst[-_LIMITS.patience :]
    return bool(before) and min(after) > _LIMITS.gain * min(before)


def _matched(
    network: VesselNetwork,
    target: Target,
    rounds: list[tuple[Effective, Round]],
    free: FreeVessels,
    tolerance: float,
) -> MatchedNetwork:
    history = tuple(one for _, one in rounds)
    turn = int(np.argmin([each.worst for each in history]))
    logs = np.log(history[turn].scale[free.vessel])
    stands = (logs < free.low + _LIMITS.at_bound) | (logs > free.high - _LIMITS.at_bound)
    return MatchedNetwork(
        rescaled(network, history[turn].scale),
        target,
        history,
        turn,
        history[turn].worst <= tolerance,
        tuple(free.vessel[stands].tolist()),
        rounds[turn][0],
    )


@dataclass(frozen=True)
class MatchOptions:
    """Options of adjusting vessel radii to wanted 3D flows.

    Attributes
    ----------
    tolerance : float
        Largest deviation of a wanted flow, of the inlet's flow.
    rounds : int
        Of meshing and solving, at most.
    least_radius_mm : float, mm
        No radius that is changed goes below it: the smallest lumen that can be printed.
    most_change : float
        Factor by which a radius may grow or shrink at most.
    mesh : MeshOptions
    flow : FlowOptions
        By default of order 2, whose error in flows is 1e-4.
    """

    tolerance: float = 0.005
    rounds: int = 6
    least_radius_mm: float = 0.0
    most_change: float = 2.0
    mesh: MeshOptions = field(default_factory=MeshOptions)
    flow: FlowOptions = field(default_factory=lambda: FlowOptions(order=2))

    def __post_init__(self) -> None:
        if not 1e-4 <= self.tolerance <= 0.5:
            raise FlowError(
                f"tolerance {self.tolerance:g} of the inlet's flow; give 0.0001 to 0.5 (3D itself "
                "is right to about 0.0001)"
            )
        if self.rounds < 1 or not 1.0 < self.most_change <= 10.0 or self.least_radius_mm < 0.0:
            raise FlowError(
                f"rounds {self.rounds}, most_change {self.most_change:g}, least_radius_mm "
                f"{self.least_radius_mm:g}: give 1 or more, above 1 up to 10, and 0 or more"
            )


@dataclass(frozen=True)
class Round:
    """Deviations of one mesh's solution.

    Attributes
    ----------
    worst : float
        Largest deviation of a wanted flow, of the inlet's flow.
    vessel : int
        Where.
    scale : (v,) float64
        Radii over the design's.
    pressure_drop_pa : float, Pa
        Largest difference between ports.
    elements : int
    """

    worst: float
    vessel: int
    scale: FloatArray
    pressure_drop_pa: float
    elements: int


@dataclass(frozen=True)
class Target:
    """Target flows of a network.

    Attributes
    ----------
    vessel : (k,) int64
    flow : (k,) float64, µL/s
        From the vessel's first node to its last.
    """

    vessel: IntArray
    flow: FloatArray


@dataclass(frozen=True)
class MatchedNetwork:
    """The network of the best round.

    Attributes
    ----------
    network : VesselNetwork
    target : Target
    history : tuple of Round
        The first is the design.
    best : int
        Round of ``network``.
    met : bool
        Whether the tolerance is met.
    bounded : tuple of int
        Vessels whose radius is at its least or greatest.
    effective : Effective
        Of the best round.
    """

    network: VesselNetwork
    target: Target
    history: tuple[Round, ...]
    best: int
    met: bool
    bounded: tuple[int, ...]
    effective: Effective


def ideal_target(network: VesselNetwork, conditions: FlowConditions) -> Target:
    """Return all vessels' flows in 0D, of the design's own radii.

    Raises
    ------
    FlowError
        As `solve_flow`.
    """
    return Target(np.arange(network.vessel_count), solve_flow(network, conditions).flow)


def outlet_target(
    network: VesselNetwork, conditions: FlowConditions, flows: Mapping[int, float]
) -> Target:
    """Return the flows wanted out of outlets, given by their nodes, µL/s.

    Raises
    ------
    FlowError
        A node that isn't an outlet, a flow that isn't above 0, flows of all outlets whose sum
        isn't the inlet's.
    """
    outlets = network.outlets().tolist()
    for node, flow in flows.items():
        if node not in outlets:
            raise FlowError(f"node {node} is given a flow and isn't an outlet; those are {outlets}")
        if not (np.isfinite(flow) and flow > 0.0):
            raise FlowError(f"the flow wanted out of node {node} is {flow:g} µL/s; give above 0")
    inflow, total = conditions.inlet_flow_ul_s, sum(flows.values())
    whole = set(flows) == set(outlets)
    if inflow is not None and ((whole and abs(total / inflow - 1.0) > 1e-3) or total > inflow):
        raise FlowError(
            f"the flows wanted at outlets sum to {total:g} µL/s and the inlet has {inflow:g}; "
            "give flows that add up to it, or leave one outlet out"
        )
    vessels = [int(np.flatnonzero(network.vessel_nodes[:, 1] == node)[0]) for node in flows]
    return Target(np.array(vessels, np.int64), np.array(list(flows.values()), np.float64))


@dataclass(frozen=True)
class FreeVessels:
    """Vessels whose radii change, and least and greatest logarithm of their scales."""

    vessel: IntArray
    low: FloatArray
    high: FloatArray


def _varied(network: VesselNetwork) -> IntArray:
    outlets = network.outlets()
    tree = network.vessel_count == len(network.nodes) - 1 and len(network.inlets()) == 1
    if tree and len(outlets) > 1:
        return np.flatnonzero(np.isin(network.vessel_nodes[:, 1], outlets))
    return np.arange(network.vessel_count)


def free_radii(network: VesselNetwork, how: MatchOptions) -> FreeVessels:
    """Choose the vessels that may change, and by how much.

    Those that end at outlets where they decide the split (a tree of several outlets); else all.

    Raises
    ------
    FlowError
        A radius below the least to begin with.
    """
    vary = _varied(network)
    thinnest = np.minimum.reduceat(network.radius, network.offset[:-1])[vary]
    below = thinnest < how.least_radius_mm * (1.0 - 1e-9)
    if below.any():
        vessel = int(vary[below][0])
        raise FlowError(
            f"vessel {vessel} has radius {thinnest[below][0]:g} mm, below the least that is to be "
            f"printed, {how.least_radius_mm:g} mm, before any change; widen it, or lower that"
        )
    most = np.log(how.most_change)
    with np.errstate(divide="ignore"):
        low = np.maximum(np.log(how.least_radius_mm / thinnest), -most)
    return FreeVessels(vary, np.minimum(low, 0.0), np.full(len(vary), most))


def next_scales(
    network: VesselNetwork,
    conditions: FlowConditions,
    target: Target,
    effective: Effective,
    free: FreeVessels,
    scale: FloatArray,
) -> FloatArray:
    """Find the scales at which the reduced model with 3D's resistances has the wanted flows."""
    vary, low, inflow = free.vessel, free.low, inflow_of(network, effective.flow)
    log_now = np.log(scale)

    def model(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        logs = log_now.copy()
        logs[vary] = x
        resistance = effective.resistance * np.exp(-4.0 * (logs - log_now))
        flow, slope = flow_and_sensitivity(network, conditions, vary, resistance)
        return flow[target.vessel], slope[target.vessel]

    def residual(x: FloatArray) -> FloatArray:
        return np.concatenate([(model(x)[0] - target.flow) / inflow, _LIMITS.stiffness * x])

    def slope(x: FloatArray) -> FloatArray:
        return np.concatenate([model(x)[1] / inflow, _LIMITS.stiffness * np.eye(len(x))])

    start = np.clip(log_now[vary], low + _LIMITS.same, free.high - _LIMITS.same)
    done = least_squares(residual, start, slope, bounds=(low, free.high), xtol=1e-12, ftol=1e-14)
    after = scale.copy()
    after[vary] = np.exp(np.clip(done.x, low, free.high))
    return after
