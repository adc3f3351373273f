"""Conditions of pulsatile flow: inlet waveform, outlets (pressure, R, Windkessel), wall."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from design.errors import FlowError
from design.hemodynamics.conditions import Supply
from design.hemodynamics.vessel_coefficients import RigidWall, Wall, require_above_zero
from design.hemodynamics.waveforms import Constant, Waveform
from design.units import WATER_DENSITY

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
