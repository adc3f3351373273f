"""Convert inlet and outlet conditions to known and unknown pressures and flows at nodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.errors import FlowError
from design.hemodynamics.conditions import FlowConditions, PulsatileConditions, Supply
from design.network import VesselNetwork
from kernels import jit
from kernels.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class Boundary:
    """Known and unknown node pressures and flows of a flow problem.

    Attributes
    ----------
    slot : (m,) int64
        Unknown of each node; inlets on one supply share theirs.
    fixed : (s,) bool
        Whether an unknown's pressure is given.
    pressure : (s,) float64, Pa
        The given pressures, 0 elsewhere.
    injected : (s,) float64, µL/s
        Flow into the network at each unknown, where given; what comes back from behind outlets
        at pressures above the lowest, too.
    lowest : float, Pa
        Of the given pressures.
    ground : (s,) float64, µL/(s·Pa), or None
        Conductance behind each unknown to the lowest pressure.
    """

    slot: IntArray
    fixed: NDArray[np.bool_]
    pressure: FloatArray
    injected: FloatArray
    lowest: float
    ground: FloatArray | None = None

    def above_lowest(self) -> FloatArray:
        """Return given pressures above the lowest: most networks' outlets drop out of the sums."""
        return self.pressure if self.lowest == 0.0 else self.pressure - self.lowest

    def at_nodes(self, above_lowest: FloatArray) -> FloatArray:
        """Return pressures of nodes (m,) from those of unknowns (s,), which are changed."""
        if self.lowest != 0.0:
            above_lowest += self.lowest
            above_lowest[self.fixed] = self.pressure[self.fixed]
        if len(self.slot) == len(self.fixed):
            return above_lowest
        return above_lowest[self.slot]


def place_conditions(network: VesselNetwork, conditions: FlowConditions) -> Boundary:
    """Turn `FlowConditions` into unknowns of ``network``.

    Raises `FlowError` for no inlet, no outlet, an unknown node, an isolated part, or pressure
    nowhere given.
    """
    inlets, outlets = checked_ends(network, conditions)
    return place_at(len(network.nodes), inlets, outlets, conditions)


def place_at(
    count: int,
    inlets: IntArray,
    outlets: IntArray,
    conditions: FlowConditions,
    slot: IntArray | None = None,
) -> Boundary:
    """As `place_conditions`, for ``count`` nodes whose ends are known.

    ``slot`` is that of an earlier boundary of the same kind.
    """
    free_outlets, injected = _outflows(count, outlets, conditions)
    fixed, pressure = np.zeros(count, dtype=bool), np.zeros(count)
    fixed[free_outlets], pressure[free_outlets] = True, conditions.outlet_pressure_pa
    for node, behind in conditions.behind.items():
        fixed[node], pressure[node] = behind.resistance == 0.0, behind.pressure_pa
    common, own = supplied_inlets(inlets, conditions.supplies)
    fed = list(zip(own, (supply.flow_ul_s for supply in conditions.supplies), strict=True))
    if conditions.inlet_pressure_pa is not None:
        fixed[common], pressure[common] = True, conditions.inlet_pressure_pa
    elif conditions.inlet_flow_ul_s is not None:
        fed.append((common, conditions.inlet_flow_ul_s))
    for nodes, flow in fed:
        injected[nodes[0]] = flow
    lowest = _lowest(conditions, free_outlets)
    ground = _behind(conditions, injected, pressure, lowest)
    if all(len(nodes) == 1 for nodes, _ in fed):
        alone = np.arange(count) if slot is None else slot
        return Boundary(alone, fixed, pressure, injected, lowest, ground)
    slot = np.arange(count)
    for nodes, _ in fed:
        slot[nodes] = nodes[0]
    slot, fixed, pressure, injected, whole = number_unknowns(
        slot, fixed, pressure, injected, np.zeros(count) if ground is None else ground
    )
    return Boundary(slot, fixed, pressure, injected, lowest, None if ground is None else whole)


def supplied_inlets(
    inlets: IntArray, supplies: Sequence[Supply]
) -> tuple[IntArray, list[IntArray]]:
    """Return inlets on the common supply, and those of each supply of its own.

    Raises `FlowError` for a node that is no inlet or hangs on two supplies, or when none is left
    for the common one.
    """
    taken = np.array([node for supply in supplies for node in supply.inlets], dtype=np.int64)
    strangers = np.setdiff1d(taken, inlets)
    if len(strangers):
        raise FlowError(f"node {int(strangers[0])} has a supply of its own and isn't an inlet")
    if len(np.unique(taken)) < len(taken):
        twice = np.sort(taken)[:-1][np.diff(np.sort(taken)) == 0]
        raise FlowError(f"inlet {int(twice[0])} hangs on two supplies; name it in one")
    common = np.setdiff1d(inlets, taken)
    if len(common) == 0:
        raise FlowError(
            "every inlet has a supply of its own, so that nothing is left for the common one; "
            "leave the largest supply to it"
        )
    return common, [np.array(supply.inlets, dtype=np.int64) for supply in supplies]


def refuse_supplies(supplies: Sequence[Supply], what: str) -> None:
    """Raise `FlowError` where ``what`` knows one supply alone and there are more."""
    if supplies:
        raise FlowError(
            f"{what} knows one supply for all inlets, and {len(supplies)} inlets or groups of "
            "them have their own (flow.supplies, or veins that no artery joins); leave supplies "
            "out, or solve their networks by themselves"
        )


def _lowest(conditions: FlowConditions, free_outlets: IntArray) -> float:
    given = [behind.pressure_pa for behind in conditions.behind.values()]
    if len(free_outlets):
        given.append(conditions.outlet_pressure_pa)
    if conditions.inlet_pressure_pa is not None:
        given.append(conditions.inlet_pressure_pa)
    if not given:
        raise FlowError(
            "every inlet and outlet has a flow, so no pressure is determined; give the inlet a "
            "pressure, or leave one outlet to the pressure of the outlets"
        )
    return min(given)


def _behind(
    conditions: FlowConditions, injected: FloatArray, pressure: FloatArray, lowest: float
) -> FloatArray | None:
    """Conductances behind outlets; what comes from beyond them is added to ``injected``."""
    resists = {n: b for n, b in conditions.behind.items() if b.resistance > 0.0}
    if not resists:
        return None
    ground = np.zeros(len(injected))
    for node, behind in resists.items():
        pressure[node] = 0.0
        ground[node] = 1.0 / behind.resistance
        injected[node] += (behind.pressure_pa - lowest) / behind.resistance
    return ground


def _outflows(
    count: int, outlets: IntArray, conditions: FlowConditions
) -> tuple[IntArray, FloatArray]:
    """Outlets without a condition of their own, and what flows in at each node."""
    injected = np.zeros(count)
    given, behind = conditions.outlet_flow_ul_s, conditions.behind
    if not (given or behind):
        return outlets, injected
    strangers = (set(given) | set(behind)) - set(outlets.tolist())
    if strangers:
        raise FlowError(
            f"node {min(strangers)} isn't one of the outlets, and is given a flow, a pressure or "
            "a resistance of its own"
        )
    twice = set(given) & set(behind)
    if twice:
        raise FlowError(f"outlet {min(twice)} has both a flow and something behind it; give one")
    is_free = np.ones(count, dtype=bool)
    is_free[list(behind)] = False
    for node, flow in given.items():
        injected[node], is_free[node] = -flow, False
    return outlets[is_free[outlets]], injected


def number_unknowns(slot: IntArray, *values: NDArray[Any]) -> tuple[Any, ...]:
    """Unknowns numbered without gaps: each node's, and values of those that are used."""
    used = np.zeros(len(slot), dtype=bool)
    used[slot] = True
    return (np.cumsum(used) - 1)[slot], *(value[used] for value in values)


def boundary_nodes(
    network: VesselNetwork, conditions: FlowConditions | PulsatileConditions
) -> tuple[IntArray, IntArray]:
    """Return inlets and outlets, those of the conditions or the network's own.

    Raises `FlowError` for no inlet, no outlet, an unknown node, a node that is both.
    """
    inlets = _nodes(network, conditions.inlets, network.inlets(), "inlet")
    outlets = _nodes(network, conditions.outlets, network.outlets(), "outlet")
    is_inlet = np.zeros(len(network.nodes), dtype=bool)
    is_inlet[inlets] = True
    both = outlets[is_inlet[outlets]]
    if len(both):
        raise FlowError(f"node {int(both[0])} is both an inlet and an outlet; choose one")
    return inlets, outlets


def _nodes(
    network: VesselNetwork, named: tuple[int, ...] | None, own: IntArray, what: str
) -> IntArray:
    nodes = own if named is None else np.unique(np.array(named, dtype=np.int64))
    if len(nodes) == 0:
        raise FlowError(
            f"the network has no {what}: no node that vessels only "
            f"{'leave' if what == 'inlet' else 'enter'}; name one in {what}s"
        )
    outside = nodes[(nodes < 0) | (nodes >= len(network.nodes))]
    if len(outside):
        raise FlowError(
            f"{what} {int(outside[0])} isn't a node of the network (0 to {len(network.nodes) - 1})"
        )
    return nodes


def checked_ends(
    network: VesselNetwork, conditions: FlowConditions | PulsatileConditions
) -> tuple[IntArray, IntArray]:
    """Return `boundary_nodes` of a network whose every part has an inlet and an outlet.

    Raises `FlowError` for one that hasn't, and for a node without a vessel.
    """
    inlets, outlets = boundary_nodes(network, conditions)
    count = len(network.nodes)
    part, bare = parts_of(network.vessel_nodes, count)
    if bare >= 0:
        raise FlowError(f"node {bare} is isolated: no vessel meets it; remove it")
    for ends, what in ((inlets, "inlet"), (outlets, "outlet")):
        has = np.zeros(count, dtype=bool)
        has[part[ends]] = True
        has = has[part]
        if not has.all():
            cut_off = np.flatnonzero(~has[network.vessel_nodes[:, 0]])
            raise FlowError(
                f"vessel {int(cut_off[0])} lies in an isolated part without {what} "
                f"({len(cut_off)} such vessels of {network.vessel_count}); join it to the "
                f"network, remove it, or name its {what}"
            )
    return inlets, outlets


@jit
def parts_of(ends: IntArray, count: int) -> tuple[IntArray, int]:
    """Return the least node of each node's part, and a node without a vessel, -1 for none.

    Trees of nodes are joined, their paths halved on the way (Tarjan & van Leeuwen 1984).
    """
    part, met = np.arange(count), np.zeros(count, np.bool_)
    for v in range(len(ends)):
        a, b = ends[v, 0], ends[v, 1]
        met[a] = met[b] = True
        while part[a] != a:
            part[a] = part[part[a]]
            a = part[a]
        while part[b] != b:
            part[b] = part[part[b]]
            b = part[b]
        part[max(a, b)] = min(a, b)
    bare = -1
    # Each hangs on a smaller one, so that roots come before what hangs on them.
    for node in range(count):
        part[node] = part[part[node]]
        if not met[node] and bare < 0:
            bare = node
    return part, bare
