"""Parse the fluid's file, stenoses and number lists of `printctl flow`."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import yaml
from pydantic import TypeAdapter, ValidationError

from firmware_profiles.errors import wording
from firmware_profiles.yaml_file import read_yaml
from printctl.errors import UsageError
from printctl.recipe.parts import FluidPart, StenosisPart

_FLUID: Final[TypeAdapter[Any]] = TypeAdapter(FluidPart)
_GIVE: Final = "write model: carreau and its numbers"


def fluid_section(path: Path | None) -> dict[str, Any]:
    """Return what a file says of the fluid, as a flow section does; empty without one.

    Raises
    ------
    UsageError
        For a file that can't be read, or says no fluid.
    """
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
        # The first key is the model's name, which the file has elsewhere.
        key = "".join(f"{key} " for key in first["loc"][1:])
        raise UsageError(f"--fluid {path}: {key}{wording(first)}; {_GIVE}") from exc
    return {"viscosity": values}


def stenoses(texts: list[str]) -> list[dict[str, Any]]:
    """Return stenoses VESSEL,SHARE,MM as a flow section says them.

    Raises
    ------
    UsageError
        For what isn't three numbers, or out of bounds.
    """
    found = []
    for text in texts:
        vessel, share, length = numbers(text, "--stenosis", "VESSEL,SHARE,MM", 3)
        number = int(vessel) if vessel.is_integer() else vessel
        values = {"vessel": number, "diameter_share": share, "length_mm": length}
        try:
            StenosisPart.model_validate(values)
        except ValidationError as exc:
            first = exc.errors()[0]
            raise UsageError(f"--stenosis {text}: {first['loc'][0]} {wording(first)}") from exc
        found.append(values)
    return found


def numbers(text: str, name: str, form: str, count: int) -> tuple[float, ...]:
    """Return so many numbers with commas between.

    Raises
    ------
    UsageError
        For anything else.
    """
    try:
        found = tuple(float(part) for part in text.split(","))
    except ValueError:
        found = ()
    if len(found) != count:
        raise UsageError(f"{name} {text!r} isn't {form}; write numbers with commas between")
    return found
