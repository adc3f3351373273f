"""Start message of the stop process: one line of JSON on its standard input."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path

from printctl.web.security.origins import ServerNames
from printctl.web.security.sessions import Sessions


@dataclass(frozen=True)
class StartMessage:
    """Where it listens, and who may come.

    Attributes
    ----------
    root : str
        Workspace.
    host : str
    port : int
        Asked for; another is taken when it is in use.
    page_port : int
        Of the server, whose pages alone may ask.
    scheme : str
    names : tuple of str
    loopback : bool
    secret : str
        Hex; signs the sessions.
    token : str
        Of scripts.
    cookie : str
        Name of the session's cookie.
    revoked : str
        File of sessions that were logged out.
    cert, key : str
        Files of the certificate; empty without.
    """

    root: str
    host: str
    port: int
    page_port: int
    scheme: str
    names: tuple[str, ...]
    loopback: bool
    secret: str = field(repr=False)
    token: str = field(repr=False)
    cookie: str
    revoked: str
    cert: str = ""
    key: str = ""

    def to_json(self) -> str:
        """One line."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, line: str) -> StartMessage:
        """Read `to_json`."""
        said = json.loads(line)
        return cls(**{**said, "names": tuple(said["names"])})

    @property
    def sessions(self) -> Sessions:
        """Reads the browsers' cookies."""
        return Sessions(bytes.fromhex(self.secret), Path(self.revoked))

    @property
    def ours(self) -> ServerNames:
        """Which hosts are ours."""
        return ServerNames(self.scheme, frozenset(self.names), self.loopback)
