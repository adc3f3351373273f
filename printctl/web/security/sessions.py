"""Browser sessions as signed cookies of id and time; only logged-out ids are stored.

Standard library only: the stop process reads them, too.
"""

from __future__ import annotations

import hmac
import os
import re
import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Final

LIFETIME_S: Final = 12 * 3600.0
"""A browser that isn't heard of for so long must log in again; an open page is heard of."""
RENEW_S: Final = 1800.0
"""A cookie older than this is renewed at the next request."""
GRACE_S: Final = 24 * 3600.0
"""So much longer the stop process takes a session: a stop late is better than a stop refused."""

_VALUE: Final = re.compile(r"([0-9a-f]{32})\.(\d{1,12})\.([0-9a-f]{64})")


@dataclass(frozen=True)
class Session:
    """A browser that was let in.

    Attributes
    ----------
    id : str
    issued : float, s
        Unix time of the cookie.
    """

    id: str
    issued: float


@dataclass(frozen=True)
class Sessions:
    """Issues and reads cookies.

    Attributes
    ----------
    secret : bytes
        Signs them; whoever has it can let anybody in.
    revoked : Path
        File of the sessions that were logged out, an id a line.
    clock : callable
        Unix time, s.
    """

    secret: bytes = field(repr=False)
    revoked: Path
    clock: Callable[[], float] = time.time

    def issue(self, known: str | None = None) -> str:
        """Give the cookie of a new session, or a fresh one of the session of id ``known``."""
        body = f"{known or secrets.token_hex(16)}.{int(self.clock())}"
        return f"{body}.{self._signature(body)}"

    def read(self, value: str, grace_s: float = 0.0) -> Session | None:
        """Give the session of a cookie; None when it is forged, too old or logged out."""
        match = _VALUE.fullmatch(value)
        if not match:
            return None
        signed = self._signature(f"{match[1]}.{match[2]}")
        if not hmac.compare_digest(signed, match[3]):
            return None
        session = Session(match[1], float(match[2]))
        if self.clock() - session.issued > LIFETIME_S + grace_s or self._is_revoked(session.id):
            return None
        return session

    def revoke(self, session: Session) -> None:
        """Log a session out, for good."""
        with self.revoked.open("a", encoding="ascii") as file:
            file.write(session.id + "\n")

    def _signature(self, body: str) -> str:
        return hmac.new(self.secret, body.encode(), sha256).hexdigest()

    def _is_revoked(self, session: str) -> bool:
        try:
            return session in self.revoked.read_text(encoding="ascii")
        except FileNotFoundError:
            return False


def signing_secret(folder: Path, password: str | None) -> bytes:
    """What cookies are signed by; kept in ``folder``, so that they outlive the server.

    Another password makes every cookie of the last one void.
    """
    path = folder / "session.key"
    if not path.exists():
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(handle, "wb") as file:
            file.write(secrets.token_bytes(32))
    return hmac.new(path.read_bytes(), (password or "").encode(), sha256).digest()
