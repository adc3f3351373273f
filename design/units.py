"""Conversion factors to the internal units mm, s, Pa, Pa·s, µL, µL/s; blood's viscosity."""

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
CM3_PER_UL: Final = 1e-3
DYN_S_CM5_PER_PA_S_UL: Final = DYN_CM2_PER_PA / CM3_PER_UL
PA_S2_MM2_PER_G_CM3: Final = 1e-3
WATER_DENSITY: Final = 1.06e-3
"""Density of water-like media, Pa·s²/mm² (1.06 g/cm³)."""
BLOOD_MPA_S: Final = 4.0
"""Viscosity of whole blood, mPa·s, wherever none is given: Sexton et al. 2025 (Science 388, 1198,
doi 10.1126/science.adj6152) take it with 1.06 g/cm³ (printed "0.04 cP", meaning poise)."""
