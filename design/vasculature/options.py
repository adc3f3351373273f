"""What a user may ask of a grown tree."""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import pi
from typing import NamedTuple

import numpy as np

from design.errors import GrowthError
from design.units import PA_PER_MMHG


class Law(NamedTuple):
    """The constants of the cost, as kernels take them.

    Attributes
    ----------
    k : float, Pa·s
        8 μ / π.
    gamma, lam, u : float
        Murray exponent, and exponents of radius and length in the cost.
    """

    k: float
    gamma: float
    lam: float
    u: float


@dataclass(frozen=True)
class GrowthOptions:
    """How a tree is grown.

    Attributes
    ----------
    terminals : int
        How many, all with the same flow.
    seed : int
        Of the sampled points; same seed and tissue, same tree.
    murray_exponent : float
        γ, 2 to 3.5.
    length_exponent, radius_exponent : float
        u and λ of the cost Σ ℓᵘ r^λ; 1 and 2 make it the volume.
    viscosity_pa_s : float
        μ, Newtonian.
    pressure_drop_pa : float
        From the root's inlet to every terminal's outlet; sets the scale of all radii unless
        ``smallest_radius_mm`` does.
    perfusion_ml_min_per_ml : float
        Flow per tissue volume, shared equally by the terminals.
    root_point_mm, root_direction : (float, float, float), optional
        Where the root enters, and which way. The default is the surface vertex of largest z and
        its inward normal.
    smallest_radius_mm : float, optional
        Fixes the smallest radius of the finished tree; the pressure drop follows.
    terminal_spread : float, optional
        With ``smallest_radius_mm``: how much wider than the smallest terminal the terminals may be
        on average (in the mean of order γ). Candidates that would make a thinner one are refused;
        the root's radius is about spread x smallest x terminals^(1/γ). Several are tried by
        default.
    clearance_mm, clearance_ratio : float
        Between vessels, the larger of ``clearance_mm`` and ``clearance_ratio`` times the thinner
        radius; ``clearance_mm`` also between vessels and the tissue's surface.
    length_to_radius : float
        Shortest segment over its radius.
    """

    terminals: int = 200
    seed: int = 1
    murray_exponent: float = 3.0
    length_exponent: float = 1.0
    radius_exponent: float = 2.0
    viscosity_pa_s: float = 4e-3
    pressure_drop_pa: float = 40.0 * PA_PER_MMHG
    perfusion_ml_min_per_ml: float = 0.8
    root_point_mm: tuple[float, float, float] | None = None
    root_direction: tuple[float, float, float] | None = None
    smallest_radius_mm: float | None = None
    terminal_spread: float | None = None
    clearance_mm: float = 0.0
    clearance_ratio: float = 0.1
    length_to_radius: float = 1.0

    def __post_init__(self) -> None:
        for name, low, high in _LIMITS:
            value = getattr(self, name)
            if value is not None and not low <= value <= high:
                raise GrowthError(f"{name} is {value:g}; give a value from {low:g} to {high:g}")
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, tuple) and not (len(value) == 3 and np.isfinite(value).all()):
                raise GrowthError(f"{field.name} is {value}; give three finite numbers")
        if self.root_direction is not None and not np.any(self.root_direction):
            raise GrowthError("root_direction is (0, 0, 0); give a direction")

    @property
    def law(self) -> Law:
        """The cost's constants."""
        return Law(
            8.0 * self.viscosity_pa_s / pi,
            self.murray_exponent,
            self.radius_exponent,
            self.length_exponent,
        )

    def flow_ul_s(self, volume_mm3: float) -> float:
        """Flow into the root for a tissue of ``volume_mm3``, µL/s."""
        return self.perfusion_ml_min_per_ml * volume_mm3 / 60.0


_LIMITS = (
    ("terminals", 1, 50_000_000),
    ("seed", 0, 2**63),
    ("murray_exponent", 2.0, 3.5),
    ("length_exponent", 0.25, 4.0),
    ("radius_exponent", 0.25, 4.0),
    ("viscosity_pa_s", 1e-5, 1e3),
    ("pressure_drop_pa", 1e-6, 1e9),
    ("perfusion_ml_min_per_ml", 1e-6, 1e4),
    ("smallest_radius_mm", 1e-4, 10.0),
    ("terminal_spread", 1.01, 10.0),
    ("clearance_mm", 0.0, 10.0),
    ("clearance_ratio", 0.0, 10.0),
    ("length_to_radius", 0.0, 100.0),
)
