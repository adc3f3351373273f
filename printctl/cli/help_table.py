"""Help tables in which option names stay whole; imported when help is asked for.

Typer's tables have a column each for long, short and negative names, and cut them with an ellipsis
where the terminal is narrow.
"""

from __future__ import annotations

from typing import Any, Final

from rich.table import Table
from rich.text import Text
from typer import rich_utils

_REQUIRED: Final = "*"


class NameTable(Table):
    """Rich's table, but for one of options: names in one column, which isn't cut."""

    _of_options = False

    def add_row(self, *cells: Any, **named: Any) -> None:
        """Add a row; of an option it is its marks and names, its type, its description."""
        # Tables of commands say their columns first.
        if not self.columns:
            self._of_options = True
            self.add_column(no_wrap=True)
        if self._of_options:
            *names, kind, description = cells
            cells = (_joined(names), kind, description)
        super().add_row(*cells, **named)


def _joined(cells: list[Any]) -> Text:
    """Names below each other, after the mark of what must be given."""
    texts = [cell if isinstance(cell, Text) else Text(str(cell)) for cell in cells]
    said = [text for text in texts if text.plain]
    mark = said.pop(0) if said and said[0].plain == _REQUIRED else None
    names = Text("\n").join(said)
    return names if mark is None else Text(" ").join([mark, names])


def use_name_tables() -> None:
    """Have typer write its help by `NameTable`."""
    # Typer offers no way in: its module looks the class up by this name.
    setattr(rich_utils, "Table", NameTable)  # noqa: B010
