"""`printctl station jog`: move the tip by steps or to a position, within the soft limits."""

from __future__ import annotations

from typing import Annotated

import typer

from printctl.cli.options import JsonFlag
from printctl.cli.station_options import FolderOption, print_status, the_station
from printctl.errors import UsageError

ByOption = Annotated[float | None, typer.Option(help="By so many mm.")]


def jog(
    x: ByOption = None,
    y: ByOption = None,
    z: ByOption = None,
    to: Annotated[bool, typer.Option("--to", help="The numbers are places, not steps.")] = False,
    speed: Annotated[
        float | None, typer.Option("--speed", help="In mm/s; 5 without, or what Z can.")
    ] = None,
    folder: FolderOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Move the tip in a straight line, by steps or to a place, and wait until it is there.

    What might run into the dish, its floor or the end of an axis is refused.
    """
    given = {axis: mm for axis, mm in (("x", x), ("y", y), ("z", z)) if mm is not None}
    if not given:
        raise UsageError("no axis is named; give --x, --y or --z in mm")
    station = the_station(folder)
    if to:
        print_status(station.move_to(**given, speed_mm_s=speed), as_json)
    else:
        print_status(station.jog(given, speed_mm_s=speed), as_json)
