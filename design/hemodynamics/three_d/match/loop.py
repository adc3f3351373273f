"""Repeat meshing, 3D flow and radius correction until vessel flows meet their targets.

The reduced model gets every vessel's resistance in 3D in each round (`effective_network`), then
finds the radii at which it has the wanted flows; with these the lumen is meshed and solved again
(space mapping: Bandler et al. 2004, doi 10.1109/TMTT.2003.820904). The reduced model is right
along vessels and wrong by a slowly changing part at junctions, so that two or three rounds do.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from design.hemodynamics.conditions import FlowConditions
from design.hemodynamics.three_d.effective import Effective, effective_network, inflow_of, rescaled
from design.hemodynamics.three_d.jacobian import straighten_edges
from design.hemodynamics.three_d.match.options import MatchedNetwork, MatchOptions, Round
from design.hemodynamics.three_d.match.radii import FreeVessels, free_radii, next_scales
from design.hemodynamics.three_d.match.target import Target, ideal_target
from design.hemodynamics.three_d.mesh import lumen_mesh
from design.hemodynamics.three_d.steady import solve_steady
from design.network import VesselNetwork
from kernels.arrays import FloatArray

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
