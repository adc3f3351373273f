"""Port of the simulated printer: a pseudo-terminal, or a local TCP socket."""

from __future__ import annotations

import contextlib
import errno
import os
import socket
import sys
from pathlib import Path
from typing import Protocol

from sim.errors import ServeError

READ_BYTES = 65536


class Port(Protocol):
    """One end of a line; a host may have the other."""

    address: str
    """What a host opens."""

    def fileno(self) -> int:
        """What to poll."""

    def connected(self, hung_up: bool) -> bool:
        """Whether a host is there now; ``hung_up`` is the poll's answer."""

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


class _PtyPort:
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
        return self._master

    def connected(self, hung_up: bool) -> bool:
        if hung_up and self._termios.tcgetattr(self._master)[2] & self._termios.HUPCL:
            self._ready_line = False
        return not hung_up

    def resets_board(self) -> bool:
        rose = not self._ready_line
        self._ready_line = True
        return rose

    def read(self) -> bytes:
        try:
            return os.read(self._master, READ_BYTES)
        except OSError as exc:
            if exc.errno in (errno.EAGAIN, errno.EIO):
                return b""
            raise

    def write(self, data: bytes) -> int:
        try:
            return os.write(self._master, data)
        except OSError as exc:
            if exc.errno in (errno.EAGAIN, errno.EIO):
                return 0 if exc.errno == errno.EAGAIN else len(data)
            raise

    def close(self) -> None:
        if self._link is not None and self._link.is_symlink():
            with contextlib.suppress(OSError):
                if os.readlink(self._link) == self._name:
                    self._link.unlink()
        for handle in (self._master, self._slave):
            if handle >= 0:
                with contextlib.suppress(OSError):
                    os.close(handle)

    def again(self) -> _PtyPort:
        return _PtyPort(self._link)


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


class _TcpPort:
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
        return (self._client or self._server).fileno()

    def connected(self, hung_up: bool) -> bool:
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
        fresh, self._fresh = self._fresh, False
        return fresh

    def read(self) -> bytes:
        if self._client is None:
            return b""
        try:
            data = self._client.recv(READ_BYTES)
        except BlockingIOError:
            return b""
        except ConnectionError:
            data = b""
        if not data:
            self._client.close()
            self._client = None
        return data

    def write(self, data: bytes) -> int:
        if self._client is None:
            return len(data)
        try:
            return self._client.send(data)
        except BlockingIOError:
            return 0
        except ConnectionError:
            return len(data)

    def close(self) -> None:
        if self._client is not None:
            self._client.close()
        self._server.close()

    def again(self) -> _TcpPort:
        return _TcpPort(self._number)


def open_port(link: Path | None, tcp: int | None) -> Port:
    """Open a TCP port where one is given, else a pseudo-terminal."""
    if tcp is not None:
        return _TcpPort(tcp)
    if not hasattr(os, "openpty"):
        raise ServeError("this system has no pseudo-terminals; use --tcp 0")
    return _PtyPort(link)
