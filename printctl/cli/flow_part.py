"""A recipe's `flow` section as options of `printctl flow`, and made from what was typed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from pydantic import ValidationError

from printctl.cli.flow_words import fluid_section, numbers, stenoses
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
    renamed={"steps": "three_d_steps", "most_cycles": "three_d_most_cycles"},
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
_OTHERS: Final = SectionOptions(ThreeDPart, renamed=THREE_D.renamed)
_TAKEN: Final[Mapping[str, tuple[str, ...]]] = {
    "edge_ratio": ("match_split", "ranks", "slurm", "svmultiphysics"),
    "inertia": ("match_split", "ranks", "slurm"),
}
"""Options of --three-d that others who solve in space take, too."""


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
    section = (
        section_values(SECTIONS, _with_own_space(asked))
        | fluid_section(asked["fluid"])
        | shear_band(asked)
    )
    if asked["stenosis"]:
        section.setdefault("losses", {})["stenoses"] = stenoses(asked["stenosis"])
    try:
        return FlowPart(**section)
    except ValidationError as exc:
        raise wrong_option(exc, SECTIONS, "pulsatile flow" if waves else "flow") from exc


def space_of(asked: Mapping[str, Any]) -> ThreeDPart:
    """What was typed of lumens in space, for those that don't solve as --three-d does.

    Raises
    ------
    UsageError
        For a value out of bounds.
    """
    try:
        return ThreeDPart(**_OTHERS.typed(asked))
    except ValidationError as exc:
        raise wrong_option(exc, [_OTHERS], "3D flow") from exc


def _with_own_space(asked: Mapping[str, Any]) -> Mapping[str, Any]:
    """The options without those of --three-d that are given for another who solves in space.

    Raises
    ------
    UsageError
        For an option of --three-d that the others don't take.
    """
    solving = [name for name in _IN_SPACE if asked[name]]
    if asked["three_d"] or not solving:
        return asked
    takes = [name for name, by in _TAKEN.items() if set(solving) & set(by)]
    typed = [name for name in THREE_D.fields() if asked[name] is not None]
    for name in typed:
        if name not in takes:
            word = f"no_{name}" if asked[name] is False else name
            raise UsageError(
                f"{option(word)} is for --three-d; {option(solving[0])} takes "
                f"{' and '.join(map(option, takes))} alone. Add --three-d to solve here, too, or "
                "leave it out"
            )
    return {**asked, **dict.fromkeys(typed)}


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
    return {"shear_band_dyn_cm2": numbers(text, "--shear-band-dyn-cm2", "LOW,HIGH", 2)}
