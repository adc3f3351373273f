"""Fluid viscosity models: Newtonian, shear-rate dependent, or blood by vessel diameter.

Names are loaded when first asked for: a Newtonian fluid needs no splines.

Goes in: a fluid's constants, a radius, a shear rate. Comes out: apparent viscosity, Pa·s. Begin
with `fluid.py`.
"""

from typing import TYPE_CHECKING

from design.on_demand import on_demand

if TYPE_CHECKING:
    from design.hemodynamics.fluids.carreau import Carreau
    from design.hemodynamics.fluids.fluid import Fluid, Newtonian
    from design.hemodynamics.fluids.power_law import PowerLaw
    from design.hemodynamics.fluids.pries import Pries1994

__all__ = ["Carreau", "Fluid", "Newtonian", "PowerLaw", "Pries1994"]

__getattr__ = on_demand(__name__)


def __dir__() -> list[str]:
    return __all__
