"""`printctl station home`: home axes; refused while a needle is mounted."""

from __future__ import annotations

from typing import Annotated

import typer

from printctl.cli.options import JsonFlag
from printctl.cli.station_options import FolderOption, print_status, the_station


def home(
    axes: Annotated[str, typer.Argument(help="Which, such as xy.")] = "xyz",
    needle_off: Annotated[
        bool, typer.Option("--needle-off", help="The needle is off the machine.")
    ] = False,
    folder: FolderOption = None,
    as_json: JsonFlag = False,
) -> None:
    """Home axes; refused as long as a needle is mounted: it would be driven into what is below.

    Axes that are homed are trusted from then on; what the needle may do follows from that.
    """
    print_status(the_station(folder).home(list(axes), needle_off=needle_off), as_json)
