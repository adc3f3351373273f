"""Station: the permanent link to a printer between prints (standby, manual moves, print start).

Goes in: a port and a profile. Comes out: an open connection, its status, answers to requests.
Begin with `process.py`.
"""

from printctl.machine.link.temperatures import Temperature
from printctl.machine.station.client import Station, attach, connect
from printctl.machine.station.status import MountedParts, StationState, StationStatus

__all__ = [
    "MountedParts",
    "Station",
    "StationState",
    "StationStatus",
    "Temperature",
    "attach",
    "connect",
]
