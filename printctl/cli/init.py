"""`printctl init`: write a commented starter recipe."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from design.files import write_text
from printctl.cli.options import print_lines
from printctl.errors import UsageError
from printctl.recipe.load import STARTER


def init(
    path: Annotated[Path, typer.Argument(help="Where to write the recipe.")] = Path("recipe.yaml"),
) -> None:
    """Write a commented starter recipe that runs as it stands.

    It prints on the simulated printer. A file that is there isn't overwritten.
    """
    if path.exists():
        raise UsageError(f"{path} exists and isn't overwritten; give another name")
    write_text(path, STARTER.read_text(encoding="utf-8"))
    print_lines(f"{path}", f"next: printctl run {path}")
