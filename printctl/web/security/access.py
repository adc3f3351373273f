"""Check Host, Origin, token and session of a request, for the page and for the stop process.

A page of another origin may make a browser send requests here, and its name may be made to point
here (DNS rebinding): the ``Host`` must be an address or a name of this machine. Starlette's
TrustedHostMiddleware knows names alone; no name can be made to stand for an address, and by which
address this machine is reached (DHCP, a container's host) isn't known in advance.
"""

from __future__ import annotations

import hmac
import ipaddress
import json
import os
import re
import secrets
import socket
import time
from base64 import b64decode
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

import itsdangerous
from starlette.datastructures import Headers
from starlette.requests import cookie_parser

from printctl.web.settings import ServeSettings
from printctl.web.workspace import Workspace

LIFETIME_S: Final = 12 * 3600
"""A browser that is silent for so long must log in again; an open page isn't silent."""
STOP_GRACE_S: Final = 24 * 3600
"""So much longer the stop process takes a session: a stop late is better than a stop refused."""

_HOST: Final = re.compile(r"(\[[0-9a-fA-F:.]+\]|[A-Za-z0-9._-]+)(?::\d{1,5})?")
_ONCE: Final = ("host", "origin", "authorization", "cookie", "sec-fetch-site", "sec-fetch-mode")


def bearer(headers: Headers) -> str | None:
    """Return the token shown, or None."""
    kind, _, value = headers.get("authorization", "").partition(" ")
    return value.strip() if kind.lower() == "bearer" else None


def doubled(headers: Headers) -> str:
    """Return the reason to refuse a header that decides about access and comes twice, or none."""
    name = next((one for one in _ONCE if len(headers.getlist(one)) > 1), "")
    return name and f"the header {name} comes twice; send it once"


@dataclass(frozen=True)
class Access:
    """Who may use a server, whose page is at ``port``.

    Attributes
    ----------
    names : tuple of str
        This machine's, lower case.
    loopback : bool
        Whether only loopback addresses are taken.
    secret : str
        Signs sessions; whoever has it can let anybody in.
    token : str
        For scripts; in ``.printctl/serve.json``.
    revoked : str
        File of the sessions that were logged out, an id a line.
    """

    scheme: str
    names: tuple[str, ...]
    loopback: bool
    port: int
    secret: str = field(repr=False)
    token: str = field(repr=False)
    revoked: str

    @property
    def cookie(self) -> str:
        """Name of the session's cookie: a host's cookies go to all its ports."""
        return f"printctl_{self.port}"

    def host(self, headers: Headers) -> str | None:
        """Return the host asked for, without its port; None when it isn't this server's."""
        match = _HOST.fullmatch(headers.get("host", ""))
        if not match:
            return None
        name = match[1].lower()
        try:
            address = ipaddress.ip_address(name.strip("[]"))
        except ValueError:
            return name if name in self.names else None
        return name if address.is_loopback or not self.loopback else None

    def is_page(self, origin: str, host: str) -> bool:
        """Return whether ``origin`` is the page at ``host``."""
        port = "" if self.port == {"http": 80, "https": 443}[self.scheme] else f":{self.port}"
        return origin.lower() == f"{self.scheme}://{host}{port}"

    def is_token(self, shown: str) -> bool:
        """Return whether a script's token is right, in constant time."""
        return hmac.compare_digest(shown.encode(), self.token.encode())

    def session(self, headers: Headers, grace_s: float) -> dict[str, Any] | None:
        """Return the session in a cookie; None when it is forged, old or logged out."""
        value = cookie_parser(headers.get("cookie", "")).get(self.cookie, "")
        signer = itsdangerous.TimestampSigner(self.secret)
        try:
            data, issued = signer.unsign(value, return_timestamp=True)
            session: dict[str, Any] = json.loads(b64decode(data))
            identity = str(session["id"])
        except (itsdangerous.BadSignature, ValueError, KeyError):
            return None
        late = time.time() - issued.timestamp() > LIFETIME_S + grace_s
        return None if late or self.is_revoked(identity) else session

    def revoke(self, session: str) -> None:
        """Log a session out, for good."""
        with Path(self.revoked).open("a", encoding="ascii") as file:
            file.write(session + "\n")

    def is_revoked(self, session: str) -> bool:
        """Return whether a session was logged out."""
        try:
            return session in Path(self.revoked).read_text(encoding="ascii")
        except FileNotFoundError:
            return False


def make_access(settings: ServeSettings, workspace: Workspace, port: int) -> Access:
    """Return who may use a server at ``port``; another password voids the last one's sessions."""
    key, host = workspace.private / "session.key", socket.gethostname().lower()
    if not key.exists():
        with os.fdopen(os.open(key, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
            file.write(secrets.token_bytes(32))
    short = host.split(".")[0]
    return Access(
        scheme=settings.scheme,
        names=("localhost", host, short, f"{short}.local", *map(str.lower, settings.names or ())),
        loopback=settings.loopback,
        port=port,
        secret=hmac.new(key.read_bytes(), (settings.password or "").encode(), sha256).hexdigest(),
        token=secrets.token_urlsafe(32),
        revoked=str(workspace.private / "revoked"),
    )
