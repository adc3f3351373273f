"""`printctl station push`: push ink, or draw the plunger back, by a volume."""

from __future__ import annotations

from typing import Annotated

import typer

from printctl.cli.options import JsonFlag
from printctl.cli.station_options import FolderOption, print_status, the_station


def push(
    ul: Annotated[float, typer.Option("--ul", help="So much, µL; below 0 draws back.")],
    speed: Annotated[
        float | None, typer.Option("--speed", help="In µL/s; the ink's own without.")
    ] = None,
    folder: FolderOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Push ink, or draw the plunger back, within what the syringe mounted has left.

    The station counts what is left; a full syringe is told it by `printctl station mount`.
    """
    print_status(the_station(folder).plunger(ul, speed), as_json)
