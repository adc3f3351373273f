"""Conversion factors to the internal units mm, s, Pa, Pa·s, µL, µL/s; water's density."""

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
PA_S2_MM2_PER_G_CM3: Final = 1e-3
WATER_DENSITY: Final = 1.06e-3
"""Density of water-like media, Pa·s²/mm² (1.06 g/cm³)."""
