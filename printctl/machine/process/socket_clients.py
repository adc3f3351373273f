"""Keep a command socket's clients; when it is full, choose which one makes room for a new one."""

from __future__ import annotations

import contextlib
import errno
import os
import socket
from dataclasses import dataclass, field
from typing import Final

MOST_GUESTS: Final = 200
RETRY_S: Final = 0.25
"""So long a socket that can't accept waits before it tries again."""
NO_HANDLE: Final = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)


@dataclass
class ClientPlace:
    """One client's connection.

    Attributes
    ----------
    socket : socket
    heard, unsent : bytes
    known : bool
        Whether it has asked for something that this socket understands.
    subscribed : bool
    too_long : bool
        Whether the message that it is sending was refused for its length.
    """

    socket: socket.socket
    heard: bytes = b""
    unsent: bytes = b""
    known: bool = False
    subscribed: bool = False
    too_long: bool = False


@dataclass
class ClientPlaces:
    """The clients of a socket, the oldest first."""

    _by_socket: dict[socket.socket, ClientPlace] = field(default_factory=dict)

    def __contains__(self, one: ClientPlace) -> bool:
        return one.socket in self._by_socket

    def __len__(self) -> int:
        return len(self._by_socket)

    def of(self, end: object) -> ClientPlace | None:
        """Return the client of a socket; None of one that has left."""
        return self._by_socket.get(end)  # type: ignore[call-overload]

    def all(self) -> list[ClientPlace]:
        """Return every client."""
        return list(self._by_socket.values())

    def subscribers(self) -> list[ClientPlace]:
        """Return who hears all news."""
        return [one for one in self._by_socket.values() if one.subscribed]

    def add(self, one: ClientPlace) -> None:
        """Let a client in."""
        self._by_socket[one.socket] = one

    def remove(self, one: ClientPlace) -> None:
        """Let a client out; nothing happens where it has left."""
        self._by_socket.pop(one.socket, None)

    def leaver(self) -> ClientPlace | None:
        """Return who makes room for a new client, which may bring a kill.

        First who has asked for nothing yet, then who isn't subscribed; of these the oldest.
        """
        return min(
            self._by_socket.values(), key=lambda one: (one.known, one.subscribed), default=None
        )


class Reserve:
    """A file handle kept back, so that a socket without handles can let one client in."""

    def __init__(self) -> None:
        self._handle = -1
        self.refill()

    def refill(self) -> None:
        """Take a handle back, if one is free."""
        if self._handle < 0:
            with contextlib.suppress(OSError):
                self._handle = os.open(os.devnull, os.O_RDONLY)

    def close(self) -> bool:
        """Give the handle away; return whether there was one."""
        if self._handle < 0:
            return False
        os.close(self._handle)
        self._handle = -1
        return True
