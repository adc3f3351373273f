"""Data class of an extra section for the report page: template values, scripts, style sheet."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from markupsafe import Markup

from registration.report.scripts import Folders


@dataclass(frozen=True, eq=False)
class AddedSection:
    """What the page needs of it.

    Attributes
    ----------
    context : dict
        What its template takes.
    folders : tuple of (str, Path)
        Its scripts.
    entry : str
        What starts them.
    style : Markup
        Its style sheet.
    """

    context: dict[str, Any]
    folders: Folders
    entry: str
    style: Markup
