"""A recipe's `flow` section as options of `printctl flow`, and made from what was typed."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import yaml
from pydantic import ValidationError

from firmware_profiles.yaml_file import read_yaml
from printctl.cli.section_options import (
    SectionOptions,
    needs_another,
    option,
    section_values,
    wrong_option,
)
from printctl.errors import UsageError
from printctl.recipe.fluids import LossPart
from printctl.recipe.parts import FlowPart
from printctl.recipe.pulse import PulseOutlet, PulsePart
from printctl.recipe.space import ComparePart, ThreeDPart
from printctl.recipe.waves import OneDPart

_STEADY: Final = "Fluid, inlets and outlets"
PULSE: Final = SectionOptions(
    PulsePart, ("pulse",), renamed={"table": "waveform"}, panel="Pulsatile flow"
)
ONE_D: Final = SectionOptions(
    OneDPart,
    ("one_d",),
    panel="Waves (1D)",
    flag="Follow the pulse's waves along the vessels, too.",
)
THREE_D: Final = SectionOptions(
    ThreeDPart,
    ("three_d",),
    renamed={"steps": "three_d_steps"},
    panel="In space (3D)",
    flag="Resolve the flow in the lumens' space, too.",
)
COMPARE: Final = SectionOptions(
    ComparePart,
    ("compare",),
    renamed={"points": "compare_points"},
    panel="Comparison",
    flag="Fidelities side by side, each against the ideal.",
)
DRIVING: Final = (
    SectionOptions(FlowPart, panel=_STEADY),
    SectionOptions(PulseOutlet, ("outlet",), prefix="outlet_", panel=_STEADY),
    SectionOptions(LossPart, ("losses",), panel=_STEADY),
    PULSE,
)
"""What flows, and what drives it."""
SECTIONS: Final = (*DRIVING, ONE_D, THREE_D, COMPARE)

_WAVES: Final = ("amplitude_ml_min", "amplitude_mmhg", "shape", "waveform")
_GIVE_WAVE: Final = "give --amplitude-ml-min, --amplitude-mmhg, --shape or --waveform"
_IN_SPACE: Final = ("three_d", "match_split", "ranks", "slurm", "svmultiphysics")
"""Options that solve in the lumens' space, which fillets round."""
_NEED: Final = {
    "ranks_python": "ranks",
    "slurm_set": "slurm",
    **dict.fromkeys(("want", "match_percent", "least_lumen_mm"), "match_split"),
}
"""Options that mean nothing without another one."""


def part_of(asked: Mapping[str, Any]) -> FlowPart:
    """The section that options, by their names, stand for.

    Raises
    ------
    UsageError
        For options that don't go together, a value out of bounds, a fluid that can't be read.
    """
    waves = any(asked[key] is not None for key in _WAVES)
    _refuse_without_wave(asked, waves)
    refuse_idle_options(asked)
    section = section_values(SECTIONS, asked) | _fluid(asked["fluid"]) | shear_band(asked)
    if asked["stenosis"]:
        section.setdefault("losses", {})["stenoses"] = _stenoses(asked["stenosis"])
    try:
        return FlowPart(**section)
    except ValidationError as exc:
        raise wrong_option(exc, SECTIONS, "pulsatile flow" if waves else "flow") from exc


def refuse_idle_options(asked: Mapping[str, Any]) -> None:
    """Refuse an option that does nothing without another one.

    Raises
    ------
    UsageError
    """
    for key, other in _NEED.items():
        # An option that may be given again is an empty list where it isn't given.
        if asked[key] not in (None, [], ()) and not asked[other]:
            raise needs_another(key, other)
    if asked["fillet_ratio"] is not None and not any(asked[key] for key in _IN_SPACE):
        raise UsageError(
            "--fillet-ratio rounds the lumens that 3D flow is solved in; give --three-d, "
            "--match-split, --ranks, --slurm or --svmultiphysics, or leave it out"
        )


def _refuse_without_wave(asked: Mapping[str, Any], waves: bool) -> None:
    if waves:
        return
    idle = next((name for name in PULSE.fields() if asked[name] is not None), None)
    if idle is not None:
        raise UsageError(f"{option(idle)} is for pulsatile flow; {_GIVE_WAVE}")
    for key, does in (
        ("svzerod", "writes a pulsatile problem"),
        ("svoned", "writes a pulsatile problem"),
        ("svmultiphysics", "writes a pulsatile problem"),
        ("one_d", "follows a pulse"),
    ):
        if asked[key]:
            raise UsageError(f"{option(key)} {does}; {_GIVE_WAVE}")


def shear_band(asked: Mapping[str, Any]) -> dict[str, Any]:
    """The range of wall shear that is wanted, as the section says it; empty where none is.

    Raises
    ------
    UsageError
        For what isn't two numbers.
    """
    text = asked["shear_band_dyn_cm2"]
    if text is None:
        return {}
    return {"shear_band_dyn_cm2": _numbers(text, "--shear-band-dyn-cm2", "LOW,HIGH", 2)}


def _fluid(path: Any) -> dict[str, Any]:
    if path is None:
        return {}
    try:
        values = read_yaml(Path(path).read_text(encoding="utf-8"))
    except OSError as exc:
        raise UsageError(f"--fluid {path} can't be read: {exc.strerror}; check the path") from exc
    except (yaml.YAMLError, UnicodeDecodeError) as exc:
        raise UsageError(f"{path} isn't YAML: {exc}; write model: carreau and its numbers") from exc
    if not isinstance(values, dict):
        raise UsageError(f"{path} names no fluid; write model: carreau and its numbers")
    return {"viscosity": values}


def _stenoses(texts: list[str]) -> list[dict[str, Any]]:
    stenoses = []
    for text in texts:
        vessel, share, length = _numbers(text, "--stenosis", "VESSEL,SHARE,MM", 3)
        number = int(vessel) if vessel.is_integer() else vessel
        stenoses.append({"vessel": number, "diameter_share": share, "length_mm": length})
    return stenoses


def _numbers(text: str, name: str, form: str, count: int) -> tuple[float, ...]:
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != count:
        raise UsageError(f"{name} {text!r} isn't {form}; write numbers with commas between")
    return numbers
