"""Access settings of the server: token, password, sessions, own host names, attempt limits."""

from __future__ import annotations

import hmac
import secrets
from dataclasses import dataclass, field

from printctl.web.security.origins import ServerNames, own_names
from printctl.web.security.sessions import Sessions, signing_secret
from printctl.web.security.throttle import Throttle
from printctl.web.settings import ServeSettings
from printctl.web.workspace import Workspace


@dataclass(frozen=True)
class Gate:
    """Who is let in, and by what.

    Attributes
    ----------
    sessions : Sessions
    ours : ServerNames
    token : str
        Of scripts; in ``.printctl/serve.json``.
    cookie : str
        Name of the session's cookie: a host's cookies go to all its ports.
    password : str or None
    open : bool
        Whether a visit of a page suffices: on the loopback, unless a password is set.
    stop_port : int
        Of the stop process; 0 when there is none.
    throttle : Throttle
        Of passwords.
    token_throttle : Throttle
        Of tokens; it slows wrong ones down, never the right one.
    """

    sessions: Sessions
    ours: ServerNames
    token: str = field(repr=False)
    cookie: str
    password: str | None = field(default=None, repr=False)
    open: bool = True
    stop_port: int = 0
    throttle: Throttle = field(default_factory=Throttle)
    token_throttle: Throttle = field(default_factory=Throttle)

    def is_token(self, shown: str) -> bool:
        """Whether a script's token is right, in constant time."""
        return hmac.compare_digest(shown.encode(), self.token.encode())

    def is_password(self, shown: str) -> bool:
        """Whether a password is right, in constant time."""
        return self.password is not None and hmac.compare_digest(
            shown.encode(), self.password.encode()
        )


def make_gate(settings: ServeSettings, workspace: Workspace, port: int, stop_port: int = 0) -> Gate:
    """The gate of a server at ``port``."""
    secret = signing_secret(workspace.private, settings.password)
    return Gate(
        sessions=Sessions(secret, workspace.private / "revoked"),
        ours=ServerNames(settings.scheme, own_names(settings.names), settings.loopback),
        token=secrets.token_urlsafe(32),
        cookie=f"printctl_{port}",
        password=settings.password,
        open=settings.loopback and settings.password is None and not settings.token_link,
        stop_port=stop_port,
    )
