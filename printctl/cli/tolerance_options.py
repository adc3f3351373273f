"""Tolerances given on the command line: a file, single limits, or both."""

from __future__ import annotations

from pathlib import Path

from pydantic import ValidationError

from printctl.errors import UsageError
from printctl.recipe.making import RegistrationPart
from printctl.recipe.tolerances import TolerancesPart
from registration.judging.tolerance import Tolerances


def tolerances_of(
    file: Path | None, rms_um: float | None, diameter_percent: str | None
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
        "tolerances": None if file is None else read_tolerances(file),
    }
    try:
        part = RegistrationPart.model_validate({k: v for k, v in given.items() if v is not None})
    except ValidationError as exc:
        raise UsageError(_refusal(exc, "tolerances")) from exc
    return part.all_tolerances()


def _number_or_text(value: str | None) -> float | str | None:
    """Return a number where the text is one; `RegistrationPart` judges the rest."""
    try:
        return None if value is None else float(value)
    except ValueError:
        return value


def read_tolerances(path: Path) -> TolerancesPart:
    """Read a YAML file of tolerances.

    Raises
    ------
    RecipeError
        When it isn't there or isn't YAML.
    UsageError
        With each wrong key, its value and the remedy.
    """
    # Loads the schema of a whole recipe; without such a file nobody waits for it.
    from printctl.recipe.load import read_mapping

    data = read_mapping(path, "tolerances", "one line does: `diameter_percent: 10`")
    try:
        return TolerancesPart.model_validate(data)
    except ValidationError as exc:
        raise UsageError(_refusal(exc, str(path))) from exc


def _refusal(exc: ValidationError, origin: str) -> str:
    """Say what is wrong with a file or an option, a line for each key."""
    from printctl.recipe.load import refusal

    return refusal(exc, origin, list)
