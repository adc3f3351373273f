"""Read the physical unit of a recipe key from the key's suffix."""

from __future__ import annotations

from typing import Final

_BY_SUFFIX: Final = {
    "mmhg_min_ml": "mmHg·min/mL",
    "ml_min_per_ml": "mL/min per mL",
    "mol_per_cell_s": "mol/(cell·s)",
    "ml_mmhg": "mL/mmHg",
    "ml_min": "mL/min",
    "mpa_sn": "mPa·sⁿ",
    "mpa_s": "mPa·s",
    "pa_s": "Pa·s",
    "mm2_s": "mm²/s",
    "mm_s": "mm/s",
    "dyn_cm2": "dyn/cm²",
    "per_ml": "per mL",
    "g_cm3": "g/cm³",
    "millimolar": "mmol/L",
    "mmhg": "mmHg",
    "percent": "%",
    "degrees": "°",
    "deg": "°",
    "kpa": "kPa",
    "mm": "mm",
    "um": "µm",
    "ul": "µL",
    "gb": "GB",
    "min": "min",
    "s": "s",
}
"""The longest that fits counts."""


def unit_of(key: str) -> str:
    """The unit that a key's suffix says; empty for none."""
    for suffix, unit in _BY_SUFFIX.items():
        if key.endswith(f"_{suffix}"):
            return unit
    return ""
