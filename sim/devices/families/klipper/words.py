"""Parse parameters of Klipper's named commands: ``X=5 EXTRUDER=extruder1``."""

from __future__ import annotations

import re
from typing import Final

_VALUE: Final = re.compile(rb"\b([A-Z_]+)=([+-]?\d*\.?\d+)")


def values_of(words: bytes) -> dict[str, float]:
    """Read numbers by their names."""
    return {name.decode(): float(value) for name, value in _VALUE.findall(words.upper())}


def parameters_of(words: bytes) -> dict[str, str]:
    """Read words by their names, in capitals."""
    pairs = (word.partition("=") for word in words.decode("ascii", "replace").split())
    return {key.upper(): value for key, _, value in pairs}
