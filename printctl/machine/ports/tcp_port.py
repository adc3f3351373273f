"""Read and write a printer over TCP: a network bridge, or the simulated printer without a pty."""

from __future__ import annotations

import select
import socket
import threading
import time
from typing import Final

from printctl.machine.errors import PortLost, PortMissing
from printctl.machine.ports.locking import hold_address
from printctl.machine.ports.port_list import PortPrograms

CONNECT_LIMIT_S: Final = 5.0
WRITE_LIMIT_S: Final = 5.0
_CHUNK: Final = 65536


class TcpTransport:
    """See `printctl.machine.ports.transport.Transport`.

    There is no reset line, and nothing that a firmware could tell a new connection by. As with a
    serial port one process of this machine alone may be connected.

    Raises
    ------
    PortMissing
        When nobody listens there.
    PortInUse
        When another printctl on this machine is connected to that address.
    """

    quiet_s: float = 0.25
    stolen: int = 0

    def __init__(self, host: str, port: int, name: str = "") -> None:
        self.name = name or f"tcp:{host}:{port}"
        self._held = hold_address(host, port, self.name)
        try:
            self._socket = socket.create_connection((host, port), CONNECT_LIMIT_S)
        except OSError as exc:
            self._held.close()
            raise PortMissing(
                f"nobody answers at {self.name} ({exc}); check host and port, and that the "
                "printer is on"
            ) from exc
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.setblocking(False)
        self._lock = threading.Lock()

    def programs(self) -> PortPrograms:
        """See `printctl.machine.ports.transport.Transport`: none reads another's connection."""
        return PortPrograms()

    def read(self, timeout: float) -> bytes:
        """Give what has come, waiting at most ``timeout`` s for it; empty for nothing."""
        try:
            ready, _, _ = select.select([self._socket], [], [], max(0.0, timeout))
            data = self._socket.recv(_CHUNK) if ready else None
        except BlockingIOError:
            return b""
        except (OSError, ValueError) as exc:
            raise PortLost(f"connection {self.name} went away: {exc}") from exc
        if data == b"":
            raise PortLost(f"connection {self.name} was closed by the printer")
        return data or b""

    def write(self, data: bytes) -> None:
        """Write all of ``data``, or raise `PortLost` within `WRITE_LIMIT_S`."""
        limit = time.monotonic() + WRITE_LIMIT_S
        while data:
            try:
                with self._lock:
                    data = data[self._socket.send(data) :]
            except BlockingIOError:
                self._wait_writable(limit)
            except (OSError, ValueError) as exc:
                raise PortLost(f"connection {self.name} went away: {exc}") from exc

    def _wait_writable(self, limit: float) -> None:
        _, ready, _ = select.select([], [self._socket], [], max(0.0, limit - time.monotonic()))
        if not ready:
            raise PortLost(f"connection {self.name} took no byte for {WRITE_LIMIT_S:g} s")

    def write_urgent(self, data: bytes) -> None:
        """Write ``data`` at once, from any thread; what TCP has already taken goes before it."""
        try:
            self._socket.send(data)
        except (OSError, ValueError) as exc:
            raise PortLost(f"connection {self.name} went away: {exc}") from exc

    def reset(self) -> bool:
        """Do nothing: there is no reset line."""
        return False

    def close(self) -> None:
        """Let go of the connection; closing twice does no harm."""
        self._socket.close()
        self._held.close()
