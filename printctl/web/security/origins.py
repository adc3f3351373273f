"""Check Host and Origin headers of requests against this machine's names and addresses.

A page of another origin may make a browser send requests here, and its name may be made to point
here (DNS rebinding): the ``Host`` header must be an address or a name of this machine, and the
``Origin`` of what changes something must be the page's own. Standard library only: Starlette's
TrustedHostMiddleware takes a list of names, not any address.
"""

from __future__ import annotations

import ipaddress
import re
import socket
from dataclasses import dataclass
from typing import Final
from urllib.parse import urlsplit

_HOST: Final = re.compile(r"(\[[0-9a-fA-F:.]+\]|[A-Za-z0-9._-]+)(?::(\d{1,5}))?")
LOCAL_NAMES: Final = frozenset({"localhost"})


@dataclass(frozen=True)
class ServerNames:
    """The server's own names.

    Attributes
    ----------
    scheme : str
        ``http`` or ``https``.
    names : frozenset of str
        Lower case; addresses needn't be named, for no name can be made to stand for them.
    loopback : bool
        Whether only loopback addresses are taken.
    """

    scheme: str
    names: frozenset[str] = LOCAL_NAMES
    loopback: bool = True

    def host(self, header: str) -> str | None:
        """The host name in a ``Host`` header, without its port; None when it isn't ours."""
        match = _HOST.fullmatch(header)
        if not match:
            return None
        name = match[1].lower()
        return name if name in self.names or self._is_address(name) else None

    def is_origin(self, origin: str, host_header: str) -> bool:
        """Whether a request from ``origin`` to ``host_header`` comes from our own page."""
        return origin.lower() == f"{self.scheme}://{host_header}".lower()

    def is_origin_at(self, origin: str, host: str, port: int) -> bool:
        """Whether ``origin`` is the page at ``port`` of the same host (for the stop process)."""
        parts = urlsplit(origin)
        try:
            port_there = parts.port or (443 if self.scheme == "https" else 80)
        except ValueError:
            return False
        name = parts.netloc.rsplit(":", 1)[0] if parts.port else parts.netloc
        return parts.scheme == self.scheme and name.lower() == host and port_there == port

    def _is_address(self, name: str) -> bool:
        try:
            address = ipaddress.ip_address(name.strip("[]"))
        except ValueError:
            return False
        return address.is_loopback or not self.loopback


def own_names(given: tuple[str, ...] = ()) -> frozenset[str]:
    """Names of this machine by which others on its network may ask for it."""
    host = socket.gethostname().lower()
    short = host.split(".")[0]
    return LOCAL_NAMES | {host, short, f"{short}.local", *(name.lower() for name in given)}
