"""Networks and walls of the 1D flow cases of Boileau et al. 2015, doi 10.1002/cnm.2732.

Where the inputs come from: the single pulse as restated by github.com/bubnicbf/cfd-python (the
paper's equations 3 and 14 and its table 2); of the three arteries the lengths, resistances,
compliances, viscosity, profile and the inflow in data/ from openBF's models/boileau2015 (and
alemelis/openBF-hub for the bifurcation), which gives the radius at no pressure. The radius, wall
and pressure in diastole behind it (3 mm, 0.3 mm, 700 kPa, 10.9 kPa; 12, 1.2, 400, 9.5; 8.6 and 6,
1.032 and 0.72, 500 and 700, 9.5) are the carotid's in another program's source and the
bifurcation's in svOneDSolver's tests; the aorta's are from memory, and give openBF's radius to
0.1 % as the others do. p = (4/3) E h/r_d² (r - r₀) is the paper's law.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from design.hemodynamics import PulsatileConditions, WindkesselOutlet
from design.hemodynamics.vessel_coefficients import integral_of_power
from design.hemodynamics.waveforms import Tabulated
from design.network import VesselNetwork
from kernels.arrays import FloatArray
from tests.design.hemodynamics.networks import network_of

INFLOW = Path(__file__).parent / "data" / "boileau_inflow_ml_s.csv"
DENSITY, VISCOSITY = 1.06e-3, 4e-3
_SI = 1e-9
"""Pa·s/m³ to Pa·s/µL; m³/Pa to µL/Pa is its inverse."""


@dataclass(frozen=True)
class StiffWall:
    """p = K (r/r₀ - 1) with a K of its own for each vessel, Pa."""

    stiffness: tuple[float, ...]

    def compliance(self, network: VesselNetwork) -> FloatArray:
        return 2.0 * np.pi * integral_of_power(network, 2) / np.array(self.stiffness)


def rest(radius: float, thickness: float, young: float, pressure: float) -> tuple[float, float]:
    """Radius at no pressure and K, from the state in diastole (mm, Pa)."""
    slope = 4.0 / 3.0 * young * thickness / radius**2
    at_rest = radius - pressure / slope
    return at_rest, slope * at_rest


def inflow(column: int, period: float) -> Tabulated:
    values = 1e3 * np.loadtxt(INFLOW, delimiter=",", skiprows=1)[:, column]
    return Tabulated(np.linspace(0.0, period, len(values)), values, interpolation="spline")


def windkessel(proximal: float, distal: float, compliance: float) -> WindkesselOutlet:
    return WindkesselOutlet(proximal * _SI, compliance / _SI, distal * _SI)


def conditions(wave: Tabulated, wall: StiffWall, outlet: WindkesselOutlet) -> PulsatileConditions:
    return PulsatileConditions(VISCOSITY, wave, outlet=outlet, wall=wall, density=DENSITY)


def carotid() -> tuple[VesselNetwork, PulsatileConditions]:
    radius, stiff = rest(3.0, 0.3, 7e5, 10.9e3)
    network = network_of([[0, 0, 0], [126, 0, 0]], [(0, 1)], radius)
    outlet = windkessel(2.4875e8, 1.8697e9, 1.7529e-10)
    return network, conditions(inflow(0, 1.1), StiffWall((stiff,)), outlet)


def aorta() -> tuple[VesselNetwork, PulsatileConditions]:
    radius, stiff = rest(12.0, 1.2, 4e5, 9.5e3)
    network = network_of([[0, 0, 0], [241.37, 0, 0]], [(0, 1)], radius)
    outlet = windkessel(1.1752e7, 1.1167e8, 1.0163e-8)
    return network, conditions(inflow(1, 0.955), StiffWall((stiff,)), outlet)


def bifurcation() -> tuple[VesselNetwork, PulsatileConditions]:
    trunk, stiff = rest(8.6, 1.032, 5e5, 9.5e3)
    iliac, stiffer = rest(6.0, 0.72, 7e5, 9.5e3)
    network = network_of(
        [[0, 0, 0], [86, 0, 0], [146, 60.2, 0], [146, -60.2, 0]],
        [(0, 1), (1, 2), (1, 3)],
        [trunk, iliac, iliac],
    )
    outlet = windkessel(6.8123e7, 3.1013e9, 3.6664e-10)
    return network, conditions(inflow(2, 1.1), StiffWall((stiff, stiffer, stiffer)), outlet)
