"""Convert values between internal units and a laboratory's display units (µm, mL/min, mmHg)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray

from design.errors import DesignError
from design.units import DYN_CM2_PER_PA, PA_PER_MMHG, UL_S_PER_ML_MIN

Quantity = Literal["length", "pressure", "flow", "shear"]
Values = TypeVar("Values", float, NDArray[np.float64])

_SIZES: Final[dict[Quantity, dict[str, float]]] = {
    "length": {"mm": 1.0, "µm": 1e-3, "cm": 10.0},
    "pressure": {"Pa": 1.0, "kPa": 1e3, "mmHg": PA_PER_MMHG, "mbar": 100.0},
    "flow": {"µL/s": 1.0, "µL/min": 1.0 / 60.0, "mL/min": UL_S_PER_ML_MIN},
    "shear": {"Pa": 1.0, "dyn/cm²": 1.0 / DYN_CM2_PER_PA},
}
"""Of each quantity its units, and how much of ours (mm, Pa, µL/s, Pa) one of them is."""

_PLAIN: Final = {"um": "µm", "uL/s": "µL/s", "uL/min": "µL/min", "dyn/cm2": "dyn/cm²"}
"""As they are typed where there is no µ."""


@dataclass(frozen=True)
class Units:
    """Which unit each quantity is shown in.

    Attributes
    ----------
    length : "mm", "µm" (or "um"), "cm"
    pressure : "Pa", "kPa", "mmHg", "mbar"
    flow : "µL/s" (or "uL/s"), "µL/min", "mL/min"
    shear : "Pa", "dyn/cm²" (or "dyn/cm2")

    Raises
    ------
    DesignError
        For a unit that isn't one of these.
    """

    length: str = "mm"
    pressure: str = "Pa"
    flow: str = "µL/s"
    shear: str = "Pa"

    def __post_init__(self) -> None:
        for quantity in get_args(Quantity):
            self._size(quantity)

    def of(self, quantity: Quantity, value: Values) -> Values:
        """``value``, a number or an array in mm, Pa or µL/s, in the chosen unit."""
        return value / self._size(quantity)

    def back(self, quantity: Quantity, value: Values) -> Values:
        """``value``, a number or an array in the chosen unit, in mm, Pa or µL/s."""
        return value * self._size(quantity)

    def text(self, quantity: Quantity, value: float, digits: int = 4) -> str:
        """``value`` in the chosen unit, with the unit behind it."""
        return f"{self.of(quantity, value):.{digits}g} {self.name(quantity)}"

    def name(self, quantity: Quantity) -> str:
        """The chosen unit, as it is printed."""
        unit: str = getattr(self, quantity)
        return _PLAIN.get(unit, unit)

    def _size(self, quantity: Quantity) -> float:
        known = _SIZES[quantity]
        if self.name(quantity) not in known:
            raise DesignError(
                f"{quantity} can't be shown in {getattr(self, quantity)!r}; choose one of "
                f"{', '.join(known)}"
            )
        return known[self.name(quantity)]


LAB: Final = Units(length="µm", pressure="mmHg", flow="mL/min")
"""As most who print vessels speak."""
