"""Conditions of steady and pulsatile flow; their scaling to a print of another size."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from design.errors import FlowError
from design.hemodynamics.fluids import Fluid, Newtonian, require_above_zero
from design.hemodynamics.pressure_drops import Losses
from design.hemodynamics.vessel_coefficients import RigidWall, Wall
from design.hemodynamics.waveforms import Constant, Waveform
from design.network import VesselNetwork
from design.units import WATER_DENSITY
from kernels.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class OutletLoad:
    """What lies behind an outlet in steady flow; a Windkessel is its two resistances in series.

    Attributes
    ----------
    resistance : float, Pa·s/µL
        0 for none: the outlet itself has the pressure.
    pressure_pa : float, Pa
        Beyond it.
    """

    resistance: float = 0.0
    pressure_pa: float = 0.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.resistance) and self.resistance >= 0.0):
            raise FlowError(
                f"the resistance behind an outlet is {self.resistance:g} Pa·s/µL; give 0 or more"
            )
        if not np.isfinite(self.pressure_pa):
            raise FlowError(f"the pressure behind an outlet is {self.pressure_pa}; give a number")


@dataclass(frozen=True)
class Supply:
    """Inlets on a supply of their own, beside the one that all others share.

    Attributes
    ----------
    inlets : tuple of nodes
        They share a pressure, which follows from the flow.
    flow_ul_s : float, µL/s
        Steady, in pulses too.
    """

    inlets: tuple[int, ...]
    flow_ul_s: float

    def __post_init__(self) -> None:
        if not self.inlets:
            raise FlowError("a supply feeds no inlet; name its inlets")
        if not (np.isfinite(self.flow_ul_s) and self.flow_ul_s > 0.0):
            raise FlowError(f"a supply's flow is {self.flow_ul_s:g} µL/s; give a number above 0")


@dataclass(frozen=True)
class FlowConditions:
    """Conditions at a network's inlets and outlets.

    Give exactly one of the inlet's two, and one of the outlets' two: a flow on both sides would
    leave the pressure undetermined.

    Attributes
    ----------
    viscosity_pa_s : float, Pa·s
        Newtonian; where a fluid is given, a stand-in for what knows no other.
    inlet_flow_ul_s : float, µL/s
        Total into the network. Several inlets hang on one supply: they share its pressure, and
        the flow divides by itself.
    inlet_pressure_pa : float, Pa
        At every inlet.
    outlet_pressure_pa : float, Pa
        At every outlet without a flow of its own.
    outlet_flow_ul_s : mapping of node to µL/s
        Flow out of single outlets; those not named have `outlet_pressure_pa`.
    behind : mapping of node to OutletLoad
        Of single outlets.
    inlets, outlets : tuples of nodes, optional
        Where the network's own (nodes that vessels only leave, or only enter) aren't meant.
    fluid : Fluid, optional
        Whose viscosity isn't one number (`design.hemodynamics.fluids`).
    losses : Losses
        At bifurcations and stenoses; none by default.
    density : float, Pa·s²/mm²
        For losses and Reynolds numbers.
    supplies : tuple of Supply
        Of inlets that don't hang on the common one.
    """

    viscosity_pa_s: float
    inlet_flow_ul_s: float | None = None
    inlet_pressure_pa: float | None = None
    outlet_pressure_pa: float = 0.0
    outlet_flow_ul_s: Mapping[int, float] = field(default_factory=dict)
    inlets: tuple[int, ...] | None = None
    outlets: tuple[int, ...] | None = None
    fluid: Fluid | None = None
    behind: Mapping[int, OutletLoad] = field(default_factory=dict)
    losses: Losses = field(default_factory=Losses)
    density: float = WATER_DENSITY
    supplies: tuple[Supply, ...] = ()

    @property
    def whole_fluid(self) -> Fluid:
        """The fluid, Newtonian where none is given."""
        return self.fluid or Newtonian(self.viscosity_pa_s)

    def __post_init__(self) -> None:
        _check_flow(self)


def _check_flow(conditions: FlowConditions) -> None:
    if not (np.isfinite(conditions.viscosity_pa_s) and conditions.viscosity_pa_s > 0.0):
        raise FlowError(
            f"viscosity {conditions.viscosity_pa_s:g} Pa·s isn't above 0; water has 0.001, "
            "blood about 0.004"
        )
    if (conditions.inlet_flow_ul_s is None) == (conditions.inlet_pressure_pa is None):
        raise FlowError("give either inlet_flow_ul_s or inlet_pressure_pa, and not both")
    values = {
        "inlet_flow_ul_s": conditions.inlet_flow_ul_s,
        "inlet_pressure_pa": conditions.inlet_pressure_pa,
        "outlet_pressure_pa": conditions.outlet_pressure_pa,
        **{f"outlet_flow_ul_s of node {n}": q for n, q in conditions.outlet_flow_ul_s.items()},
    }
    for name, value in values.items():
        if value is not None and not np.isfinite(value):
            raise FlowError(f"{name} is {value}; give a number")


Profile = Literal["poiseuille", "womersley"]


@dataclass(frozen=True)
class PressureOutlet:
    """A pressure, Pa."""

    waveform: Waveform = field(default_factory=lambda: Constant(0.0))


@dataclass(frozen=True)
class ResistanceOutlet:
    """A resistance, Pa·s/µL, to a constant pressure, Pa."""

    resistance: float
    distal_pa: float = 0.0

    def __post_init__(self) -> None:
        require_above_zero("resistance", self.resistance, "Pa·s/µL")
        _finite("distal_pa", self.distal_pa)


@dataclass(frozen=True)
class WindkesselOutlet:
    """Three elements: a resistance, then a compliance to ground beside a second resistance.

    Attributes
    ----------
    proximal, distal : float, Pa·s/µL
    compliance : float, µL/Pa
    distal_pa : float, Pa
        Behind the second resistance.
    """

    proximal: float
    compliance: float
    distal: float
    distal_pa: float = 0.0

    def __post_init__(self) -> None:
        require_above_zero("proximal", self.proximal, "Pa·s/µL")
        require_above_zero("distal", self.distal, "Pa·s/µL")
        require_above_zero("compliance", self.compliance, "µL/Pa")
        _finite("distal_pa", self.distal_pa)


Outlet = PressureOutlet | ResistanceOutlet | WindkesselOutlet


def outlet_groups(
    given: Outlet | Mapping[int, Outlet], outlets: IntArray
) -> list[tuple[Outlet, IntArray]]:
    """Return each condition and the nodes that it stands at: one for all, or one a node.

    Raises
    ------
    FlowError
        For an outlet without a condition, or a condition at another node.
    """
    if not isinstance(given, Mapping):
        return [(given, outlets)]
    bare = np.setdiff1d(outlets, list(given))
    if len(bare):
        raise FlowError(
            f"outlet {int(bare[0])} has no condition ({len(bare)} of {len(outlets)} such); give "
            "it a pressure, a resistance or a Windkessel"
        )
    strangers = sorted(set(given) - set(outlets.tolist()))
    if strangers:
        raise FlowError(f"node {strangers[0]} has a condition and isn't one of the outlets")
    return [(given[int(node)], np.array([node])) for node in outlets]


def outlets_by_node(given: Outlet | Mapping[int, Outlet], outlets: IntArray) -> dict[int, Outlet]:
    """Return the condition of each outlet; raises as `outlet_groups`."""
    return {int(n): outlet for outlet, nodes in outlet_groups(given, outlets) for n in nodes}


@dataclass(frozen=True)
class PulsatileConditions:
    """Conditions at a network's inlets and outlets, fluid and wall.

    Attributes
    ----------
    viscosity_pa_s : float, Pa·s
    inlet : Waveform
        Flow in µL/s of all inlets together, which hang on one supply and share its pressure; or
        the pressure in Pa of each.
    inlet_is : {"flow", "pressure"}
    outlet : Outlet or mapping of node to Outlet
        One for every outlet, or each its own.
    wall : Wall
    profile : {"poiseuille", "womersley"}
        Friction and inertia of each vessel: R and 4/3 of a plug's inertance, the limit of low
        Womersley numbers; or Womersley's impedance at each frequency (periodic solutions only).
    density : float, Pa·s²/mm²
    inlets, outlets : tuples of nodes, optional
        Where the network's own aren't meant.
    supplies : tuple of Supply
        Of inlets that don't hang on the common one; their flow is steady.
    """

    viscosity_pa_s: float
    inlet: Waveform
    inlet_is: Literal["flow", "pressure"] = "flow"
    outlet: Outlet | Mapping[int, Outlet] = field(default_factory=PressureOutlet)
    wall: Wall = field(default_factory=RigidWall)
    profile: Profile = "poiseuille"
    density: float = WATER_DENSITY
    inlets: tuple[int, ...] | None = None
    outlets: tuple[int, ...] | None = None
    supplies: tuple[Supply, ...] = ()

    def __post_init__(self) -> None:
        require_above_zero("viscosity_pa_s", self.viscosity_pa_s, "Pa·s")
        require_above_zero("density", self.density, "Pa·s²/mm²")


def _finite(name: str, value: float) -> None:
    if not np.isfinite(value):
        raise FlowError(f"{name} is {value}; give a number")


def scaled_network(network: VesselNetwork, factor: float) -> VesselNetwork:
    """The network with every length times ``factor``, about the origin.

    In a network scaled by s with the same fluid, Poiseuille's law Δp = 8 μ L Q / (π r⁴) and the
    wall shear τ = 4 μ Q / (π r³) give two ways to keep something:

    ========== ======== ============ ========== =================
    kept       flow     pressure     wall shear Reynolds number
    ========== ======== ============ ========== =================
    wall shear s³ Q     Δp           τ          s² Re
    Reynolds   s Q      Δp / s²      τ / s²     Re
    ========== ======== ============ ========== =================

    A print is perfused at the same wall shear, which is what cells feel; outlet pressures stay.
    """
    if factor == 1:
        return network
    return replace(
        network,
        nodes=network.nodes * factor,
        points=network.points * factor,
        radius=network.radius * factor,
    )


def rescaled(network: VesselNetwork, scale: FloatArray) -> VesselNetwork:
    """The same network, each vessel's radii times ``scale`` (v,)."""
    return replace(network, radius=network.radius * np.repeat(scale, np.diff(network.offset)))


def same_shear_conditions(conditions: FlowConditions, factor: float) -> FlowConditions:
    """Conditions under which the scaled network's wall shear is the design's."""
    if factor == 1:
        return conditions
    flow, outlets = conditions.inlet_flow_ul_s, conditions.outlet_flow_ul_s
    losses = conditions.losses
    narrow = (replace(s, length_mm=s.length_mm * factor) for s in losses.stenoses)
    return replace(
        conditions,
        losses=replace(losses, stenoses=tuple(narrow)),
        behind={
            node: replace(behind, resistance=behind.resistance / factor**3)
            for node, behind in conditions.behind.items()
        },
        supplies=tuple(
            replace(supply, flow_ul_s=supply.flow_ul_s * factor**3)
            for supply in conditions.supplies
        ),
        inlet_flow_ul_s=None if flow is None else flow * factor**3,
        outlet_flow_ul_s={node: out * factor**3 for node, out in outlets.items()},
    )


def scaled_flow(summary: dict[str, float], factor: float) -> dict[str, dict[str, float]]:
    """What the design's flow asks of a print of ``factor``, both ways.

    Parameters
    ----------
    summary : dict
        Of the design, with ``inflow_ml_min`` and ``pressure_drop_mmhg`` (`flow_summary`).
    factor : float

    Returns
    -------
    dict
        ``design``, ``same_wall_shear`` and ``same_reynolds``: flow (mL/min) and pressure (mmHg).
    """
    flow, drop = summary["inflow_ml_min"], summary["pressure_drop_mmhg"]
    return {
        "design": {"inflow_ml_min": flow, "pressure_drop_mmhg": drop},
        "same_wall_shear": {"inflow_ml_min": flow * factor**3, "pressure_drop_mmhg": drop},
        "same_reynolds": {"inflow_ml_min": flow * factor, "pressure_drop_mmhg": drop / factor**2},
    }
