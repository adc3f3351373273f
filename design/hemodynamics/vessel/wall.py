"""Vessel wall models (rigid, thin elastic, thick gel): compliance and pulse wave velocity.

Compliance C = dV/dp in µL/Pa, at the radius of rest (small strains).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from design.errors import FlowError
from design.hemodynamics.vessel.geometry import integral_of_power
from design.network import VesselNetwork
from kernels.arrays import FloatArray, IntArray


class Wall(Protocol):
    """Interface of vessel walls: their compliance."""

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
        share = np.where(np.isnan(given), thickness_ratio(radius), given)
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


def thickness_ratio(radius_mm: FloatArray) -> FloatArray:
    """h/r of an artery of radius ``radius_mm``, as `VesselWalls` says."""
    return np.asarray(0.2802 * np.exp(-0.5053 * radius_mm) + 0.1324 * np.exp(-0.01114 * radius_mm))


def wave_speed(inertance: FloatArray, compliance: FloatArray, length: FloatArray) -> FloatArray:
    """Pulse wave velocity ℓ/√(I C) of frictionless waves, (v,), mm/s; infinite where C = 0.

    For a uniform vessel it is Bramwell and Hill's √(A dp/(ϱ dA)).

    Parameters
    ----------
    inertance, compliance, length : (v,) float64, Pa·s²/µL (of a plug), µL/Pa, mm
    """
    with np.errstate(divide="ignore"):
        return np.asarray(length / np.sqrt(inertance * compliance))


def require_above_zero(name: str, value: float, unit: str) -> None:
    """Raise `FlowError` unless a number is finite and above 0."""
    if not (np.isfinite(value) and value > 0.0):
        raise FlowError(f"{name} is {value:g} {unit}; give a number above 0")


def _poisson(value: float) -> None:
    if not 0.0 <= value <= 0.5:
        raise FlowError(f"poisson is {value:g}; Poisson's ratio lies between 0 and 0.5")
