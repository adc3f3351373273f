"""Options of `printctl flow`, and the flow section that they and the recipe make."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import yaml
from pydantic import TypeAdapter, ValidationError

from firmware_profiles.errors import wording
from firmware_profiles.yaml_file import read_yaml
from printctl.analysis.flow.typed_over import section_over
from printctl.cli.section_options import SectionOptions, Sections, needs_another, option
from printctl.errors import UsageError
from printctl.recipe import parts
from printctl.settings import opt, settings


@settings
class OtherSolvers:
    """Options that have 3D flow solved by, or written for, other programs."""

    ranks: int | None = opt("Solve 3D on so many MPI processes, by FEniCSx.")
    ranks_python: Path | None = opt("Interpreter with dolfinx, for --ranks.")
    svmultiphysics: Path | None = opt("Write the 3D case for svMultiPhysics here.")


_FLUID: Final[TypeAdapter[Any]] = TypeAdapter(parts.FluidPart)
_GIVE: Final = "write model: carreau, power_law or pries_1994, and its numbers"


def fluid_section(path: Path | None) -> dict[str, Any]:
    """Return what a file says of the fluid, as a flow section does; empty without one."""
    if path is None:
        return {}
    try:
        values = read_yaml(path.read_text(encoding="utf-8"))
    except OSError as exc:
        raise UsageError(f"--fluid {path} can't be read: {exc.strerror}; check the path") from exc
    except (yaml.YAMLError, UnicodeDecodeError) as exc:
        raise UsageError(f"--fluid {path} isn't YAML: {exc}; {_GIVE}") from exc
    if not isinstance(values, dict):
        raise UsageError(f"--fluid {path} names no fluid; {_GIVE}")
    try:
        _FLUID.validate_python(values)
    except ValidationError as exc:
        first = exc.errors()[0]
        # The first key is the model's name; there is none where the model is wrong.
        model, *keys = first["loc"] or (None,)
        key = "".join(f"{key} " for key in keys)
        give = f"mend the numbers of model: {model}" if model else _GIVE
        raise UsageError(f"--fluid {path}: {key}{wording(first)}; {give}") from exc
    return {"viscosity": values}


def stenoses(texts: list[str]) -> list[dict[str, Any]]:
    """Return stenoses VESSEL,SHARE,MM as a flow section says them."""
    found = []
    for text in texts:
        vessel, share, length = numbers(text, "--stenosis", "VESSEL,SHARE,MM", 3)
        number = int(vessel) if vessel.is_integer() else vessel
        values = {"vessel": number, "diameter_share": share, "length_mm": length}
        try:
            parts.StenosisPart.model_validate(values)
        except ValidationError as exc:
            first = exc.errors()[0]
            raise UsageError(f"--stenosis {text}: {first['loc'][0]} {wording(first)}") from exc
        found.append(values)
    return found


def numbers(text: str, name: str, form: str, count: int) -> tuple[float, ...]:
    """Return so many numbers with commas between."""
    try:
        found = tuple(float(part) for part in text.split(","))
    except ValueError:
        found = ()
    if len(found) != count:
        raise UsageError(f"{name} {text!r} isn't {form}; write numbers with commas between")
    return found


_STEADY: Final = "Fluid, inlets and outlets"
PULSE: Final = SectionOptions(
    parts.PulsePart, ("pulse",), renamed={"table": "waveform"}, panel="Pulsatile flow"
)
THREE_D: Final = SectionOptions(
    parts.ThreeDPart,
    ("three_d",),
    renamed={"steps": "three_d_steps", "most_cycles": "three_d_most_cycles"},
    panel="In space (3D)",
    flag="Resolve the flow in the lumens' space, too.",
)
SECTIONS: Final[Any] = Sections(
    [
        SectionOptions(parts.FlowPart, panel=_STEADY),
        SectionOptions(parts.PulseOutlet, ("outlet",), prefix="outlet_", panel=_STEADY),
        SectionOptions(parts.LossPart, ("losses",), panel=_STEADY),
        PULSE,
        SectionOptions(
            parts.OneDPart,
            ("one_d",),
            panel="Waves (1D)",
            flag="Follow the pulse's waves along the vessels, too.",
        ),
        THREE_D,
        SectionOptions(
            parts.ComparePart,
            ("compare",),
            renamed={"points": "compare_points"},
            panel="Comparison",
            flag="Fidelities side by side, each against the ideal.",
        ),
    ],
    what="flow",
)
_WAVES: Final = ("amplitude_ml_min", "amplitude_mmhg", "shape", "waveform")
_GIVE_WAVE: Final = "give --amplitude-ml-min, --amplitude-mmhg, --shape or --waveform"
_IN_SPACE: Final = ("three_d", "ranks", "svmultiphysics")
"""Options that solve in the lumens' space, which fillets round."""
_NEED: Final = {
    "ranks_python": "ranks",
}
"""Options that mean nothing without another one."""
_OTHERS: Final = SectionOptions(parts.ThreeDPart, renamed=THREE_D.renamed)
_TAKEN: Final[Mapping[str, tuple[str, ...]]] = {
    "edge_ratio": ("ranks", "svmultiphysics"),
    "inertia": ("ranks",),
}
"""Options of --three-d that others who solve in space take, too."""


def part_of(
    requested: Mapping[str, Any], base: parts.FlowPart | None = None, print_scale: float = 1.0
) -> tuple[parts.FlowPart, list[str]]:
    """The section that options, by their names, stand for, and what they say in a run's place.

    ``base``, a run's section, holds where no option says otherwise; its own 1D and 3D settings wait
    for --one-d and --three-d. Numbers typed are the print's, the section's are its design's, the
    run's ``print_scale`` between them. Raises `UsageError` for options that don't go together, a
    value out of bounds, a fluid that can't be read.
    """
    waves = any(requested[key] is not None for key in _WAVES)
    if not waves and (base is None or base.pulse is None):
        _refuse_without_wave(requested, "" if base is None else ", and the recipe has none")
    _refuse_idle_options(requested)
    section = SECTIONS.section(_with_own_space(requested)) | fluid_section(requested["fluid"])
    if (band := requested["shear_band_dyn_cm2"]) is not None:
        band = numbers(band, "--shear-band-dyn-cm2", "LOW,HIGH", 2)
        section["shear_band_dyn_cm2"] = band
    if requested["stenosis"]:
        section.setdefault("losses", {})["stenoses"] = stenoses(requested["stenosis"])
    typed: list[str] = []
    if base is not None:
        section, typed = section_over(base, section, print_scale)
    stated = replace(SECTIONS, what="pulsatile flow") if waves else SECTIONS
    return stated.checked(parts.FlowPart, section), typed


def space_of(requested: Mapping[str, Any]) -> parts.ThreeDPart:
    """What was typed of lumens in space, for those that don't solve as --three-d does."""
    return Sections([_OTHERS], what="3D flow").checked(parts.ThreeDPart, _OTHERS.typed(requested))


def _with_own_space(requested: Mapping[str, Any]) -> Mapping[str, Any]:
    """The options without those of --three-d that are given for another who solves in space."""
    solving = [name for name in _IN_SPACE if requested[name]]
    if requested["three_d"] or not solving:
        return requested
    takes = [name for name, by in _TAKEN.items() if set(solving) & set(by)]
    typed = [name for name in THREE_D.fields() if requested[name] is not None]
    for name in typed:
        if name not in takes:
            word = f"no_{name}" if requested[name] is False else name
            raise UsageError(
                f"{option(word)} is for --three-d; {option(solving[0])} takes "
                f"{' and '.join(map(option, takes))} alone. Add --three-d to solve here, too, or "
                "leave it out"
            )
    return {**requested, **dict.fromkeys(typed)}


def _refuse_idle_options(requested: Mapping[str, Any]) -> None:
    """Refuse an option that does nothing without another one."""
    for key, other in _NEED.items():
        # An option that may be given again is an empty list where it isn't given.
        if requested[key] not in (None, [], ()) and not requested[other]:
            raise needs_another(key, other)
    if requested["fillet_ratio"] is not None and not any(requested[key] for key in _IN_SPACE):
        raise UsageError(
            "--fillet-ratio rounds the lumens that 3D flow is solved in; give --three-d, "
            "--ranks or --svmultiphysics, or leave it out"
        )


def _refuse_without_wave(requested: Mapping[str, Any], why: str) -> None:
    idle = next((name for name in PULSE.fields() if requested[name] is not None), None)
    if idle is not None:
        raise UsageError(f"{option(idle)} is for pulsatile flow{why}; {_GIVE_WAVE}")
    for key, does in (("svoned", "writes a pulsatile problem"), ("one_d", "follows a pulse")):
        if requested[key]:
            raise UsageError(f"{option(key)} {does}{why}; {_GIVE_WAVE}")
