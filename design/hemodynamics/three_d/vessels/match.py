"""Adjust vessel radii until 3D flow divides among the branches as wanted.

Goes in: a network and the flows wanted. Comes out: adjusted radii and the history of the rounds.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final

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

# Repeat meshing, 3D flow and radius correction until vessel flows meet their targets.
#
# The reduced model gets every vessel's resistance in 3D in each round (`effective_network`), then
# finds the radii at which it has the wanted flows; with these the lumen is meshed and solved again
# (space mapping: Bandler et al. 2004, doi 10.1109/TMTT.2003.820904). The reduced model is right
# along vessels and wrong by a slowly changing part at junctions, so that two or three rounds do.

_PATIENCE: Final = 2
"""Rounds without a better one, after which it ends."""
_GAIN: Final = 0.9
"""Part of the best deviation that a round must come below to count as better."""
_AT_BOUND: Final = 1e-4
"""Of a radius: so near a bound it stands there."""
_SAME: Final = 1e-9
"""Change of a scale below which the next round would be the same."""
Tell = Callable[[float, str], None]


def match_split(
    network: VesselNetwork,
    conditions: FlowConditions,
    target: Target | None = None,
    options: MatchOptions | None = None,
    tell: Tell = lambda share, doing: None,
) -> MatchedNetwork:
    """Change radii until steady flow in 3D has the wanted flows.

    Each vessel's radii are scaled as a whole: tapers stay tapers. Ends when the tolerance is met,
    after `MatchOptions.rounds`, or when rounds bring nothing more (bounds on radii, or a
    tolerance finer than the meshes are alike).

    Parameters
    ----------
    network : VesselNetwork
    conditions : FlowConditions
    target : Target, optional
        `ideal_target` by default.
    options : MatchOptions, optional
    tell : callable, optional
        Told a share done and what is being done.

    Raises
    ------
    FlowError
        As `lumen_mesh`, `solve_steady` and `flow_and_sensitivity`; vessels that the network
        doesn't have, a radius below ``least_radius_mm`` to begin with.
    SolidError
        As `lumen_mesh`.
    """
    how = options or MatchOptions()
    wanted = target or ideal_target(network, conditions)
    free = free_radii(network, how)
    scale, rounds = np.ones(network.vessel_count), list[tuple[Effective, Round]]()
    while True:
        history = [each for _, each in rounds]
        tell(len(rounds) / how.rounds, f"round {len(rounds) + 1}, {_so_far(history)}")
        effective, round_facts = _round(rescaled(network, scale), conditions, wanted, scale, how)
        rounds.append((effective, round_facts))
        if (
            round_facts.worst <= how.tolerance
            or len(rounds) == how.rounds
            or _stuck([*history, round_facts])
        ):
            break
        scale = next_scales(network, conditions, wanted, effective, free, scale)
        if np.abs(scale - round_facts.scale).max() < _SAME:
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
    if len(history) <= _PATIENCE:
        return False
    before = min(each.worst for each in history[:-_PATIENCE])
    return min(each.worst for each in history[-_PATIENCE:]) > _GAIN * before


def _so_far(history: list[Round]) -> str:
    if not history:
        return "the design"
    return f"off by {100.0 * history[-1].worst:.2f} % of the inlet's flow"


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
    stands = (logs < free.low + _AT_BOUND) | (logs > free.high - _AT_BOUND)
    return MatchedNetwork(
        rescaled(network, history[turn].scale),
        target,
        history,
        turn,
        history[turn].worst <= tolerance,
        tuple(free.vessel[stands].tolist()),
        rounds[turn][0],
    )


# Data classes: options, rounds and result of adjusting vessel radii to wanted 3D flows.


@dataclass(frozen=True)
class MatchOptions:
    """Options of adjusting vessel radii to wanted 3D flows.

    Attributes
    ----------
    tolerance : float
        Largest deviation of a wanted flow, of the inlet's flow.
    rounds : int
        Of meshing and solving, at most.
    vary : tuple of int, optional
        Vessels whose radii change. Without it those that end at outlets, where they decide the
        split (a tree of several outlets); else all.
    least_radius_mm : float, mm
        No radius that is changed goes below it: the smallest lumen that can be printed.
    most_change : float
        Factor by which a radius may grow or shrink at most.
    mesh : MeshOptions
    flow : FlowOptions
        Of order 2: its error (1e-4 in flows) is far below any tolerance here.
    """

    tolerance: float = 0.005
    rounds: int = 6
    vary: tuple[int, ...] | None = None
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
    """What one mesh and its solution said.

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


# Set target flows for radius matching: the design's 0D flows, or given outlet flows.


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
        Vessels whose radius stands at its least or greatest.
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
    """Flows of all vessels as the design is meant: 0D of its own radii.

    Raises
    ------
    FlowError
        As `solve_flow`.
    """
    return Target(np.arange(network.vessel_count), solve_flow(network, conditions).flow)


def outlet_target(
    network: VesselNetwork, conditions: FlowConditions, flows: Mapping[int, float]
) -> Target:
    """Flows wanted out of outlets, by their nodes, µL/s.

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


# Choose the vessels to adjust, and compute their next radii from target flows by 0D.

_KEPT: Final = 1e-3
"""Weight of a radius' change beside that of flows, so that no radius changes without need."""
_INSIDE: Final = 1e-9
"""By which the search begins inside its bounds."""


@dataclass(frozen=True)
class FreeVessels:
    """Vessels whose radii change, and least and greatest logarithm of their scales."""

    vessel: IntArray
    low: FloatArray
    high: FloatArray


def _varied(network: VesselNetwork, how: MatchOptions) -> IntArray:
    if how.vary is not None:
        chosen = np.unique(np.array(how.vary, dtype=np.int64))
        strange = chosen[(chosen < 0) | (chosen >= network.vessel_count)]
        if len(strange) or not len(chosen):
            raise FlowError(
                f"vessels to vary: {list(how.vary)}; give some of 0 to {network.vessel_count - 1}"
            )
        return chosen
    outlets = network.outlets()
    tree = network.vessel_count == len(network.nodes) - 1 and len(network.inlets()) == 1
    if tree and len(outlets) > 1:
        return np.flatnonzero(np.isin(network.vessel_nodes[:, 1], outlets))
    return np.arange(network.vessel_count)


def free_radii(network: VesselNetwork, how: MatchOptions) -> FreeVessels:
    """Vessels that may change, and by how much.

    Raises
    ------
    FlowError
        Vessels that the network doesn't have, a radius below the least to begin with.
    """
    vary = _varied(network, how)
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
    """Scales at which the reduced model, resisting as 3D does now, has the wanted flows."""
    vary, low, inflow = free.vessel, free.low, inflow_of(network, effective.flow)
    log_now = np.log(scale)

    def model(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        logs = log_now.copy()
        logs[vary] = x
        resistance = effective.resistance * np.exp(-4.0 * (logs - log_now))
        flow, slope = flow_and_sensitivity(network, conditions, vary, resistance)
        return flow[target.vessel], slope[target.vessel]

    def residual(x: FloatArray) -> FloatArray:
        return np.concatenate([(model(x)[0] - target.flow) / inflow, _KEPT * x])

    def slope(x: FloatArray) -> FloatArray:
        return np.concatenate([model(x)[1] / inflow, _KEPT * np.eye(len(x))])

    start = np.clip(log_now[vary], low + _INSIDE, free.high - _INSIDE)
    done = least_squares(residual, start, slope, bounds=(low, free.high), xtol=1e-12, ftol=1e-14)
    after = scale.copy()
    after[vary] = np.exp(np.clip(done.x, low, free.high))
    return after
