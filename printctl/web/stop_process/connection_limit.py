"""Connection limit of the stop process: authorised clients always get a place.

A connection that has shown no valid session or token is *unknown*. It has a few seconds to show
one. There are so many places for unknown connections, and so many of them for one address; the
oldest makes room for a new one, since a browser sends its request as soon as it is connected.
Connections that have shown a session or token have places of their own, which unknown ones can't
take.
"""

from __future__ import annotations

import socket
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

UNKNOWN: Final = 3000
PER_ADDRESS: Final = 1500
KNOWN: Final = 64
TO_SHOW_S: Final = 5.0
"""So long an unknown connection has until it shows a session or token."""
IDLE_S: Final = 60.0
"""So long a known one may say nothing; a page asks every 10 s."""


@dataclass(eq=False)
class Connection:
    """One connection of a browser, a script, or of nobody that we know.

    Attributes
    ----------
    socket : socket
    address : str
    since : float, s
        When it came, or of a known one, when it was heard of last.
    heard, unsent : bytes
    known : bool
        Whether it has shown a valid session or token.
    stopping : bool
        Whether it waits for the outcome of a stop; it isn't dropped meanwhile.
    closing : bool
        Whether it is closed once all is sent.
    shaking : bool
        Whether its TLS handshake isn't made yet.
    """

    socket: socket.socket
    address: str
    since: float
    heard: bytes = b""
    unsent: bytes = b""
    known: bool = False
    stopping: bool = False
    closing: bool = False
    shaking: bool = False


@dataclass
class Places:
    """Who has a place now; of each kind the oldest first.

    Attributes
    ----------
    unknown_limit : int
        Places for unknown connections; fewer where the system gives fewer files.
    """

    unknown_limit: int = UNKNOWN
    _known: dict[Connection, None] = field(default_factory=dict)
    _unknown: dict[Connection, None] = field(default_factory=dict)
    _of_address: dict[str, dict[Connection, None]] = field(default_factory=dict)

    def __contains__(self, one: Connection) -> bool:
        return one in self._known or one in self._unknown

    def __iter__(self) -> Iterator[Connection]:
        yield from list(self._known)
        yield from list(self._unknown)

    def take(self, new: Connection) -> Connection | None:
        """Give a place to a new connection; return who must leave for it."""
        mates = self._of_address.setdefault(new.address, {})
        leaves = None
        if len(mates) >= min(PER_ADDRESS, self.unknown_limit // 2):
            leaves = next(iter(mates))
        elif len(self._unknown) >= self.unknown_limit:
            most = max(self._of_address, key=lambda address: len(self._of_address[address]))
            leaves = next(iter(self._of_address[most]))
        mates[new] = self._unknown[new] = None
        return leaves

    def oldest_unknown(self) -> Connection | None:
        """Return who leaves first where the system has no file handle for a new one."""
        return next(iter(self._unknown), None)

    def know(self, one: Connection) -> Connection | None:
        """Note that a connection has shown a session or token; return who must leave for it."""
        if one.known:
            return None
        self.leave(one)
        one.known = True
        idle = (other for other in self._known if not other.stopping)
        leaves = min(idle, key=lambda other: other.since) if len(self._known) >= KNOWN else None
        self._known[one] = None
        return leaves

    def leave(self, one: Connection) -> bool:
        """Take a connection's place back; whether it had one."""
        if one.known:
            return self._known.pop(one, one) is None
        mates = self._of_address.get(one.address, {})
        mates.pop(one, None)
        if not mates:
            self._of_address.pop(one.address, None)
        return self._unknown.pop(one, one) is None

    def late(self, now: float) -> list[Connection]:
        """Return who has had its time."""
        late = [one for one in self._known if not one.stopping and now - one.since > IDLE_S]
        for one in self._unknown:
            if now - one.since <= TO_SHOW_S:
                break  # the rest came later
            late.append(one)
        return late
