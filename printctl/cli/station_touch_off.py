"""`printctl station touch-off`: set the tip's present height as the dish's floor."""

from __future__ import annotations

from typing import Annotated

import typer

from printctl.cli.options import JsonFlag
from printctl.cli.station_options import FolderOption, print_status, the_station


def touch_off(
    foil: Annotated[
        float, typer.Option("--foil", help="Thickness of the foil between tip and floor, mm.")
    ] = 0.0,
    folder: FolderOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Take the tip's height for the dish's floor, below which it isn't let from now on.

    Another needle or another dish forgets the floor; touch off again.
    """
    print_status(the_station(folder).touch_off(foil_mm=foil), as_json)
