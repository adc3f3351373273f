"""Station: the permanent link to a printer between prints (standby, manual moves, print start)."""

from printctl.link.temperatures import Temperature
from printctl.station.client import Station, attach, connect
from printctl.station.status import MountedParts, StationState, StationStatus

__all__ = [
    "MountedParts",
    "Station",
    "StationState",
    "StationStatus",
    "Temperature",
    "attach",
    "connect",
]
