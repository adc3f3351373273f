"""Adjust radii of vessels that connect two trees so that each carries its wanted flow share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array
from scipy.sparse.linalg import lsmr

from design.errors import FlowError
from design.hemodynamics.conditions import FlowConditions, rescaled
from design.hemodynamics.vessel_coefficients import vessel_resistance
from design.hemodynamics.zero_d.boundary import parts_of, place_conditions
from design.hemodynamics.zero_d.nodal import factorise
from design.hemodynamics.zero_d.steady import solve_flow
from design.network import VesselKind, VesselNetwork
from kernels.arrays import FloatArray, IntArray


class BalanceLimits(NamedTuple):
    """Limits of `balance`."""

    spread: float = 0.01
    """Largest difference of two loops' flows over the mean, each divided by its share."""
    resistance_share: float = 0.25
    """Part of its resistance that a connection may be lowered to where there is a choice: a
    radius grows by a factor of √2 at most."""
    imbalance: float = 1e-6
    """Of all flow in connections, that shares may leave over in a part between them."""
    halvings: int = 12
    """Of the flow under a given pressure."""


LIMITS: Final = BalanceLimits()


def loop_vessels(network: VesselNetwork) -> IntArray:
    """Vessels of kind connection: one for each loop.

    Raises
    ------
    FlowError
        When there are none.
    """
    loops = np.flatnonzero(network.kind == VesselKind.CONNECTION)
    if len(loops) == 0:
        raise FlowError("the network has no vessel of kind connection; close its loops first")
    return loops


def flow_spread(
    network: VesselNetwork,
    conditions: FlowConditions,
    shares: Sequence[float] | FloatArray | None = None,
) -> float:
    """(max - min) / mean of the connections' flows, each over its share.

    Raises
    ------
    FlowError
        As `solve_flow`, or for impossible shares.
    """
    loops = loop_vessels(network)
    wanted = _shares(shares, len(loops))
    each = np.abs(solve_flow(network, conditions).flow[loops]) / wanted
    return float(np.ptp(each) / each.mean())


def balance(
    network: VesselNetwork,
    conditions: FlowConditions,
    shares: Sequence[float] | FloatArray | None = None,
    *,
    spread: float = LIMITS.spread,
    smallest_radius_mm: float = 0.0,
    widen: bool = True,
) -> VesselNetwork:
    """Scale each connection's radius so that it carries its share.

    The flow wanted in the connections determines the pressures in all else: with the
    connections taken out and their flows put in at their ends, one linear solve gives the drop Δp
    that each has left. R = Δp/Q is the resistance it needs, and r ~ R^(-1/4) its radius. Where
    no given pressure ties parts of the network together, their levels are chosen to change the
    resistances least; where one ties all, the flow falls until all connections are left enough.
    Trees aren't touched. Connections that become wider lose clearance:
    `design.vasculature.collide` tells whether any loses too much.

    Parameters
    ----------
    shares : (k,), optional
        Of each connection, in the network's order, in any unit; equal by default.
    spread : float
        Allowed `flow_spread` of the result.
    smallest_radius_mm : float
        Below which no radius of a connection may fall.
    widen : bool
        Without it connections are only narrowed, so that none loses clearance: the pressure
        rises at a given inflow, the flow falls at a given pressure.

    Returns
    -------
    VesselNetwork
        Its `flow_spread` is at most ``spread``.

    Raises
    ------
    FlowError
        When shares can't be met: not positive, not as many as connections, against the flow's
        direction or below the smallest radius (with the count), or spread left over; for a fluid
        that isn't Newtonian, losses, or resistances behind outlets.
    """
    _refuse_others(conditions)
    loops = loop_vessels(network)
    wanted = _shares(shares, len(loops))
    resistance = vessel_resistance(network, conditions.viscosity_pa_s)
    needed = _needed(
        network, conditions, loops, wanted, resistance, LIMITS.resistance_share if widen else 1.0
    )
    _refuse_impossible(loops, needed, resistance[loops], widen=widen)
    scale = np.ones(network.vessel_count)
    scale[loops] = (resistance[loops] / needed) ** 0.25
    adjusted = rescaled(network, scale)
    _refuse_thin(adjusted, loops, smallest_radius_mm)
    left = flow_spread(adjusted, conditions, wanted)
    if left > spread:
        raise FlowError(
            f"flow spread {left:.3g} is left after balancing, above {spread:g}; check the "
            "network for vessels of absurd resistance"
        )
    return adjusted


def _refuse_others(conditions: FlowConditions) -> None:
    if conditions.fluid is not None or conditions.losses.any or conditions.behind:
        raise FlowError(
            "loops are balanced for a Newtonian fluid without losses whose outlets have pressures "
            "or flows; leave fluid, losses and what lies behind outlets out"
        )


def _needed(
    network: VesselNetwork,
    conditions: FlowConditions,
    loops: IntArray,
    wanted: FloatArray,
    resistance: FloatArray,
    least: float,
) -> FloatArray:
    """Resistance that gives each connection its share, (k,), Pa·s/mm³."""
    flow = solve_flow(network, conditions).flow
    # Connections may be drawn against the flow; what they carry keeps its direction.
    sign = np.where(flow[loops] < 0, -1.0, 1.0)
    target = sign * wanted * (np.abs(flow[loops]).sum() / wanted.sum())
    for _ in range(LIMITS.halvings):
        drop = _drops(network, conditions, loops, target, resistance, least)
        needed = drop / target
        if conditions.inlet_pressure_pa is None or (needed > least * resistance[loops]).all():
            break
        # Less flow leaves more of the given pressure to the connections.
        target *= 0.5
    return needed


def _refuse_impossible(
    loops: IntArray, needed: FloatArray, resistance: FloatArray, *, widen: bool
) -> None:
    """Raise `FlowError` where a connection needs no resistance, or unduly less than it has."""
    bad = np.flatnonzero(~(needed > 0))
    if len(bad):
        raise FlowError(
            f"{len(bad)} of {len(loops)} connections would need flow against the pressure, first "
            f"vessel {loops[bad[0]]}; the trees take more pressure than there is: ask for shares "
            "nearer to equal, or widen the trees"
        )
    wider = np.flatnonzero(needed < (1.0 - 1e-9) * resistance)
    if len(wider) and not widen:
        raise FlowError(
            f"{len(wider)} of {len(loops)} connections would have to be widened, first vessel "
            f"{loops[wider[0]]}; allow it (widen) and check the clearance, or lower the inlet's "
            "pressure"
        )


def _refuse_thin(network: VesselNetwork, loops: IntArray, smallest_radius_mm: float) -> None:
    """Raise `FlowError` where a connection is thinner than ``smallest_radius_mm``."""
    thin = np.array([network.polyline(int(v))[1].min() for v in loops]) < smallest_radius_mm
    if thin.any():
        raise FlowError(
            f"{int(thin.sum())} of {len(loops)} connections would be thinner than "
            f"{smallest_radius_mm:g} mm, first vessel {loops[int(np.argmax(thin))]}; ask for "
            "shares nearer to equal or thicker connections"
        )


def _shares(shares: Sequence[float] | FloatArray | None, count: int) -> FloatArray:
    if shares is None:
        return np.ones(count)
    given = np.asarray(shares, dtype=np.float64)
    if given.shape != (count,):
        raise FlowError(f"{given.size} shares for {count} connections; give one for each, in order")
    if not (np.isfinite(given).all() and (given > 0).all()):
        raise FlowError(f"a share is {given.min():g}; give positive numbers")
    return given


def _drops(
    network: VesselNetwork,
    conditions: FlowConditions,
    loops: IntArray,
    target: FloatArray,
    resistance: FloatArray,
    least: float,
) -> FloatArray:
    """Pressure drop left to each connection when all carry their target, (k,), Pa.

    Where a single level is free, it leaves each ``least`` times its resistance now.
    """
    boundary = place_conditions(network, conditions)
    ends = boundary.slot[network.vessel_nodes]
    rest = np.ones(network.vessel_count, dtype=bool)
    rest[loops] = False
    known = np.flatnonzero(boundary.fixed)
    # Those of given pressure make one part.
    chained = np.column_stack([known[:-1], known[1:]])
    part, _ = parts_of(np.concatenate([ends[rest], chained]), len(boundary.fixed))
    injected = boundary.injected.copy()
    np.add.at(injected, ends[loops, 0], -target)
    np.add.at(injected, ends[loops, 1], target)
    floating = _floating(part, boundary.fixed, injected, float(np.abs(target).sum()))
    fixed = boundary.fixed.copy()
    fixed[[np.flatnonzero(part == p)[0] for p in floating]] = True
    datum = float(boundary.pressure[boundary.fixed].min())
    given = np.where(boundary.fixed, boundary.pressure - datum, 0.0)
    pressure, _ = factorise(ends[rest], 1.0 / resistance[rest], fixed).solve(injected, given)
    drop = pressure[ends[loops, 0]] - pressure[ends[loops, 1]]
    if len(floating) == 0:
        return np.asarray(drop)
    # Levels c of the floating parts: least squares of (drop + A c) / (R Q) - 1.
    now = resistance[loops] * target
    levels = _levels(part[ends[loops]], floating)
    # To the relative: the levels are free, so that no digits are lost with a rough solution.
    weighted = diags_array(1.0 / now) @ levels
    c = lsmr(weighted, 1.0 - drop / now, atol=1e-10, btol=1e-10)[0]
    along = levels.toarray()[:, 0] * np.sign(target) if len(floating) == 1 else np.zeros(1)
    if (along > 0).all():
        c = np.maximum(c, (np.abs(least * now) - np.sign(target) * drop).max())
    return np.asarray(drop + levels @ c)


def _levels(ends: IntArray, floating: IntArray) -> csr_array:
    """Whose drop (k rows) each floating part's level raises (1) or lowers (-1)."""
    rows, columns, values = [], [], []
    for side, sign in ((0, 1.0), (1, -1.0)):
        at = np.searchsorted(floating, ends[:, side]).clip(max=len(floating) - 1)
        row = np.flatnonzero(floating[at] == ends[:, side])
        rows.append(row)
        columns.append(at[row])
        values.append(np.full(len(row), sign))
    where = (np.concatenate(rows), np.concatenate(columns))
    return csr_array((np.concatenate(values), where), shape=(len(ends), len(floating)))


def _floating(
    part: IntArray, fixed: NDArray[np.bool_], injected: FloatArray, scale: float
) -> IntArray:
    """Parts without a given pressure; what flows into each must flow out of it."""
    fixed_unknowns = np.unique(part[fixed])
    floating = np.setdiff1d(part, fixed_unknowns)
    net = np.bincount(part, weights=injected)
    off = floating[np.abs(net[floating]) > LIMITS.imbalance * scale]
    if len(off):
        raise FlowError(
            f"the shares leave {net[off[0]]:.3g} µL/s over in a part of the network between "
            "connections; give shares that add up there"
        )
    return floating
