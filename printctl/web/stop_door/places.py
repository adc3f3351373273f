"""Places at the stop door: whoever may stop always finds one, however many others come.

A connection that has shown no valid session or token is *unknown*. It has a few seconds to show
one. There are so many places for unknown connections, and so many of them for one address; the
oldest makes room for a new one, since a browser sends its request as soon as it is connected.
Connections that have shown a session or token have places of their own, which unknown ones can't
take.
"""

from __future__ import annotations

import socket
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

UNKNOWN: Final = 256
PER_ADDRESS: Final = 64
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
    """Who has a place now, the oldest first."""

    _taken: dict[Connection, None] = field(default_factory=dict)

    def __iter__(self) -> Iterator[Connection]:
        return iter(list(self._taken))

    def __contains__(self, one: Connection) -> bool:
        return one in self._taken

    def __len__(self) -> int:
        return len(self._taken)

    def take(self, new: Connection) -> Connection | None:
        """Give a place to a new connection; return who must leave for it."""
        unknown = [one for one in self._taken if not one.known]
        self._taken[new] = None
        if sum(one.address == new.address for one in unknown) >= PER_ADDRESS:
            return next(one for one in unknown if one.address == new.address)
        if len(unknown) >= UNKNOWN:
            address, _ = Counter(one.address for one in unknown).most_common(1)[0]
            return next(one for one in unknown if one.address == address)
        return None

    def know(self, one: Connection) -> Connection | None:
        """Note that a connection has shown a session or token; return who must leave for it."""
        if one.known:
            return None
        one.known = True
        known = [other for other in self._taken if other.known and not other.stopping]
        if len(known) <= KNOWN:
            return None
        return min((other for other in known if other is not one), key=lambda other: other.since)

    def leave(self, one: Connection) -> bool:
        """Take a connection's place back; whether it had one."""
        return self._taken.pop(one, one) is None

    def late(self, now: float) -> list[Connection]:
        """Return who has had its time."""
        return [
            one
            for one in self._taken
            if not one.stopping and now - one.since > (IDLE_S if one.known else TO_SHOW_S)
        ]
