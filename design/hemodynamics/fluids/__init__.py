"""Viscosity of a fluid: Newtonian, by shear rate, or by the vessel's diameter."""

from design.hemodynamics.fluids.carreau import Carreau
from design.hemodynamics.fluids.fluid import Fluid, Newtonian
from design.hemodynamics.fluids.power_law import PowerLaw
from design.hemodynamics.fluids.pries import Pries1994

__all__ = ["Carreau", "Fluid", "Newtonian", "PowerLaw", "Pries1994"]
