"""Load a module from a firmware family's folder of the simulator."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from importlib.util import find_spec
from types import ModuleType


@cache
def family_part(family: str, name: str) -> ModuleType | None:
    """Module of a family's folder; None where the folder has none of that name."""
    package = f"sim.devices.families.{family}"
    if find_spec(package) is None or find_spec(f"{package}.{name}") is None:
        return None
    return import_module(f"{package}.{name}")
