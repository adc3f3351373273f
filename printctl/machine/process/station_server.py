"""Command socket server of a station: hand clients' requests to its thread, send its status.

Further requests are those of `printctl.machine.control.idle_commands`, ``mount``, ``reconnect``,
``print``, ``close`` and ``stop_motion``. Each is answered by ``{"event": "reply", "do": ...,
"status": ...}`` once it is done, or by ``refused``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

from printctl.machine.control.station_status import StationStatus
from printctl.machine.process.command_socket import SocketServer, forget, listen
from printctl.machine.process.socket_clients import ClientPlace

__all__ = ["StationServer", "forget", "listen"]

Say = Callable[[dict[str, Any]], None]


class RequestTaker(Protocol):
    """Interface of a station to its socket server."""

    @property
    def status(self) -> StationStatus:
        """As it stands."""
        ...

    @property
    def names(self) -> frozenset[str]:
        """Requests that are known."""
        ...

    def kill(self) -> None:
        """Halt the printer."""
        ...

    def ask(self, do: str, request: dict[str, Any], say: Say) -> None:
        """Take a request; ``say`` is told what is answered, at any time, from any thread."""
        ...


@dataclass
class StationServer(SocketServer):
    """Serves the clients of a station.

    Attributes
    ----------
    station : RequestTaker
    """

    station: RequestTaker

    def kill(self) -> None:
        """Halt the printer."""
        self.station.kill()

    def told(self) -> dict[str, Any]:
        """The station's status."""
        return self.station.status.to_dict()

    def requests(self) -> Mapping[str, Callable[[ClientPlace, dict[str, Any]], None]]:
        """Return what takes each request: the station."""
        return {name: partial(self._hand_on, name) for name in self.station.names}

    def _hand_on(self, name: str, guest: ClientPlace, request: dict[str, Any]) -> None:
        request.pop("answer", None)  # the reply is the answer
        self.station.ask(name, request, partial(self.post, guest))
