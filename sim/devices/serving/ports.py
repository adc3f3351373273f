"""Port of the simulated printer: a pseudo-terminal, or a local TCP socket."""

from __future__ import annotations

import contextlib
import errno
import os
import select
import socket
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from sim.errors import ServeError

_READ_BYTES = 65536


class Port(Protocol):
    """One end of a line; the host has the other, or nobody."""

    address: str
    """What a host opens."""

    def fileno(self) -> int:
        """What to poll."""

    def connected(self, hung_up: bool) -> bool:
        """Whether a host is there now; ``hung_up`` is what the poll said."""

    def resets_board(self) -> bool:
        """Whether the host that has just come pulled the reset line."""

    def read(self) -> bytes:
        """What the host has sent; empty when nothing is there."""

    def write(self, data: bytes) -> int:
        """Send what fits; returns how many bytes did."""

    def close(self) -> None:
        """Take the port away."""

    def again(self) -> Port:
        """A port of the same name, after this one was closed."""


class PtyPort:
    """A pseudo-terminal, raw, with a link of a fixed name to it.

    A host may open and close it as often as it likes. On Linux its absence is seen, and the data
    terminal ready line is modelled: it rises when a host opens the port, and falls at the close
    unless the host has cleared the hang-up flag (HUPCL); each rise resets boards that have it so.
    Elsewhere the port's own side stays open, so that a host's absence isn't seen.
    """

    def __init__(self, link: Path | None) -> None:
        import termios  # not on Windows
        import tty

        self._termios = termios
        self._master, slave = os.openpty()
        tty.setraw(slave)
        modes = termios.tcgetattr(slave)
        modes[2] |= termios.HUPCL
        termios.tcsetattr(slave, termios.TCSANOW, modes)
        os.set_blocking(self._master, False)
        self._name = os.ttyname(slave)
        self._slave = -1 if sys.platform == "linux" else slave
        if self._slave < 0:
            os.close(slave)
        self._link = link
        self._ready_line = False
        if link is not None:
            _point(link, self._name)
        self.address = self._name if link is None else str(link)

    def fileno(self) -> int:
        """The terminal's master side."""
        return self._master

    def connected(self, hung_up: bool) -> bool:
        """Whether a host has the terminal open."""
        if hung_up and self._termios.tcgetattr(self._master)[2] & self._termios.HUPCL:
            self._ready_line = False
        return not hung_up

    def resets_board(self) -> bool:
        """Whether the ready line has risen since the last call."""
        rose = not self._ready_line
        self._ready_line = True
        return rose

    def read(self) -> bytes:
        """What the host has sent."""
        try:
            return os.read(self._master, _READ_BYTES)
        except BlockingIOError:
            return b""
        except OSError as exc:
            if exc.errno == errno.EIO:
                return b""
            raise

    def write(self, data: bytes) -> int:
        """Send what the terminal takes."""
        try:
            return os.write(self._master, data)
        except BlockingIOError:
            return 0
        except OSError as exc:
            if exc.errno == errno.EIO:
                return len(data)
            raise

    def close(self) -> None:
        """Close the terminal and remove the link, if it is still ours."""
        if self._link is not None and self._link.is_symlink():
            with contextlib.suppress(OSError):
                if os.readlink(self._link) == self._name:
                    self._link.unlink()
        for handle in (self._master, self._slave):
            if handle >= 0:
                with contextlib.suppress(OSError):
                    os.close(handle)

    def again(self) -> PtyPort:
        """A terminal with the same link to it."""
        return PtyPort(self._link)


def _point(link: Path, name: str) -> None:
    """Make ``link`` point to ``name`` in one step; only a link may be replaced."""
    if link.exists() and not link.is_symlink():
        raise ServeError(f"{link} is there already and isn't a link; choose another --link path")
    draft = link.with_name(f".{link.name}.{os.getpid()}.part")
    try:
        link.parent.mkdir(parents=True, exist_ok=True)
        draft.unlink(missing_ok=True)
        draft.symlink_to(name)
        draft.replace(link)
    except OSError as exc:
        raise ServeError(f"can't make the link {link}: {exc.strerror}") from exc


class TcpPort:
    """One host at a time on a local TCP port; a new connection counts as a reset."""

    def __init__(self, port: int) -> None:
        self._server = socket.socket()
        self._server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self._server.bind(("127.0.0.1", port))
        except OSError as exc:
            raise ServeError(f"can't listen on TCP port {port}: {exc.strerror}") from exc
        self._server.listen(1)
        self._server.setblocking(False)
        self._client: socket.socket | None = None
        self._fresh = False
        self._number = int(self._server.getsockname()[1])
        self.address = f"socket://127.0.0.1:{self._number}"

    def fileno(self) -> int:
        """The host's socket, or the listening one."""
        return (self._client or self._server).fileno()

    def connected(self, hung_up: bool) -> bool:
        """Whether a host is there; takes one that is waiting."""
        if self._client is None:
            try:
                self._client, _ = self._server.accept()
            except BlockingIOError:
                return False
            self._client.setblocking(False)
            self._client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._fresh = True
        return True

    def resets_board(self) -> bool:
        """Whether the connection is new since the last call."""
        fresh, self._fresh = self._fresh, False
        return fresh

    def read(self) -> bytes:
        """What the host has sent; the end of the connection drops it."""
        if self._client is None:
            return b""
        try:
            data = self._client.recv(_READ_BYTES)
        except BlockingIOError:
            return b""
        except ConnectionError:
            data = b""
        if not data:
            self._client.close()
            self._client = None
        return data

    def write(self, data: bytes) -> int:
        """Send what the socket takes."""
        if self._client is None:
            return len(data)
        try:
            return self._client.send(data)
        except BlockingIOError:
            return 0
        except ConnectionError:
            return len(data)

    def close(self) -> None:
        """Close both sockets."""
        if self._client is not None:
            self._client.close()
        self._server.close()

    def again(self) -> TcpPort:
        """Listen on the same port."""
        return TcpPort(self._number)


# Wait until a port is ready or an alarm descriptor fires; uses poll where available.


@dataclass(frozen=True)
class Event:
    """What the port is ready for."""

    readable: bool = False
    hung_up: bool = False


_POLL_S = 2e-3
"""`poll` rounds shorter times up to whole milliseconds."""
_NOTHING = Event()
_READABLE = Event(readable=True)


def _event(flags: int) -> Event:
    return Event(bool(flags & select.POLLIN), bool(flags & select.POLLHUP))


class Waiter:
    """Waits for a file descriptor to be readable (and, if asked, writable), or for the alarm's.

    Parameters
    ----------
    alarm : int
        A descriptor that ends every wait when it becomes readable.
    """

    def __init__(self, alarm: int) -> None:
        self._alarm = alarm
        self._watched = -1
        self._poll = None if sys.platform == "win32" else select.poll()
        if self._poll is not None:
            self._poll.register(alarm, select.POLLIN)

    def wait(self, port: int, writes: bool, timeout_s: float) -> Event:
        """Wait for ``port`` (negative: for the alarm only); at most ``timeout_s``."""
        if self._poll is None:
            return self._select(port, writes, timeout_s)
        if 0 < timeout_s < _POLL_S:
            self._select(port, writes, timeout_s)
            timeout_s = 0.0  # it tells no hang-up; poll does
        if port != self._watched:
            if self._watched >= 0:
                self._poll.unregister(self._watched)
            if port >= 0:
                self._poll.register(port, select.POLLIN)
            self._watched = port
        if writes and port >= 0:
            self._poll.modify(port, select.POLLIN | select.POLLOUT)
        event = _NOTHING
        for at, flags in self._poll.poll(timeout_s * 1e3):
            if at == port:
                # The usual answer is made once: this runs for every line of a print.
                event = _READABLE if flags == select.POLLIN else _event(flags)
        if writes and port >= 0:
            self._poll.modify(port, select.POLLIN)
        return event

    def _select(self, port: int, writes: bool, timeout_s: float) -> Event:
        ports = [port] if port >= 0 else []
        ready, _, _ = select.select([*ports, self._alarm], ports if writes else [], [], timeout_s)
        return Event(port in ready)

    def forget(self) -> None:
        """The port was closed."""
        if self._watched >= 0 and self._poll is not None:
            self._poll.unregister(self._watched)
        self._watched = -1
