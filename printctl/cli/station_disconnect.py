"""`printctl station disconnect`: switch the heaters off and close the printer's port."""

from __future__ import annotations

from printctl.cli.options import print_lines
from printctl.cli.station_options import FolderOption, the_station


def disconnect(folder: FolderOption = None) -> None:
    """Switch the heaters off and let go of the port; refused while something moves or prints.

    A heater that the profile keeps on (safe_state_on) stays on, and is named.
    """
    station = the_station(folder)
    station.close()
    print_lines(station.status.message)
