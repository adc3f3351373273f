"""`printctl station heat`: set a heater's target within the limits of ink and bath."""

from __future__ import annotations

from typing import Annotated

import typer

from printctl.cli.options import JsonFlag
from printctl.cli.station_options import FolderOption, print_status, the_station


def heat(
    name: Annotated[str, typer.Argument(help="nozzle, bed or chamber.", show_default=False)],
    celsius: Annotated[float, typer.Argument(help="Target, °C; 0 is off.", show_default=False)],
    folder: FolderOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Set a heater's target, within what ink and bath bear; doesn't wait until it is warm.

    Heaters keep their target when this command ends, until it is set to 0 or the station is
    disconnected.
    """
    print_status(the_station(folder).heat(name, celsius), as_json)
