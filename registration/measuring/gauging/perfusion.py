"""Poiseuille flow through the measured lumens, compared with the design."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from design.errors import FlowError
from design.hemodynamics import FlowConditions, resistance_at, solve_flow
from design.network import VesselNetwork
from kernels.arrays import BoolArray, FloatArray, IntArray
from registration.alignment.uncertainty import SectionErrors, pressure_interval
from registration.measuring.gauging.sections import oval_conductance
from registration.measuring.gauging.trace import VesselTrace


@dataclass(frozen=True)
class MeasuredLumen:
    """A vessel's lumen at its stations.

    Attributes
    ----------
    centre : (n, 3) float64, mm
        On the designed axis.
    designed : (n,) float64, mm
        Radius.
    diameter : (n,) float64, mm
        NaN where it wasn't measured, 0 where the lumen is closed.
    ovality : (n,) float64
        Long over short axis; NaN where unknown.
    """

    centre: FloatArray
    designed: FloatArray
    diameter: FloatArray
    ovality: FloatArray

    @property
    def error(self) -> float:
        """Median of measured less designed radius over the open stations, mm; NaN without any."""
        errors = (self.diameter / 2 - self.designed)[self.diameter > 0]
        return float(np.median(errors)) if len(errors) else float("nan")

    def radius(self, error: float) -> FloatArray:
        """As it conducts, (n,), mm; where nothing was measured, the designed one plus ``error``."""
        thinner = oval_conductance(self.ovality) ** 0.25
        filled = np.maximum(self.designed + error, 0.2 * self.designed)
        with np.errstate(invalid="ignore"):
            return np.where(self.diameter > 0, self.diameter / 2 * thinner, filled)


def printed_network(network: VesselNetwork, traces: tuple[VesselTrace, ...]) -> VesselNetwork:
    """The network with the radii that were measured (`network_of_lumens`)."""
    return network_of_lumens(network, [_lumen(trace) for trace in traces])


def _lumen(trace: VesselTrace) -> MeasuredLumen:
    return MeasuredLumen(trace.centre, trace.radius, trace.diameter, trace.sections.ovality)


def with_printed_lengths(network: VesselNetwork, scale: FloatArray) -> VesselNetwork:
    """The network with its axes stretched to the print's size, radii as they are.

    Parameters
    ----------
    network : VesselNetwork
        On the designed axes.
    scale : (3,) float64
        Size of the print over that of the design along x, y, z.
    """
    return replace(network, nodes=network.nodes * scale, points=network.points * scale)


def network_of_lumens(network: VesselNetwork, lumens: Sequence[MeasuredLumen]) -> VesselNetwork:
    """The network with the radii that were measured, a point at each station.

    Where a station wasn't measured (within a junction, unseen) the radius is the designed one
    plus the vessel's mean error, or where it has none, that of all vessels. An oval lumen of equal
    area conducts less: its radius is smaller by the fourth root of `oval_conductance`. A closed
    section has no radius; take closed vessels out (`perfusion` does).
    """
    errors = [lumen.error for lumen in lumens]
    common = np.array([error for error in errors if np.isfinite(error)])
    fallback = float(np.median(common)) if len(common) else 0.0
    points, radii, offset = [], [], [0]
    for vessel, (lumen, error) in enumerate(zip(lumens, errors, strict=True)):
        way, _ = network.polyline(vessel)
        radius = lumen.radius(error if np.isfinite(error) else fallback)
        points += [way[:1], lumen.centre, way[-1:]]
        radii += [radius[:1], radius, radius[-1:]]
        offset.append(offset[-1] + len(radius) + 2)
    return VesselNetwork(
        nodes=network.nodes,
        vessel_nodes=network.vessel_nodes,
        kind=network.kind,
        tree=network.tree,
        offset=np.array(offset),
        points=np.concatenate(points),
        radius=np.concatenate(radii),
    )


def connected_vessels(
    network: VesselNetwork, kept: BoolArray, inlets: tuple[int, ...], outlets: tuple[int, ...]
) -> BoolArray:
    """Of the kept vessels, those that hang together with an inlet and an outlet."""
    rows, columns = network.vessel_nodes[kept].T
    count = len(network.nodes)
    graph = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(count, count))
    _, label = connected_components(graph, directed=False)
    both = np.intersect1d(label[list(inlets)], label[list(outlets)])
    return np.asarray(kept & np.isin(label[network.vessel_nodes[:, 0]], both))


def sub_network(network: VesselNetwork, vessels: IntArray) -> tuple[VesselNetwork, dict[int, int]]:
    """A network of some of the vessels, and the new number of each of their nodes."""
    used, ends = np.unique(network.vessel_nodes[vessels], return_inverse=True)
    lines = [network.polyline(int(vessel)) for vessel in vessels]
    part = VesselNetwork(
        nodes=network.nodes[used],
        vessel_nodes=ends.reshape(-1, 2),
        kind=network.kind[vessels],
        tree=network.tree[vessels],
        offset=np.concatenate([[0], np.cumsum([len(points) for points, _ in lines])]),
        points=np.concatenate([points for points, _ in lines]),
        radius=np.concatenate([radius for _, radius in lines]),
    )
    return part, {int(node): index for index, node in enumerate(used)}


def drop_dead_ends(network: VesselNetwork, kept: BoolArray, ends: IntArray) -> BoolArray:
    """Of the kept vessels, those that don't lead to nowhere but ``ends``, the inlets and outlets.

    Nothing flows in a dead end; left in, it would be taken for an inlet or an outlet.
    """
    kept = kept.copy()
    while True:
        degree = np.bincount(network.vessel_nodes[kept].ravel(), minlength=len(network.nodes))
        degree[ends] += 1
        dead = kept & (degree[network.vessel_nodes] == 1).any(axis=1)
        if not dead.any():
            return kept
        kept &= ~dead


WATER_PA_S = 1e-3
UNIT_FLOW_UL_S = 1.0
_BALANCED = 1e-3
"""Of the network's pressure drop, below which that across a vessel is chance: a rung between two
ways of equal pressures, whose flow small deviations elsewhere turn round."""


@dataclass(frozen=True)
class Perfusion:
    """Flow as designed and as printed, under the same conditions.

    Attributes
    ----------
    resistance_pa_s_ul, designed_resistance_pa_s_ul : (v,) float64, Pa·s/µL
        Of each vessel; inf where closed.
    flow_ul_s, designed_flow_ul_s : (v,) float64, µL/s
        Positive from its first node to its last; 0 where nothing flows.
    share, designed_share : (v,) float64
        Of the flow into the network, by size.
    pressure_drop_pa, designed_pressure_drop_pa : float, Pa
        From the highest inlet to the lowest outlet; NaN where nothing flows.
    inflow_ul_s : float, µL/s
        Through the printed network.
    measured : (v,) bool
        Whether any of the vessel's diameters was measured; where none was, it is taken as wide
        as the other vessels' mean error makes it.
    fed : (v,) bool
        Whether the printed vessel carries at least a hundredth of its designed flow, or any at all
        where its ends' pressures are equal by design.
    perfused : bool or None
        Whether all vessels that carry flow by design are fed; None where one that is fed wasn't
        seen from end to end.
    pressure_ratio : float
        Pressure drop as printed over as designed, at the designed flow.
    pressure_ratio_95 : (low, high)
        Its 95 % interval; NaN where it isn't known.
    """

    resistance_pa_s_ul: FloatArray
    designed_resistance_pa_s_ul: FloatArray
    flow_ul_s: FloatArray
    designed_flow_ul_s: FloatArray
    share: FloatArray
    designed_share: FloatArray
    pressure_drop_pa: float
    designed_pressure_drop_pa: float
    inflow_ul_s: float
    measured: BoolArray
    fed: BoolArray
    perfused: bool | None
    pressure_ratio: float
    pressure_ratio_95: tuple[float, float] = (float("nan"), float("nan"))


def with_interval(flow: Perfusion, vessels: Sequence[SectionErrors]) -> Perfusion:
    """Return a perfusion with the interval of its pressure ratio by the sections' errors."""
    interval = pressure_interval(
        flow.pressure_ratio, flow.resistance_pa_s_ul, flow.flow_ul_s, vessels
    )
    return replace(flow, pressure_ratio_95=interval)


def perfusion(
    network: VesselNetwork,
    traces: tuple[VesselTrace, ...],
    conditions: FlowConditions | None = None,
    scale: FloatArray | None = None,
) -> Perfusion | None:
    """Solve the 0D flow of the network as designed and as printed.

    Parameters
    ----------
    network : VesselNetwork
        The design.
    traces : tuple of VesselTrace
        One a vessel, in its order.
    conditions : FlowConditions, optional
        1 µL/s of water into the inlets by default: the split doesn't depend on it.
    scale : (3,) float64, optional
        Size of the print over that of the design along x, y, z: its lengths.

    Returns
    -------
    Perfusion or None
        None where the design itself has no such flow (no inlet or no outlet).
    """
    driven = conditions or FlowConditions(WATER_PA_S, inlet_flow_ul_s=UNIT_FLOW_UL_S)
    try:
        designed = solve_flow(network, driven)
    except FlowError:
        return None
    inlets = driven.inlets or tuple(network.inlets().tolist())
    outlets = driven.outlets or tuple(network.outlets().tolist())
    as_printed = printed_network(network, traces)
    if scale is not None:
        as_printed = with_printed_lengths(as_printed, scale)
    closed = np.array([bool((t.seen & ~t.sections.open).any()) for t in traces])
    resistance = resistance_at(as_printed, driven.whole_fluid, designed.flow)
    flow, drop = _flow(as_printed, ~closed, inlets, outlets, driven)
    inflow = _inflow(network, flow, inlets)
    designed_in = _inflow(network, designed.flow, inlets)
    carries = np.abs(designed.flow) > 1e-6 * max(designed_in, 1e-300)
    whole = np.array([bool(trace.seen.all()) for trace in traces])
    ends = [designed.pressure[list(nodes)] for nodes in (inlets, outlets)]
    designed_drop = float(ends[0].max() - ends[1].min())
    first, last = designed.pressure[network.vessel_nodes.T]
    fed = fed_vessels(flow, designed.flow, first - last, designed_drop)
    return Perfusion(
        resistance_pa_s_ul=np.where(closed, np.inf, resistance),
        designed_resistance_pa_s_ul=designed.resistance,
        flow_ul_s=flow,
        designed_flow_ul_s=designed.flow,
        share=np.abs(flow) / inflow if inflow > 0 else np.zeros_like(flow),
        designed_share=np.abs(designed.flow) / designed_in,
        pressure_drop_pa=drop,
        designed_pressure_drop_pa=designed_drop,
        inflow_ul_s=inflow,
        measured=np.array([bool(trace.counted.any()) for trace in traces]),
        fed=fed,
        perfused=_verdict(fed[carries], whole[carries]),
        pressure_ratio=_ratio(drop / inflow if inflow > 0 else np.nan, designed_drop / designed_in),
    )


def fed_vessels(
    flow: FloatArray, designed_flow: FloatArray, across_pa: FloatArray, drop_pa: float
) -> BoolArray:
    """Whether each vessel is fed, (v,), by its printed and designed flow.

    Parameters
    ----------
    flow, designed_flow : (v,) float64, µL/s
    across_pa : (v,) float64, Pa
        Designed pressure at its first node less that at its last.
    drop_pa : float, Pa
        Designed, from inlets to outlets.
    """
    enough = np.abs(flow) >= 0.01 * np.abs(designed_flow)
    balanced = np.abs(across_pa) < _BALANCED * drop_pa
    return np.asarray(enough | (balanced & (flow != 0.0)))


def _ratio(printed: float, designed: float) -> float:
    return printed / designed if designed > 0 else float("nan")


def _verdict(fed: BoolArray, whole: BoolArray) -> bool | None:
    if not fed.all():
        return False
    return True if whole.all() else None


def _inflow(network: VesselNetwork, flow: FloatArray, inlets: tuple[int, ...]) -> float:
    """Flow out of the inlets into the network, µL/s."""
    first, last = network.vessel_nodes.T
    return float(flow[np.isin(first, inlets)].sum() - flow[np.isin(last, inlets)].sum())


def _flow(
    network: VesselNetwork,
    kept: BoolArray,
    inlets: tuple[int, ...],
    outlets: tuple[int, ...],
    driven: FlowConditions,
) -> tuple[FloatArray, float]:
    """Flow of each vessel, and the pressure drop, with some vessels taken out."""
    flow = np.zeros(network.vessel_count)
    kept = connected_vessels(network, kept, inlets, outlets)
    if not kept.any():
        return flow, float("nan")
    part, number = sub_network(network, np.flatnonzero(kept))
    sources = tuple(number[node] for node in inlets if node in number)
    sinks = tuple(number[node] for node in outlets if node in number)
    solution = solve_flow(
        part,
        replace(
            driven,
            # Where vessels are taken out their numbers aren't the design's any more.
            losses=replace(driven.losses, stenoses=()),
            behind={number[node]: b for node, b in driven.behind.items() if node in number},
            outlet_flow_ul_s={
                number[node]: q for node, q in driven.outlet_flow_ul_s.items() if node in number
            },
            inlets=sources,
            outlets=sinks,
        ),
    )
    flow[kept] = solution.flow
    drop = solution.pressure[list(sources)].max() - solution.pressure[list(sinks)].min()
    return flow, float(drop)
