"""Read the outlet of one openBF vessel: reflection, or a Windkessel of two or three elements."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from design.errors import FlowError
from design.hemodynamics.json_keys import flag
from design.hemodynamics.one_d.openbf.keys import OUTLET, quantity
from design.hemodynamics.waveforms import Constant
from design.hemodynamics.zero_d.pulsatile.conditions import (
    Outlet,
    PressureOutlet,
    WindkesselOutlet,
)

_SI: Final = 1e-9
"""Pa·s/m³ to Pa·s/µL; m³/Pa to µL/Pa is its inverse."""

_KINDS: Final = {"reflection": {"Rt"}, "wk2": {"R1", "Cc"}, "wk3": {"R1", "Cc"}}
"""Keys that the word under ``outlet`` needs."""

_RESISTANCE: Final = (1e-3, 1e30)
_COMPLIANCE: Final = (1e-30, 1.0)


@dataclass(frozen=True)
class VesselEnd:
    """What the last cross-section of a vessel is, for its outlet.

    Attributes
    ----------
    place : str
        Of the vessel, for messages.
    impedance : float, Pa·s/m³
        ϱ c/A at rest.
    external_pa : float, Pa
    """

    place: str
    impedance: float
    external_pa: float


def outlet_of(data: Mapping[str, Any], end: VesselEnd) -> tuple[Outlet, float | None]:
    """Return the outlet's condition and, of a reflecting one, which part it sends back.

    As openBF runs it: R₁ from the vessel's end to the compliance, R₂ from there to `Pout`.
    Without R₂, R₂ = R₁ - ϱ c/A at rest, and R₁ stays.

    Raises
    ------
    FlowError
        For keys that don't go together, are missing or out of bounds.
    """
    place = end.place
    given = {key for key in OUTLET if key in data}
    _check_word(data, given, place)
    if flag(data, "inlet_impedance_matching", place, default=False):
        raise FlowError(
            f"{place}: inlet_impedance_matching isn't modelled; write false, and for R1 the "
            f"impedance at rest, {end.impedance:.6g}, with what is left of the sum for R2"
        )
    if "Rt" in given:
        others = sorted(given & {"R1", "R2", "Cc", "Pout"})
        if others:
            raise FlowError(f"{place}: Rt doesn't go with {others[0]}; leave one of them out")
        part = quantity(data, "Rt", place, (-1.0, 1.0))
        return PressureOutlet(Constant(end.external_pa)), part
    if not given & {"R1", "R2", "Cc"}:
        raise FlowError(f"{place} ends in an outlet; give it R1 and Cc (and R2), or Rt")
    proximal = quantity(data, "R1", place, _RESISTANCE)
    distal = quantity(data, "R2", place, (0.0, 1e30), 0.0) or proximal - end.impedance
    if distal <= 0.0:
        raise FlowError(
            f"{place}: R1 is {proximal:g} and without R2 has to be above the vessel's impedance, "
            f"{end.impedance:.6g} Pa·s/m³; raise R1, or give R2"
        )
    compliance = quantity(data, "Cc", place, _COMPLIANCE)
    back = quantity(data, "Pout", place, (-1e9, 1e9), 0.0)
    return WindkesselOutlet(proximal * _SI, compliance / _SI, distal * _SI, back), None


def refuse_inner(data: Mapping[str, Any], place: str) -> None:
    """Raise where a vessel that others follow has an outlet's keys.

    Raises
    ------
    FlowError
    """
    matched = flag(data, "inlet_impedance_matching", place, default=False)
    for key in sorted(OUTLET & data.keys() - {"inlet_impedance_matching"}):
        raise FlowError(f"{place}: {key} is for outlets, and other vessels follow; leave it out")
    if matched:
        raise FlowError(f"{place}: inlet_impedance_matching is for outlets; leave it out")


def _check_word(data: Mapping[str, Any], given: set[str], place: str) -> None:
    """Hold the word of older files, which openBF no longer reads, against the numbers."""
    if "outlet" not in given:
        return
    word = data["outlet"]
    if word not in _KINDS:
        raise FlowError(f"{place}: outlet is {word!r}; write {', '.join(_KINDS)}, or leave it out")
    missing = sorted(_KINDS[word] - given)
    if missing or (word == "wk2" and "R2" in given):
        what = f"has no {missing[0]}" if missing else "has R2"
        raise FlowError(f"{place}: outlet is {word} and {what}; make them agree")
