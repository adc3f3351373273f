"""Append usage examples and exit codes to the help of each command."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from rich.table import Table
from rich.text import Text
from typer import rich_utils

ALWAYS: Final[Mapping[int, str]] = {0: "done", 1: "failed", 2: "wrong use"}
PRINTS: Final[Mapping[int, str]] = {
    3: "a safety check refused it",
    4: "the printer failed, or the print was cancelled",
}
REACHES: Final[Mapping[int, str]] = {4: "the link to the printer failed"}


@dataclass(frozen=True)
class Manual:
    """Of one command: lines as they would be typed, and exit codes beside `ALWAYS`."""

    examples: tuple[str, ...]
    codes: Mapping[int, str] = field(default_factory=dict)

    def epilog(self) -> str:
        """The end of the command's help, as Markdown."""
        codes = "; ".join(f"{code} {meaning}" for code, meaning in self.exit_codes().items())
        lines = "\n".join(self.examples)
        return f"Examples\n\n```text\n{lines}\n```\n\nExit codes: {codes}."

    def exit_codes(self) -> dict[int, str]:
        """All of them, in order."""
        return dict(sorted({**ALWAYS, **self.codes}.items()))


def _manual(text: str) -> dict[str, Manual]:
    """Read manual.txt: a line `COMMAND: CODE MEANING; ...`, and its examples, indented."""
    made: dict[str, Manual] = {}
    for line in text.splitlines():
        if line.startswith("#"):
            continue
        if line.startswith(" "):
            name, last = made.popitem()
            made[name] = Manual((*last.examples, line.strip()), last.codes)
            continue
        name, _, codes = line.partition(":")
        pairs = (code.strip().split(" ", 1) for code in codes.split(";") if code.strip())
        made[name] = Manual((), {int(code): meaning for code, meaning in pairs})
    return made


MANUAL: Final = _manual(Path(__file__).with_name("manual.txt").read_text(encoding="utf-8"))
"""By the words that follow `printctl`."""


# Typer's tables have a column each for long, short and negative names, and cut them with an
# ellipsis where the terminal is narrow.
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
    stated = [text for text in texts if text.plain]
    mark = stated.pop(0) if stated and stated[0].plain == _REQUIRED else None
    names = Text("\n").join(stated)
    return names if mark is None else Text(" ").join([mark, names])


def use_name_tables() -> None:
    """Have typer write its help by `NameTable`."""
    # Typer offers no way in: its module looks the class up by this name.
    setattr(rich_utils, "Table", NameTable)  # noqa: B010
