"""`printctl station reconnect`: connect again after a kill, a reset or a lost port."""

from __future__ import annotations

from printctl.cli.options import JsonFlag
from printctl.cli.station_options import FolderOption, print_status, the_station


def reconnect(folder: FolderOption = None, as_json: JsonFlag = False) -> None:
    """Open the port again and check the printer; see first what its needle stands in.

    After a kill or a lost port. The position isn't trusted until it is homed or said again.
    """
    print_status(the_station(folder).reconnect(), as_json)
