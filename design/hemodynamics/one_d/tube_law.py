"""Compute wall stiffness K of vessels for the 1D tube law p = K (√(A/A₀) - 1).

Both walls give a widening in proportion to the pressure, so both have this law, and it has the
compliance dA/dp = 2 A₀/K at rest that the lumped model has:

- thin wall: hoop stress p r/h = E ε/(1 - ν²) with ε = r/r₀ - 1, its lever taken at rest, gives
  K = E h/((1 - ν²) r₀); with ν = ½ this is β(√A - √A₀)/A₀, β = (4/3)√π E h (Formaggia, Lamponi &
  Quarteroni 2003, doi 10.1023/B:ENGI.0000007980.01347.29);
- lumen in thick gel: Lamé's displacement u = p r₀ (1 + ν)/E gives K = E/(1 + ν), whatever the
  radius. It is for small strains: an incompressible neo-Hookean gel, p = G (ln λ + ½ (1 - λ⁻²))
  with λ = r/r₀ and G = E/3, has the same slope 2G = E/(1 + ν) at rest and is softer by the share
  λ - 1 when it is wider by that share.

The pulse wave velocity is c = √(A/ϱ dp/dA) = √((K + p)/(2ϱ)).

A Kelvin-Voigt wall adds φ dε/dt to its stress E ε (of the gel: to its shear stress), which makes
K ε into K (ε + τ dε/dt) with τ = φ/E: a pressure γ ∂A/∂t with γ = K τ/(2√(A A₀)); for the thin wall
(2/3)√π φ h/(A₀ √A), as in Alastruey et al. 2011, doi 10.1016/j.jbiomech.2011.05.041. Where a
wall's Γ is given instead, γ = Γ/(A₀ √A).
"""

from __future__ import annotations

import numpy as np

from design.errors import FlowError
from design.hemodynamics.vessel.geometry import integral_of_power
from design.hemodynamics.vessel.wall import GelWall, ThinWall, VesselWalls, Wall
from design.network import VesselNetwork
from kernels.arrays import FloatArray, IntArray


def check_compliant(network: VesselNetwork, wall: Wall) -> FloatArray:
    """Compliance of each vessel, (v,), µL/Pa.

    Raises
    ------
    FlowError
        For a wall that gives way nowhere, or not in some vessel.
    """
    compliance = wall.compliance(network)
    rigid = np.flatnonzero(~(compliance > 0.0))
    if len(rigid):
        raise FlowError(
            f"vessel {int(rigid[0])} has a rigid wall ({len(rigid)} of {network.vessel_count}), "
            "in which a wave has no finite speed; give the wall's modulus (wall_young_kpa), or "
            "solve it in 0D"
        )
    return compliance


def stiffness(
    network: VesselNetwork, wall: Wall, vessel: np.ndarray, square: FloatArray, cube: FloatArray
) -> FloatArray:
    """K of pieces of vessels, (n,), Pa.

    Parameters
    ----------
    network : VesselNetwork
    wall : Wall
        One that isn't known here has one stiffness a vessel, by its compliance.
    vessel : (n,) int64
        That each piece belongs to.
    square, cube : (n,) float64, mm², mm³
        Mean of the radius' powers over the piece (at a point, its powers).
    """
    if isinstance(wall, GelWall):
        return np.full(len(square), wall.young_pa / (1.0 + wall.poisson))
    if isinstance(wall, VesselWalls):
        return wall.stiffness(vessel, cube / square)
    if isinstance(wall, ThinWall):
        plate = wall.young_pa * wall.thickness_mm / (1.0 - wall.poisson**2)
        return plate * square / cube
    whole = 2.0 * np.pi * integral_of_power(network, 2) / check_compliant(network, wall)
    return np.asarray(whole[vessel])


def external_pressure(wall: Wall, vessels: int) -> FloatArray:
    """Pressure outside each vessel, (v,), Pa; 0 of walls that know none."""
    if isinstance(wall, VesselWalls):
        return np.array(wall.external_pa)
    return np.zeros(vessels)


def relaxation_time(wall: Wall, wall_viscosity_pa_s: float) -> float:
    """τ = φ/E of a Kelvin-Voigt wall, s.

    Raises
    ------
    FlowError
        For a viscous wall whose modulus isn't known.
    """
    if wall_viscosity_pa_s == 0.0:
        return 0.0
    if isinstance(wall, GelWall | ThinWall):
        return wall_viscosity_pa_s / wall.young_pa
    raise FlowError("wall_viscosity_pa_s needs a thin wall or a gel, whose modulus is known")


def wall_drag(
    wall: Wall, wall_viscosity_pa_s: float, vessel: IntArray, stiff: FloatArray, area: FloatArray
) -> FloatArray:
    """Return γ √A of pieces of vessels, (n,), Pa·s/mm: K τ/(2 √A₀), or Γ/A₀.

    Parameters
    ----------
    wall : Wall
    wall_viscosity_pa_s : float, Pa·s
        φ of a thin wall or a gel.
    vessel : (n,) int64
    stiff, area : (n,) float64
        K, Pa, and A₀, mm².

    Raises
    ------
    FlowError
        As `relaxation_time`.
    """
    drag = stiff * relaxation_time(wall, wall_viscosity_pa_s) / (2.0 * np.sqrt(area))
    if isinstance(wall, VesselWalls):
        drag += wall.damping(vessel, np.sqrt(area / np.pi)) / area
    return np.asarray(drag)
