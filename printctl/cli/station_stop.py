"""`printctl station stop`: end a running manual move; the position stays known."""

from __future__ import annotations

from printctl.cli.options import JsonFlag
from printctl.cli.station_options import FolderOption, print_status, the_station


def stop(folder: FolderOption = None, as_json: JsonFlag = False) -> None:
    """End the move that goes on, after at most half a second of it; the position stays known.

    Sending it twice does no harm. For a halt at once there is `printctl station kill`.
    """
    print_status(the_station(folder).stop_motion(), as_json)
