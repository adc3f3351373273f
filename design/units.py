"""Conversions at the boundary; inside everything is mm, s, Pa, Pa·s, µL = mm³, µL/s, °C."""

from __future__ import annotations

from typing import Final, Literal

LengthUnit = Literal["um", "mm", "cm", "m", "in"]

MM_PER: Final[dict[LengthUnit, float]] = {
    "um": 1e-3,
    "mm": 1.0,
    "cm": 10.0,
    "m": 1000.0,
    "in": 25.4,
}
"""Millimetres in one of each unit."""

PA_PER_MMHG: Final = 133.322
UL_S_PER_ML_MIN: Final = 1000.0 / 60.0
DYN_CM2_PER_PA: Final = 10.0
PSI_PER_PA: Final = 1.0 / 6894.757
WATER_DENSITY: Final = 1.06e-3
"""Density of water-like media, Pa·s²/mm² (1.06 g/cm³)."""


def mmhg(pressure_pa: float) -> float:
    """Pressure in mmHg from Pa."""
    return pressure_pa / PA_PER_MMHG


def ml_min(flow_ul_s: float) -> float:
    """Flow in mL/min from µL/s."""
    return flow_ul_s / UL_S_PER_ML_MIN
