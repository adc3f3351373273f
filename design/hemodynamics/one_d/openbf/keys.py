"""Checked access to the keys of openBF's YAML input."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import Any, Final

from design.errors import FlowError
from design.hemodynamics.json_keys import check_keys, number

TOP: Final = frozenset((
    "project_name", "write_results", "output_directory", "inlet_file", "blood", "solver",
    "network",
))  # fmt: skip
BLOOD: Final = frozenset(("mu", "rho"))
SOLVER: Final = frozenset(("Ccfl", "cycles", "convergence_tolerance", "jump"))
OUTLET: Final = frozenset(("outlet", "Rt", "R1", "R2", "Cc", "Pout", "inlet_impedance_matching"))
VESSEL: Final = OUTLET | frozenset((
    "label", "sn", "tn", "L", "E", "R0", "Rp", "Rd", "M", "h0", "Pext", "gamma_profile",
    "to_save", "initial_pressure", "initial_flow", "visco-elastic",
))  # fmt: skip
SPACED: Final = "gamma profile"
"""As openBF's manual and models wrote ``gamma_profile``."""


def section(data: Any, place: str, known: frozenset[str]) -> Mapping[str, Any]:
    """Return ``data`` as a mapping of known keys; a key's words may have spaces between them.

    Raises
    ------
    FlowError
        When it isn't one, has a key that openBF doesn't read, or one twice.
    """
    if not isinstance(data, Mapping):
        return check_keys(data, place, known)
    named: dict[Any, Any] = {}
    for key, value in data.items():
        if not isinstance(key, str) or key.startswith("_"):
            raise FlowError(f"{place} has the key {key!r}, which openBF doesn't read; take it out")
        name = key.replace(" ", "_")
        name = name if name in known else key
        if name in named:
            raise FlowError(f"{place} has the keys {name!r} and {key!r}; leave one of them out")
        named[name] = value
    return check_keys(named, place, known)


def quantity(
    data: Mapping[str, Any],
    key: str,
    place: str,
    limits: tuple[float, float],
    default: float | None = None,
) -> float:
    """Return the number under ``key``, within ``limits``; 1e-13 without a point is one, too.

    Raises
    ------
    FlowError
        When it is missing, no number or out of its limits.
    """
    value = data.get(key)
    if isinstance(value, str):
        with suppress(ValueError):  # `number` refuses it by name
            data = {key: float(value)}
    amount = number(data, key, place, default)
    low, high = limits
    if not low <= amount <= high:
        raise FlowError(f"{place}: {key} is {amount:g}; write {low:g} to {high:g}")
    return amount
