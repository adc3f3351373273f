"""`printctl station where`: declare the tip's position to the printer; nothing moves."""

from __future__ import annotations

from typing import Annotated

import typer

from printctl.cli.options import JsonFlag
from printctl.cli.station_options import FolderOption, print_status, the_station

PlaceOption = Annotated[float | None, typer.Option(help="In mm, printer's frame.")]


def where(
    x: PlaceOption = None,
    y: PlaceOption = None,
    z: PlaceOption = None,
    folder: FolderOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Tell the printer where its tip stands; nothing moves. Nobody can check it for you.

    Said by a person who looked: nothing moves, and the soft limits go by it from then on.
    """
    print_status(the_station(folder).set_position(x, y, z), as_json)
