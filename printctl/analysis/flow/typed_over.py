"""Conditions of a run's flow with others typed in their place, at the print's size."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from printctl.errors import UsageError
from printctl.recipe.parts import FlowPart

_SOLVED: Final = ("one_d", "three_d", "compare")
_EVERY_OUTLET: Final = "outlet."
_ALTERNATIVES: Final = (
    {"inlet_flow_ml_min", "inlet_pressure_mmhg"},
    {"viscosity_mpa_s", "viscosity"},
    {_EVERY_OUTLET, "outlets"},
    {f"pulse.{name}" for name in ("amplitude_ml_min", "amplitude_mmhg", "shape", "table")},
)
"""Keys of which a section has one: what is typed takes the recipe's place."""
_PRINT_POWER: Final = {
    "inlet_flow_ml_min": 3,
    "pulse.amplitude_ml_min": 3,
    "pulse.wall_thickness_mm": 1,
    "outlet.resistance_mmhg_min_ml": -3,
    "outlet.proximal_mmhg_min_ml": -3,
    "outlet.compliance_ml_mmhg": 3,
}
"""By which power of print_scale a print's value is above its design's."""
_UNSCALED: Final = ("outlets", "pulse.table", "losses.stenoses")


def section_over(
    base: FlowPart, typed: dict[str, Any], print_scale: float
) -> tuple[dict[str, Any], list[str]]:
    """Put what was typed over a run's section; return the section, and what was said, in words.

    Numbers typed are the print's, the section's are its design's, ``print_scale`` times as small.

    Raises
    ------
    UsageError
        For a typed table or stenosis of a print that isn't of its design's size.
    """
    known = base.model_dump(exclude_none=True)
    if base.every_outlet is not None:
        known["outlet"] = known.get("pulse", {}).pop("outlet", None) or known["outlet"]
    known.get("compare", {}).pop("lattice", None)
    section: dict[str, Any] = {
        key: known.pop(key, {}) | typed.pop(key) for key in _SOLVED if key in typed
    }
    held = _flat({key: value for key, value in known.items() if key not in _SOLVED})
    stated = []
    for key, value in _flat(typed).items():
        rivals = [other for other in held if other == key or _alternatives(key, other)]
        old = ", ".join(f"{other} {_shown(held.pop(other))}" for other in rivals)
        stated.append(f"{key} {_shown(value)}" + (f" in place of {old}" if old else ""))
        if print_scale != 1.0 and key in _UNSCALED:
            raise UsageError(
                f"{key} is of the design's size, and this run is printed {print_scale:g} times as "
                "large; say it in the recipe"
            )
        power = _PRINT_POWER.get(key, 0)
        held[key] = value / print_scale**power if power else value
    for key, value in held.items():
        part, _, name = key.rpartition(".")
        (section.setdefault(part, {}) if part else section)[name] = value
    return section, stated


def _flat(section: Mapping[str, Any]) -> dict[str, Any]:
    """Values by key, those of sections as ``pulse.period_s``; a fluid is one value."""
    made: dict[str, Any] = {}
    for key, value in section.items():
        if isinstance(value, dict) and key != "viscosity":
            made |= {f"{key}.{name}": one for name, one in value.items()}
        else:
            made[key] = value
    return made


def _alternatives(key: str, other: str) -> bool:
    """Whether a section has one of two keys; those of ``outlet`` go together."""
    pair = {_EVERY_OUTLET if one.startswith(_EVERY_OUTLET) else one for one in (key, other)}
    return len(pair) > 1 and any(pair <= group for group in _ALTERNATIVES)


def conditions_said(part: FlowPart, typed: list[str], print_scale: float) -> str:
    """Sentence on a run's conditions: what holds, and what was typed in the recipe's place."""
    inlet = "inlet_flow_ml_min" if part.inlet_pressure_mmhg is None else "inlet_pressure_mmhg"
    main = {inlet: getattr(part, inlet)}
    if part.viscosity is None:
        main["viscosity_mpa_s"] = part.viscosity_mpa_s
    own = _flat(part.model_dump(exclude_defaults=True, exclude={*_SOLVED, "exports"}))
    held = ", ".join(f"{key} {_shown(value)}" for key, value in (main | own).items())
    size = "" if print_scale == 1.0 else f", of the design's size (print_scale {print_scale:g})"
    if not typed:
        return f"the recipe's{size}: {held}"
    return f"the recipe's with what was typed{size}: {held}; typed: {'; '.join(typed)}"


def _shown(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
