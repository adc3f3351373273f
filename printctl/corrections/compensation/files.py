"""Load, check and save files of shape corrections from scanned prints (YAML or JSON)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from design.files import write_text
from design.toolpath.correction import Corrections, Stretch
from firmware_profiles.errors import wording
from firmware_profiles.yaml_file import read_yaml
from printctl.corrections.compensation.schema import CompensationFile
from printctl.errors import UsageError

SUFFIXES = (".json", ".yaml", ".yml")


def save_compensation(path: Path, made: CompensationFile) -> None:
    """Write a file, JSON or YAML by its suffix; same content, same bytes.

    Raises
    ------
    UsageError
        For another suffix.
    OSError
        When it can't be written.
    """
    check_suffix(path)
    data = made.model_dump(mode="json", by_alias=True)
    if path.suffix.lower() == ".json":
        write_text(path, json.dumps(data, indent=1, allow_nan=False) + "\n")
        return
    write_text(path, yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=100))


def check_suffix(path: Path) -> None:
    """Refuse a name that says no format.

    Raises
    ------
    UsageError
    """
    if path.suffix.lower() not in SUFFIXES:
        raise UsageError(f"{path}: a compensation is written as .yaml or .json; name it so")


def load_compensation(path: Path) -> CompensationFile:
    """Read and check a file.

    Raises
    ------
    UsageError
        When it isn't there or isn't one: what is wrong, and where.
    """
    try:
        data: Any = read_yaml(path.read_text(encoding="utf-8"))
    except OSError as exc:
        raise UsageError(
            f"compensation {path} can't be read: {exc.strerror}; check the path, or make it with "
            "`printctl compensate RUN --out FILE`"
        ) from exc
    except (yaml.YAMLError, UnicodeDecodeError) as exc:
        raise UsageError(f"{path} is neither YAML nor JSON: {exc}") from exc
    if not isinstance(data, dict) or "printctl_compensation" not in data:
        raise UsageError(
            f"{path} isn't a compensation (no key printctl_compensation); make one with "
            "`printctl compensate RUN --out FILE`"
        )
    try:
        return CompensationFile.model_validate(data)
    except ValidationError as exc:
        raise UsageError(_wrong(path, exc)) from exc


def _wrong(path: Path, exc: ValidationError) -> str:
    first = exc.errors()[0]
    place = ".".join(map(str, first["loc"])) or "the file"
    more = f" ({exc.error_count() - 1} more)" if exc.error_count() > 1 else ""
    value = first["input"]
    shown = "" if isinstance(value, dict | list) else f" (is {value!r})"
    return f"{path}: {place}: {wording(first)}{shown}{more}; make the file anew"


def corrections_of_file(made: CompensationFile) -> Corrections:
    """What the toolpath needs of it, in mm."""
    return Corrections(
        stretch=Stretch(made.stretch.factor, made.stretch.about_mm),
        radial_mm=made.radial.offset_um * 1e-3,
        radial_slope=made.radial.slope_um_per_mm * 1e-3,
        radial_at_mm=made.radial.at_mm,
        radial_range_mm=(made.radial.from_mm, max(made.radial.from_mm, made.radial.to_mm)),
        diameter_mm={part.vessel: part.diameter_um * 1e-3 for part in made.vessels},
        offset_mm={part.node: _mm(part.offset_um) for part in made.nodes},
    )


def _mm(offset_um: tuple[float, float, float]) -> tuple[float, float, float]:
    x, y, z = offset_um
    return (x * 1e-3, y * 1e-3, z * 1e-3)
