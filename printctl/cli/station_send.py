"""`printctl station send`: send one G-code command to the printer."""

from __future__ import annotations

from typing import Annotated

import typer

from printctl.cli.options import JsonFlag, print_json, print_lines
from printctl.cli.station_options import FolderOption, the_station


def send(
    command: Annotated[str, typer.Argument(help="Such as M503.", show_default=False)],
    folder: FolderOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Send a command and print the reply; moves and heat go by the same limits as jog and heat.

    While a print goes on it is sent between two of its lines.
    """
    lines = the_station(folder).command(command)
    if as_json:
        print_json({"command": command, "lines": lines})
    elif lines:
        print_lines(*lines)
