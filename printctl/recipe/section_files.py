"""Read a YAML file of one section of a recipe: a measurement record, or tolerances."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ValidationError

from printctl.errors import UsageError
from printctl.recipe.load import read_mapping, refusal
from printctl.recipe.sections.measuring import RegistrationPart
from printctl.recipe.sections.record import RecordPart
from printctl.recipe.sections.tolerances import TolerancesPart
from registration.measuring.judging.tolerance import DecisionRule, Tolerances

PartT = TypeVar("PartT", bound=BaseModel)


def read_part(path: Path, part: type[PartT], what: str, remedy: str) -> PartT:
    """Read and check a YAML file of one section of a recipe.

    ``what`` and ``remedy`` say what the file holds and how to write one, for messages.

    Raises
    ------
    RecipeError
        When it isn't there or isn't YAML.
    UsageError
        With each wrong key, its value and the remedy.
    """
    data = read_mapping(path, what, remedy)
    try:
        return part.model_validate(data)
    except ValidationError as exc:
        raise UsageError(refusal(exc, str(path), list)) from exc


def read_record(path: Path) -> RecordPart:
    """Read a measurement record; see `read_part`."""
    return read_part(path, RecordPart, "record", "one line does: `operator: A. Smith`")


def tolerances_of(
    file: Path | None,
    rms_um: float | None,
    diameter_percent: str | None,
    decision_rule: DecisionRule | None = None,
    conformance_percent: float | None = None,
) -> Tolerances:
    """Read the limits that a print is judged by.

    Raises
    ------
    UsageError
        For a limit that can't be used, or one that is given twice.
    """
    given = {
        "tolerance_um": rms_um,
        "diameter_tolerance_percent": _number_or_text(diameter_percent),
        "decision_rule": decision_rule,
        "conformance_percent": conformance_percent,
        "tolerances": None
        if file is None
        else read_part(file, TolerancesPart, "tolerances", "one line does: `diameter_percent: 10`"),
    }
    try:
        part = RegistrationPart.model_validate({k: v for k, v in given.items() if v is not None})
    except ValidationError as exc:
        raise UsageError(refusal(exc, "tolerances", list)) from exc
    return part.all_tolerances()


def _number_or_text(value: str | None) -> float | str | None:
    """Return a number where the text is one; `RegistrationPart` judges the rest."""
    try:
        return None if value is None else float(value)
    except ValueError:
        return value
