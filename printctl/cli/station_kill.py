"""`printctl station kill`: halt the firmware at once (M112); the position is lost."""

from __future__ import annotations

from printctl.cli.options import print_lines
from printctl.cli.station_options import FolderOption, the_station


def kill(folder: FolderOption = None) -> None:
    """Halt the firmware at once (M112), whatever it does; its position is lost.

    `printctl station reconnect` comes back from it, once the machine was looked at.
    """
    the_station(folder).kill()
    print_lines("a halt is sent; `printctl station status` tells whether the printer has halted")
