"""Coefficients of single vessels: resistance, inertance, wall compliance, Womersley factors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.special import jve

from design.errors import FlowError
from design.hemodynamics.fluids import require_above_zero
from design.network import VesselNetwork
from design.units import WATER_DENSITY
from kernels import jit
from kernels.arrays import FloatArray, IntArray

POWERS: Final = {0: 0, 1: 1, 2: 2, 3: 3, -2: 4, -4: 5}
"""Power of the radius to row of `integrals`."""


def integrals(network: VesselNetwork) -> FloatArray:
    """Return ∫ r^power ds over each vessel for all `POWERS`, (6, v), mm^(power + 1)."""
    sums = np.zeros((len(POWERS), network.vessel_count))
    _integrate(
        np.ascontiguousarray(network.points), np.asarray(network.radius), network.offset, sums
    )
    return sums


def integral_of_power(network: VesselNetwork, power: int) -> FloatArray:
    """Return ∫ r^power ds over each vessel, (v,), mm^(power + 1), for one of `POWERS`."""
    return np.asarray(integrals(network)[POWERS[power]])


@jit
def _integrate(points: FloatArray, radius: FloatArray, offset: IntArray, sums: FloatArray) -> None:
    """Piece by piece; NumPy takes ten passes over a million vessels for it."""
    for vessel in range(sums.shape[1]):
        for k in range(offset[vessel], offset[vessel + 1] - 1):
            a, b, square = radius[k], radius[k + 1], 0.0
            for axis in range(3):
                square += (points[k + 1, axis] - points[k, axis]) ** 2
            length, ab = np.sqrt(square), a * b
            second = (a * a + ab + b * b) / 3.0
            sums[0, vessel] += length
            sums[1, vessel] += length * (a + b) / 2.0
            sums[2, vessel] += length * second
            sums[3, vessel] += length * (a + b) * (a * a + b * b) / 4.0
            sums[4, vessel] += length / ab
            sums[5, vessel] += length * second / (ab * ab * ab)


def vessel_resistance(network: VesselNetwork, viscosity_pa_s: float) -> FloatArray:
    """Resistance of each vessel, (v,), Pa·s/µL: viscosity times (8/π) ∫ ds/r⁴.

    Along a piece of length ℓ whose radius goes linearly from a to b the integral is
    ℓ (a² + a b + b²) / (3 a³ b³). Valid for gentle tapers and fully developed laminar flow.

    Raises
    ------
    FlowError
        For a vessel of zero length, or one whose resistance leaves the range of numbers.
    """
    resistance = viscosity_pa_s * (8.0 / np.pi) * integrals(network)[POWERS[-4]]
    refuse_absurd_resistance(network, resistance)
    return resistance


def refuse_absurd_resistance(network: VesselNetwork, resistance: FloatArray) -> None:
    """Raise `FlowError` for a vessel of zero length or a resistance beyond the range of numbers."""
    absurd = np.flatnonzero(~(np.isfinite(resistance) & (resistance > 0.0)))
    if not len(absurd):
        return
    lengths = network.lengths()
    flat = np.flatnonzero(~(lengths > 0.0))
    if len(flat):
        raise FlowError(
            f"vessel {int(flat[0])} has zero length ({len(flat)} such vessels), and so no "
            "resistance; remove it or move its ends apart"
        )
    vessel = int(absurd[0])
    raise FlowError(
        f"vessel {vessel}: resistance {resistance[vessel]:g} Pa·s/µL from length "
        f"{lengths[vessel]:g} mm and radius {network.mean_radius()[vessel]:g} mm; check the "
        "network's unit"
    )


PARABOLIC: Final = 4.0 / 3.0
"""Momentum of a parabolic profile over that of a plug: the limit of low Womersley numbers, where
Womersley's impedance is R + iω (4/3) ϱℓ/(πr²)."""


def plug_inertance(network: VesselNetwork, density: float = WATER_DENSITY) -> FloatArray:
    """ϱ ∫ ds/(π r²) of each vessel, (v,), Pa·s²/µL; ``density`` in Pa·s²/mm²."""
    return density / np.pi * integral_of_power(network, -2)


# In a rigid pipe, after Womersley 1955, doi 10.1113/jphysiol.1955.sp005276.
# With α² = r² ω ϱ/μ and F = 2 J₁(i^{3/2} α) / (i^{3/2} α J₀(i^{3/2} α)), the pressure drop per
# flow is that of Poiseuille times i α²/(8 (1 - F)), and the wall shear per flow that of Poiseuille
# times i α² F/(8 (1 - F)). Both factors go to 1 for α → 0.
ComplexArray = NDArray[np.complex128]


class WomersleyLimits(NamedTuple):
    """Womersley numbers that divide regimes and formulas."""

    quasi_steady: float = 1.0
    """Below it the profile stays a parabola that follows the pressure."""
    series: float = 0.3
    """Below it 1 - F loses digits to cancellation, and the series is right to 1e-10."""


LIMITS: Final = WomersleyLimits()


def womersley_number(
    radius: FloatArray, omega: float, viscosity: FloatArray | float, density: float = WATER_DENSITY
) -> FloatArray:
    """α = r √(ω ϱ/μ); ``radius`` in mm, ``omega`` in rad/s, ``viscosity`` in Pa·s."""
    return np.asarray(radius * np.sqrt(omega * density / np.asarray(viscosity)))


def impedance_factor(alpha: FloatArray) -> ComplexArray:
    """Pressure drop of oscillating flow over Poiseuille's, same shape.

    Its series in s = iα² is that of (s/8) J₀/(J₀ - 2J₁/z), divided out.
    """
    s = 1j * np.asarray(alpha, dtype=np.float64) ** 2
    small = alpha < LIMITS.series
    series = 1.0 + s / 6.0 - s**2 / 1152.0 + s**3 / 34560.0 - 7.0 * s**4 / 6635520.0
    return np.where(small, series, s / 8.0 / (1.0 - _f(np.where(small, 1.0, alpha))))


def shear_factor(alpha: FloatArray) -> ComplexArray:
    """Wall shear of oscillating flow over that of Poiseuille's law, same shape.

    The momentum balance: τ = (r/2) (-dp/dx - iωϱQ/πr²), so the impedance's factor less iα²/8.
    """
    return impedance_factor(alpha) - 0.125j * np.asarray(alpha, dtype=np.float64) ** 2


def _f(alpha: FloatArray) -> ComplexArray:
    z = np.exp(0.75j * np.pi) * alpha
    # The exponentially scaled functions' factors cancel: no overflow at large α.
    return np.asarray(2.0 * jve(1, z) / (z * jve(0, z)))


class Wall(Protocol):
    """Interface of vessel walls: their compliance.

    Compliance C = dV/dp in µL/Pa, at the radius of rest (small strains).
    """

    def compliance(self, network: VesselNetwork) -> FloatArray:
        """Of each vessel, (v,), µL/Pa."""
        ...


@dataclass(frozen=True)
class RigidWall:
    """No compliance: the flow is the same everywhere along a vessel."""

    def compliance(self, network: VesselNetwork) -> FloatArray:
        """Zeros."""
        return np.zeros(network.vessel_count)


@dataclass(frozen=True)
class ThinWall:
    """An elastic tube in nothing that holds it, of constant wall thickness.

    C = 2 π (1 - ν²) ∫ r³ ds / (E h), 3 π ∫ r³ ds / (2 E h) for ν = ½; valid for h ≪ r
    (Westerhof, Stergiopulos & Noble, Snapshots of Hemodynamics, 2010, chapters 9 to 11).

    Attributes
    ----------
    young_pa : float, Pa
    thickness_mm : float, mm
    poisson : float
    """

    young_pa: float
    thickness_mm: float
    poisson: float = 0.5

    def __post_init__(self) -> None:
        require_above_zero("young_pa", self.young_pa, "Pa")
        require_above_zero("thickness_mm", self.thickness_mm, "mm")
        _poisson(self.poisson)

    def compliance(self, network: VesselNetwork) -> FloatArray:
        """Of each vessel, (v,), µL/Pa."""
        stiffness = self.young_pa * self.thickness_mm / (1.0 - self.poisson**2)
        return 2.0 * np.pi / stiffness * integral_of_power(network, 3)


@dataclass(frozen=True)
class GelWall:
    """A lumen in gel much thicker than it is wide.

    Lamé's thick cylinder of infinite outer radius: u(r) = p r (1 + ν)/E, hence
    C = 2 π (1 + ν) ∫ r² ds / E (Timoshenko & Goodier, Theory of Elasticity, section 28).

    Attributes
    ----------
    young_pa : float, Pa
    poisson : float
        ½ for a gel that keeps its volume.
    """

    young_pa: float
    poisson: float = 0.5

    def __post_init__(self) -> None:
        require_above_zero("young_pa", self.young_pa, "Pa")
        _poisson(self.poisson)

    def compliance(self, network: VesselNetwork) -> FloatArray:
        """Of each vessel, (v,), µL/Pa."""
        return 2.0 * np.pi * (1.0 + self.poisson) / self.young_pa * integral_of_power(network, 2)


@dataclass(frozen=True)
class VesselWalls:
    """Thin elastic tubes with a modulus, thickness and outside pressure of each vessel's own.

    p = P + E h/((1 - ν²) r₀) (r/r₀ - 1). Where no thickness is given it follows the radius,
    h = r (a e^{b r} + c e^{d r}) with a = 0.2802, b = -0.5053/mm, c = 0.1324, d = -0.01114/mm, the
    arteries of Boileau et al. 2015 (doi 10.1002/cnm.2732, ADAN56) and of openBF.

    Attributes
    ----------
    young_pa : (v,) float64, Pa
    thickness_mm : (v,) float64, mm
        NaN where it follows the radius.
    external_pa : (v,) float64, Pa
        P, outside.
    poisson : float
    viscous : (v,) bool, optional
        Vessels whose wall adds Γ/(A₀ √A) ∂A/∂t to the pressure, in 1D flow alone.
    """

    young_pa: FloatArray
    thickness_mm: FloatArray
    external_pa: FloatArray
    poisson: float = 0.5
    viscous: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        for value in self.young_pa.tolist():
            require_above_zero("young_pa", value, "Pa")
        for value in self.thickness_mm[~np.isnan(self.thickness_mm)].tolist():
            require_above_zero("thickness_mm", value, "mm")
        _poisson(self.poisson)

    def stiffness(self, vessel: IntArray, radius: FloatArray) -> FloatArray:
        """E h/((1 - ν²) r₀), Pa, at places of radius r₀ (n,), mm, in vessels (n,)."""
        given = self.thickness_mm[vessel] / radius
        by_radius = 0.2802 * np.exp(-0.5053 * radius) + 0.1324 * np.exp(-0.01114 * radius)
        share = np.where(np.isnan(given), by_radius, given)
        return np.asarray(self.young_pa[vessel] / (1.0 - self.poisson**2) * share)

    def damping(self, vessel: IntArray, radius: FloatArray) -> FloatArray:
        """Γ = b₀ + b₁/(2 r₀), Pa·s·mm, at places of radius r₀ (n,), mm, in vessels (n,).

        b₀ = 600 g/s and b₁ = 150 g·cm/s, as openBF has them; 0 where the wall isn't viscous.
        """
        if self.viscous is None:
            return np.zeros(len(radius))
        return np.where(self.viscous[vessel], 600.0 + 1500.0 / (2.0 * radius), 0.0)

    def compliance(self, network: VesselNetwork) -> FloatArray:
        """Of each vessel, (v,), µL/Pa: 2 π ∫ r²/K ds, by Gauss' rule of five on each piece."""
        start, end, r0, r1, vessel = network.pieces()
        length = np.linalg.norm(end - start, axis=1)
        whole = np.zeros(len(length))
        for at, weight in zip(*np.polynomial.legendre.leggauss(5), strict=True):
            radius = r0 + 0.5 * (1.0 + at) * (r1 - r0)
            whole += 0.5 * weight * length * radius**2 / self.stiffness(vessel, radius)
        each = np.bincount(vessel, weights=whole, minlength=network.vessel_count)
        return np.asarray(2.0 * np.pi * each)


def wave_speed(inertance: FloatArray, compliance: FloatArray, length: FloatArray) -> FloatArray:
    """Pulse wave velocity ℓ/√(I C) of frictionless waves, (v,), mm/s; infinite where C = 0.

    For a uniform vessel it is Bramwell and Hill's √(A dp/(ϱ dA)).

    Parameters
    ----------
    inertance, compliance, length : (v,) float64, Pa·s²/µL (of a plug), µL/Pa, mm
    """
    with np.errstate(divide="ignore"):
        return np.asarray(length / np.sqrt(inertance * compliance))


def _poisson(value: float) -> None:
    if not 0.0 <= value <= 0.5:
        raise FlowError(f"poisson is {value:g}; Poisson's ratio lies between 0 and 0.5")
