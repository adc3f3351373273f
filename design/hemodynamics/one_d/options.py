"""Options of the 1D flow solver: resolution, velocity profile, wall viscosity, convergence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from design.errors import FlowError
from design.hemodynamics.probes import Probes
from kernels.arrays import FloatArray

PARABOLIC = 2.0
"""Exponent ζ of Poiseuille's profile."""


@dataclass(frozen=True)
class OneDOptions:
    """Resolution, profile, wall viscosity and when to stop.

    The velocity profile is u(r) = U (ζ + 2)/ζ (1 - (r/R)^ζ), which fixes the momentum's
    correction α = (ζ + 2)/(ζ + 1) and the friction -2 (ζ + 2) π μ Q/(ϱ A) together: a parabola
    has ζ = 2, α = 4/3 and 8πμ; Boileau et al. 2015 (doi 10.1002/cnm.2732) take ζ = 9, α = 1.1
    and 22πμ for large arteries.

    Attributes
    ----------
    cell_mm : float or (v,) float64, optional
        Length of a cell, or of each vessel's; without it, what a wave runs in
        1/`cells_per_period` of a period.
    cells_per_period : int
        How finely a wave is resolved where ``cell_mm`` isn't given.
    least_cells : int
        In every vessel, however short; 2 or more.
    profile_exponent : float or (v,) float64
        ζ, 2 or more; one, or each vessel's.
    alpha : float, optional
        The momentum's correction, where it isn't to be the profile's.
    wall_viscosity_pa_s : float, Pa·s
        φ of a Kelvin-Voigt wall, stress E ε + φ dε/dt; 0 is an elastic wall.
    reflection : mapping of node to float
        Outlets that send this part of each pressure wave back, -1 (open) to 1 (closed), about
        the pressure that their `PressureOutlet` gives; 0 swallows what comes.
    courant : float
        Steps a wave may run in cells, up to 1.2.
    samples : int
        Of a cycle, in the results.
    tolerance : float
        A state is periodic when a cycle ends as it began, to this part of the swing.
    most_cycles : int
        After which it is given up.
    probes : Probes, optional
    """

    cell_mm: float | FloatArray | None = None
    cells_per_period: int = 800
    least_cells: int = 2
    profile_exponent: float | FloatArray = PARABOLIC
    alpha: float | None = None
    wall_viscosity_pa_s: float = 0.0
    reflection: Mapping[int, float] = field(default_factory=dict)
    courant: float = 0.9
    samples: int = 100
    tolerance: float = 1e-4
    most_cycles: int = 60
    probes: Probes | None = None

    def __post_init__(self) -> None:
        for name, low, high in _LIMITS:
            value = getattr(self, name)
            for one in () if value is None else np.atleast_1d(value).tolist():
                if not low <= one <= high:
                    raise FlowError(f"{name} is {one:g}; give {low:g} to {high:g}")
        for node, part in self.reflection.items():
            if not -1.0 <= part <= 1.0:
                raise FlowError(f"outlet {node} reflects {part:g} of a wave; give -1 to 1")

    def exponents(self, vessels: int) -> FloatArray:
        """ζ of each vessel, (v,)."""
        return np.array(np.broadcast_to(self.profile_exponent, vessels), dtype=np.float64)

    def momentum_alpha(self, vessels: int) -> FloatArray:
        """∫u² dA A/Q² of each vessel's profile, (v,)."""
        zeta = self.exponents(vessels)
        return (zeta + 2.0) / (zeta + 1.0) if self.alpha is None else np.full(vessels, self.alpha)

    def friction(self, vessels: int, viscosity_pa_s: float, density: float) -> FloatArray:
        """2 (ζ + 2) π μ/ϱ of each vessel, (v,), mm²/s: the momentum's loss is this times Q/A."""
        return 2.0 * (self.exponents(vessels) + 2.0) * np.pi * viscosity_pa_s / density


_LIMITS = (
    ("cell_mm", 1e-6, 1e6),
    ("cells_per_period", 10, 1e6),
    ("least_cells", 2, 1e6),
    ("profile_exponent", 2.0, 100.0),
    ("alpha", 1.0, 2.0),
    ("wall_viscosity_pa_s", 0.0, 1e9),
    ("courant", 0.01, 1.2),
    ("samples", 8, 100_000),
    ("tolerance", 1e-12, 0.1),
    ("most_cycles", 1, 1_000_000),
)
