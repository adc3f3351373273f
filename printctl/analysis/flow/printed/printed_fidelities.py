"""Solve 0D, 1D or 3D flow per vessel, and tabulate designed lumens against printed ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from design.hemodynamics import (
    FlowConditions,
    OneDOptions,
    PulsatileConditions,
    ShearBand,
    solve_flow,
    solve_one_d,
)
from design.hemodynamics.probes import Probes, clear_parts
from design.hemodynamics.three_d import (
    LumenMesh,
    probe_steady,
    solve_steady,
    straighten_edges,
)
from design.hemodynamics.three_d.meshing.mesh import MeshOptions, lumen_mesh
from design.hemodynamics.three_d.vessels.sections import vessel_flows
from design.network import VesselNetwork
from design.units import DYN_CM2_PER_PA, PA_PER_MMHG, UL_S_PER_ML_MIN
from kernels.arrays import FloatArray
from printctl.analysis.flow.printed.as_printed import OpenPart, PrintedNetwork
from printctl.analysis.flow.three_d import SHARP, options_of, wall_shear_of_vessels
from printctl.recipe.parts import ThreeDPart

_MOST_CLEAR: Final = 0.4
_NO_FLOW: Final = 1e-3
"""Of the inflow, below which a vessel's resistance in 3D is the mesh's errors over one another."""


@dataclass(frozen=True)
class VesselFlow:
    """What a fidelity says of each vessel.

    Attributes
    ----------
    resistance : (v,) float64, Pa·s/µL
        Pressure lost over flow; inf where nothing flows. In 3D that of the part clear of
        junctions, for the whole length, and NaN where next to nothing flows.
    flow : (v,) float64, µL/s
        Mean of a cycle; in 3D NaN where it isn't known (`vessel_flows`).
    wall_shear : (v,) float64, Pa
        Mean by size.
    drop_pa : float, Pa
        From the highest inlet to the lowest outlet, mean of a cycle.
    inflow_ul_s : float, µL/s
    """

    resistance: FloatArray
    flow: FloatArray
    wall_shear: FloatArray
    drop_pa: float
    inflow_ul_s: float

    @property
    def share(self) -> FloatArray:
        """Of what flows in, by size, (v,)."""
        return np.abs(self.flow) / self.inflow_ul_s

    def of_design(self, part: OpenPart, count: int) -> VesselFlow:
        """The same by the design's numbers; vessels that are closed or led nowhere have no flow."""
        resistance, flow, shear = np.full(count, np.inf), np.zeros(count), np.zeros(count)
        resistance[part.vessel] = self.resistance
        flow[part.vessel] = part.sign * self.flow
        shear[part.vessel] = self.wall_shear
        return VesselFlow(resistance, flow, shear, self.drop_pa, self.inflow_ul_s)


@dataclass(frozen=True)
class FlowIntervals:
    """Low and high end of what a `VesselFlow` says: (2, v), and (2,) of the whole network."""

    resistance: FloatArray
    flow: FloatArray
    wall_shear: FloatArray
    share: FloatArray
    drop_pa: FloatArray
    inflow_ul_s: FloatArray


@dataclass(frozen=True)
class Pair:
    """A fidelity's answers for the same vessels.

    Attributes
    ----------
    designed, printed : VesselFlow
    ends : FlowIntervals or None
        95 % intervals of the printed one; None where a lumen's isn't known.
    """

    designed: VesselFlow
    printed: VesselFlow
    ends: FlowIntervals | None = None


def lumped(network: VesselNetwork, conditions: FlowConditions) -> VesselFlow:
    """0D: Poiseuille's, with the fluid and the losses that the conditions name.

    Raises
    ------
    FlowError
        As `solve_flow`.
    """
    flow = solve_flow(network, conditions)
    return VesselFlow(
        flow.resistance,
        flow.flow,
        np.abs(flow.wall_shear),
        _drop(network, flow.pressure),
        _inflow(network, flow.flow),
    )


def mean_one_d(
    network: VesselNetwork, conditions: PulsatileConditions, options: OneDOptions
) -> VesselFlow:
    """1D: means of the periodic state.

    Raises
    ------
    FlowError
        As `solve_one_d`.
    """
    solution = solve_one_d(network, conditions, options)
    first, last = solution.pressure_in.mean(axis=1), solution.pressure_out.mean(axis=1)
    flow = solution.flow.mean(axis=1)
    pressure = np.zeros(len(network.nodes))
    pressure[network.vessel_nodes] = np.column_stack([first, last])
    shear = np.abs(solution.wall_shear(conditions.viscosity_pa_s)).mean(axis=1)
    return VesselFlow(
        _over(first - last, flow), flow, shear, _drop(network, pressure), _inflow(network, flow)
    )


def in_space(
    network: VesselNetwork, mesh: LumenMesh, conditions: FlowConditions, part: ThreeDPart
) -> VesselFlow:
    """3D: steady flow in a lumen's mesh.

    Raises
    ------
    FlowError
        As `solve_steady`.
    """
    mesh = straighten_edges(mesh)[0]
    solution = solve_steady(mesh, conditions, options_of(part, conditions.density))
    every = np.arange(network.vessel_count)
    places = _apart(network)
    probes = Probes(np.repeat(every, 3), places.ravel())
    pressure = probe_steady(network, probes, solution.field).pressure[:, 0].reshape(-1, 3)
    between = places[:, 2] - places[:, 0]
    lost = (pressure[:, 0] - pressure[:, 2]) / between
    flow = vessel_flows(network, solution)
    ports = solution.port_flow
    inflow = -float(ports[ports < 0.0].sum())
    return VesselFlow(
        np.where(np.abs(flow) < _NO_FLOW * inflow, np.nan, _over(lost, flow)),
        flow,
        wall_shear_of_vessels(network, solution)[0],
        float(np.ptp(solution.port_pressure)),
        inflow,
    )


def _apart(network: VesselNetwork) -> FloatArray:
    """Shares of each vessel's length, (v, 3): two places well within it, and its middle.

    Two radii further in than what is clear of junctions: a section is a slab that reaches to the
    sides, and vessels that meet at a sharp angle part late.
    """
    shares = np.full((network.vessel_count, 3), 0.5)
    more = 2.0 * network.mean_radius() / network.lengths()
    for vessel in range(network.vessel_count):
        first, last = clear_parts(network)[vessel]
        shares[vessel, 0] = min(first + more[vessel], _MOST_CLEAR)
        shares[vessel, 2] = max(last - more[vessel], 1.0 - _MOST_CLEAR)
    return shares


def mesh_of(network: VesselNetwork, part: ThreeDPart, fillet_ratio: float) -> LumenMesh:
    """Round lumens of a network.

    Raises
    ------
    FlowError, SolidError
        As `lumen_mesh`.
    """
    shape = MeshOptions(edge_ratio=part.edge_ratio, fillet_ratio=max(fillet_ratio, SHARP))
    return lumen_mesh(network, shape)


def _over(lost: FloatArray, flow: FloatArray) -> FloatArray:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(np.abs(flow) > 0.0, lost / flow, np.inf))


def _drop(network: VesselNetwork, pressure: FloatArray) -> float:
    return float(pressure[network.inlets()].max() - pressure[network.outlets()].min())


def _inflow(network: VesselNetwork, flow: FloatArray) -> float:
    return float(flow[np.isin(network.vessel_nodes[:, 0], network.inlets())].sum())


def printed_table(
    design: VesselNetwork, printed: PrintedNetwork, pairs: Mapping[str, Pair]
) -> dict[str, Any]:
    """Columns of `flow_as_printed.csv`, a row a fidelity and vessel."""
    blocks = [_block(design, printed, name, pair) for name, pair in pairs.items()]
    return {key: np.concatenate([block[key] for block in blocks]) for key in blocks[0]}


def _block(design: VesselNetwork, printed: PrintedNetwork, name: str, pair: Pair) -> dict[str, Any]:
    count, one, other = design.vessel_count, pair.designed, pair.printed
    ends = _known(pair, count)
    wide, seen = 2e3 * design.mean_radius(), 2e3 * printed.network.mean_radius()
    seen = np.where(printed.closed, 0.0, seen)
    with np.errstate(divide="ignore", invalid="ignore"):
        return {
            "fidelity": np.full(count, name),
            "vessel": np.arange(count),
            "open": ~printed.closed,
            "measured": printed.measured,
            "designed_diameter_um": wide,
            "diameter_um": seen,
            "diameter_off_percent": 100.0 * (seen / wide - 1.0),
            "designed_resistance_pa_s_ul": one.resistance,
            "resistance_pa_s_ul": other.resistance,
            **_low_high("resistance_pa_s_ul", ends.resistance),
            "resistance_ratio": other.resistance / one.resistance,
            "designed_flow_ml_min": one.flow / UL_S_PER_ML_MIN,
            "flow_ml_min": other.flow / UL_S_PER_ML_MIN,
            **_low_high("flow_ml_min", ends.flow / UL_S_PER_ML_MIN),
            "designed_share": one.share,
            "share": other.share,
            **_low_high("share", ends.share),
            "share_off_percent_of_inflow": 100.0 * (other.share - one.share),
            "designed_wall_shear_dyn_cm2": one.wall_shear * DYN_CM2_PER_PA,
            "wall_shear_dyn_cm2": other.wall_shear * DYN_CM2_PER_PA,
            **_low_high("wall_shear_dyn_cm2", ends.wall_shear * DYN_CM2_PER_PA),
            "wall_shear_ratio": other.wall_shear / one.wall_shear,
        }


def _known(pair: Pair, count: int) -> FlowIntervals:
    """A pair's intervals; NaN where they aren't known."""
    if pair.ends is not None:
        return pair.ends
    each, whole = np.full((2, count), np.nan), np.full(2, np.nan)
    return FlowIntervals(each, each, each, each, whole, whole)


def _low_high(name: str, ends: FloatArray) -> dict[str, FloatArray]:
    """Columns of a quantity's 95 % interval."""
    return {f"{name}_low": ends[0], f"{name}_high": ends[1]}


def printed_summary(
    printed: PrintedNetwork, pairs: Mapping[str, Pair], band: ShearBand | None
) -> Any:
    """What the print does to the flow, by fidelity."""
    summary: dict[str, Any] = {
        "vessels": len(printed.closed),
        "closed_vessels": np.flatnonzero(printed.closed).tolist(),
        "unmeasured_vessels": int((~printed.measured).sum()),
    }
    return summary | {name: _pair_numbers(pair, band) for name, pair in pairs.items()}


def _pair_numbers(pair: Pair, band: ShearBand | None) -> dict[str, Any]:
    one, other = pair.designed, pair.printed
    ends = _known(pair, len(one.flow))
    change = 100.0 * (other.share - one.share)
    worst = int(np.argmax(np.abs(np.nan_to_num(change))))
    numbers: dict[str, Any] = {
        "designed_pressure_drop_mmhg": one.drop_pa / PA_PER_MMHG,
        "pressure_drop_mmhg": other.drop_pa / PA_PER_MMHG,
        "pressure_drop_mmhg_interval_95": _interval(ends.drop_pa / PA_PER_MMHG),
        "pressure_drop_ratio": other.drop_pa / one.drop_pa,
        "pressure_drop_ratio_interval_95": _interval(ends.drop_pa / one.drop_pa),
        "inflow_ratio": other.inflow_ul_s / one.inflow_ul_s,
        "inflow_ratio_interval_95": _interval(ends.inflow_ul_s / one.inflow_ul_s),
        "worst_share_off_percent_of_inflow": float(change[worst]),
        "worst_share_off_interval_95": _interval(100.0 * (ends.share[:, worst] - one.share[worst])),
        "worst_share_vessel": worst,
    }
    if band is not None:
        numbers["designed_in_shear_band"] = _inside(one, band)
        numbers["in_shear_band"] = _inside(other, band)
    return numbers


def _interval(ends: FloatArray) -> list[float] | None:
    """A 95 % interval as JSON; None where it isn't known."""
    if not np.isfinite(ends).all():
        return None
    return [float(f"{end:.5g}") for end in ends]


def _inside(flow: VesselFlow, band: ShearBand) -> float:
    """Share of vessels; closed ones are outside."""
    shear = flow.wall_shear
    return float(((shear >= band.low_pa) & (shear <= band.high_pa) & (flow.flow != 0.0)).mean())
