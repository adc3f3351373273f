"""The link to a printer between prints: connected, standing by, moved by hand, ready to print."""

from printctl.link.temperatures import Temperature
from printctl.station.client import Station, attach, connect
from printctl.station.status import Mounted, StationState, StationStatus

__all__ = [
    "Mounted",
    "Station",
    "StationState",
    "StationStatus",
    "Temperature",
    "attach",
    "connect",
]
