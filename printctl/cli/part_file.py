"""Read and validate a YAML file with one section of a recipe, such as a measurement record."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ValidationError

from printctl.errors import UsageError
from printctl.recipe.record import RecordPart

PartT = TypeVar("PartT", bound=BaseModel)


def read_part(path: Path, part: type[PartT], what: str, remedy: str) -> PartT:
    """Read and check a file.

    Parameters
    ----------
    path : Path
    part : type
        The part's model.
    what, remedy : str
        What the file holds and how to write one, for messages.

    Raises
    ------
    RecipeError
        When it isn't there or isn't YAML.
    UsageError
        With each wrong key, its value and the remedy.
    """
    # Loads the schema of a whole recipe; without such a file nobody waits for it.
    from printctl.recipe.load import read_mapping, refusal

    data = read_mapping(path, what, remedy)
    try:
        return part.model_validate(data)
    except ValidationError as exc:
        raise UsageError(refusal(exc, str(path), list)) from exc


def read_record(path: Path) -> RecordPart:
    """Read a measurement record; see `read_part`."""
    return read_part(path, RecordPart, "record", "one line does: `operator: A. Smith`")
