"""`printctl station status`: how the printer stands."""

from __future__ import annotations

from printctl.cli.options import JsonFlag
from printctl.cli.station_options import FolderOption, tell, the_station


def status(folder: FolderOption = None, as_json: JsonFlag = False) -> None:
    """Say where the tip is, how warm it is, what is mounted, and what goes on."""
    tell(the_station(folder).status, as_json)
