"""Boundary conditions of steady flow in a network: inlets, outlets, fluid, pressure losses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from design.errors import FlowError
from design.hemodynamics.fluids import Fluid, Newtonian
from design.hemodynamics.pressure_drops import Losses
from design.units import WATER_DENSITY


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
        _check(self)


def _check(conditions: FlowConditions) -> None:
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
