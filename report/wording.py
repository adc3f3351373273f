"""Format numbers, labels and units for the report."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

from registration.json_ready import is_number

MISSING: Final = "–"

_UNITS: Final = {
    "_millimolar": "mM", "_nmol_s": "nmol/s",
    "_pa_s_ul": "Pa·s/µL", "_per_mm2": "1/mm²", "_uw": "µW",
    "_ml_min": "mL/min", "_mm_s": "mm/s", "_ul_s": "µL/s", "_pa_s": "Pa·s", "_mmhg": "mmHg",
    "_mm3": "mm³", "_mm2": "mm²", "_percent": "%", "_kpa": "kPa", "_psi": "psi", "_deg": "°",
    "_pa": "Pa", "_um": "µm", "_mm": "mm", "_ul": "µL", "_mb": "MB", "_ml": "mL", "_s": "s",
    "_c": "°C", "_dyn_cm2": "dyn/cm²",
}  # fmt: skip
_WORDS: Final = {
    "rms": "RMS", "sd": "SD", "p95": "95th percentile", "id": "ID", "min": "min.", "max": "max.",
    "gcode": "G-code", "fresh": "FRESH", "oct": "OCT", "microct": "micro-CT", "x": "x", "y": "y",
    "z": "z", "mb": "MB", "os": "OS", "cpu": "CPU", "stl": "STL", "sha256": "SHA-256", "um": "µm",
    "p5": "5th percentile",
}  # fmt: skip


def fixed(value: Any, decimals: int) -> str:
    """A number with a fixed number of decimals, thin spaces in thousands, and a true minus."""
    if not is_number(value):
        return MISSING
    text = f"{value:,.{decimals}f}"
    if not text.strip("-0.,"):
        text = text.lstrip("-")
    return text.replace(",", "\u202f").replace("-", "\u2212")


def number(value: Any, digits: int = 4) -> str:
    """A number with ``digits`` significant digits, whole numbers in full.

    Anything that isn't a finite number becomes an en dash.
    """
    if not is_number(value):
        return MISSING
    if isinstance(value, int) or value == 0:
        return fixed(value, 0)
    power = math.floor(math.log10(abs(value)))
    if not -4 <= power < 9:
        mantissa = fixed(value / 10.0**power, digits - 1)
        return f"{mantissa}·10{superscript(power)}"
    text = fixed(value, max(digits - 1 - power, 0))
    return text.rstrip("0").rstrip(".") if "." in text else text


def count(value: int, noun: str, plural: str = "") -> str:
    """A whole number with its noun: "1 layer", "2 layers"."""
    return f"{number(value)} {noun if value == 1 else plural or noun + 's'}"


def superscript(power: int) -> str:
    """An integer in superscript digits."""
    return str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def decimals_for(values: Sequence[Any], digits: int = 3) -> int:
    """Decimals that give a column's largest number ``digits`` significant digits."""
    sizes = [abs(v) for v in values if is_number(v) and v != 0]
    if not sizes or all(isinstance(v, int) for v in values if is_number(v)):
        return 0
    return min(max(digits - 1 - math.floor(math.log10(max(sizes))), 0), 6)


def plain(value: Any) -> str:
    """Any JSON value on one line, as text."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, str):
        return value or MISSING
    if isinstance(value, list | tuple):
        return ", ".join(plain(v) for v in value) or MISSING
    if isinstance(value, dict):
        return ", ".join(f"{key}: {plain(v)}" for key, v in value.items()) or MISSING
    return number(value)


def duration(seconds: Any) -> str:
    """A time span in the two units that matter: ``1 h 12 min``, ``3 min 20 s``, ``1.42 s``."""
    if not is_number(seconds):
        return MISSING
    if seconds < 60:
        return f"{number(float(seconds), 3)} s"
    whole = round(seconds)
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {round(whole % 3600 / 60)} min"


def label_and_unit(key: str) -> tuple[str, str]:
    """What to write for a key of report.json: ``diameter_min_mm`` → (Diameter min., mm)."""
    unit = ""
    for suffix, name in _UNITS.items():
        if key.endswith(suffix) and len(key) > len(suffix):
            key, unit = key[: -len(suffix)], name
            break
    words = " ".join(_WORDS.get(word, word) for word in key.split("_"))
    return words[:1].upper() + words[1:], unit
