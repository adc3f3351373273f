"""Read the measurement record file of `printctl register --record`."""

from __future__ import annotations

from pathlib import Path

from pydantic import ValidationError

from printctl.errors import UsageError
from printctl.recipe.record import RecordPart


def read_record(path: Path) -> RecordPart:
    """Read a YAML file of a measurement record.

    Raises
    ------
    RecipeError
        When it isn't there or isn't YAML.
    UsageError
        With each wrong key, its value and the remedy.
    """
    # Loads the schema of a whole recipe; without such a file nobody waits for it.
    from printctl.recipe.load import read_mapping, refusal

    data = read_mapping(path, "record", "one line does: `operator: A. Smith`")
    try:
        return RecordPart.model_validate(data)
    except ValidationError as exc:
        raise UsageError(refusal(exc, str(path), list)) from exc
