"""`printctl station status`: show tip position, temperatures, mounted parts and activity."""

from __future__ import annotations

from printctl.cli.options import JsonFlag
from printctl.cli.station_options import FolderOption, print_status, the_station


def status(folder: FolderOption = None, as_json: JsonFlag = False) -> None:
    """Say where the tip is, how warm it is, what is mounted, and what goes on.

    Only looks. Exit code 0 whatever the state is, so that a script can read it with --json.
    """
    print_status(the_station(folder).status, as_json)
