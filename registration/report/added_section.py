"""Data class of an extra section for the report page: template values, scripts, style sheet."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from markupsafe import Markup


@dataclass(frozen=True, eq=False)
class AddedSection:
    """What the page needs of it.

    Attributes
    ----------
    context : dict
        What its template takes.
    entry : str
        What starts them.
    style : Markup
        Its style sheet.
    """

    context: dict[str, Any]
    entry: str
    style: Markup
