"""What was typed after `printctl flow` as a recipe's section, checked as it would be."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from printctl.errors import UsageError
from printctl.recipe.parts import FlowPart
from printctl.recipe.pulse import PulsePart

_STEADY: Final = ("inlet_flow_ml_min", "viscosity_mpa_s")
_WAVES: Final = ("amplitude_ml_min", "shape", "waveform")
_FOR_WAVES: Final = ("period_s", "wall_young_kpa", "wall_thickness_mm")


def part_of(asked: Mapping[str, Any]) -> FlowPart:
    """The section that options, by their names, stand for.

    Raises
    ------
    UsageError
        For options that don't go together, or a value out of bounds.
    """
    waves = any(asked[key] is not None for key in _WAVES)
    _refuse_idle(asked, waves)
    try:
        pulse = PulsePart(**_pulse(asked)) if waves else None
        return FlowPart(**{key: asked[key] for key in _STEADY}, pulse=pulse)
    except ValidationError as exc:
        first = exc.errors()[0]
        name = ".".join(map(str, first["loc"])) or "pulsatile flow"
        raise UsageError(f"{name}: {first['msg'].removeprefix('Value error, ')}") from exc


def _pulse(asked: Mapping[str, Any]) -> dict[str, Any]:
    table = asked["waveform"]
    names = ("amplitude_ml_min", "shape", *_FOR_WAVES, "profile", "steps")
    return {
        **{key: asked[key] for key in names},
        "table": None if table is None else str(Path(table).resolve()),
    }


def _refuse_idle(asked: Mapping[str, Any], waves: bool) -> None:
    idle = [key for key in _FOR_WAVES if asked[key] is not None]
    if idle and not waves:
        raise UsageError(
            f"--{idle[0].replace('_', '-')} is for pulsatile flow; give --amplitude-ml-min, "
            "--shape or --waveform"
        )
    if asked["svzerod"] is not None and not waves:
        raise UsageError("--svzerod writes a pulsatile problem; give --amplitude-ml-min, --shape "
                         "or --waveform")  # fmt: skip
