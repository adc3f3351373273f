"""Data class of an extra section for the report page: template values, scripts, style sheet."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, eq=False)
class AddedSection:
    """What the page needs of it.

    Attributes
    ----------
    context : dict
        What its template takes.
    entry : str
        What starts them.
    styles : tuple of Path
        Its style sheets.
    """

    context: dict[str, object]
    entry: str
    styles: tuple[Path, ...]
