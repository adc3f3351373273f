"""Read a print's acceptance limits from command-line options: a tolerance file or single limits."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from pydantic import ValidationError

from printctl.cli.part_file import read_part
from printctl.errors import UsageError
from printctl.recipe.making import RegistrationPart
from printctl.recipe.tolerances import TolerancesPart
from registration.measuring.judging.tolerance import DecisionRule, Tolerances

_REMEDY: Final = "one line does: `diameter_percent: 10`"


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
    # Loads the schema of a whole recipe; without such options nobody waits for it.
    from printctl.recipe.load import refusal

    given = {
        "tolerance_um": rms_um,
        "diameter_tolerance_percent": _number_or_text(diameter_percent),
        "decision_rule": decision_rule,
        "conformance_percent": conformance_percent,
        "tolerances": None
        if file is None
        else read_part(file, TolerancesPart, "tolerances", _REMEDY),
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
