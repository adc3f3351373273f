"""Settings of `printctl serve`: workspace, address, password, TLS, upload limit, camera."""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

LOOPBACK: Final = "127.0.0.1"
PORT: Final = 8080


@dataclass(frozen=True)
class ServeSettings:
    """Where the page is served, and to whom.

    Attributes
    ----------
    workspace : Path
        Folder of recipes, runs, jobs, scans and prints.
    host : str
        Address to listen at; the loopback unless told otherwise.
    port : int
        0 for any that is free.
    password : str or None
        Asked for at the door; beyond the loopback there must be one, or a token.
    token_link : bool
        Whether browsers are let in by a link with the token in it.
    upload_mb : float, MB
        Largest upload.
    sim_speed : float
        Of the simulated printer, times real time; 0 for as fast as it can.
    tls_cert, tls_key : Path or None
        Files of a certificate and its key, in PEM; with them the page is served by HTTPS.
    names : tuple of str
        Further names of this machine by which browsers may ask for the page.
    camera : str or None
        What OpenCV reads: a device's number or name, a file, an address.
    """

    workspace: Path
    host: str = LOOPBACK
    port: int = PORT
    password: str | None = field(default=None, repr=False)
    token_link: bool = False
    upload_mb: float = 4000.0
    sim_speed: float = 1.0
    tls_cert: Path | None = None
    tls_key: Path | None = None
    names: tuple[str, ...] = ()
    camera: str | None = field(default=None, repr=False)

    @property
    def loopback(self) -> bool:
        """Whether only this machine can reach the page."""
        return is_loopback(self.host)

    @property
    def open(self) -> bool:
        """Whether a visit of a page suffices to be let in."""
        return self.loopback and self.password is None and not self.token_link

    @property
    def tls(self) -> bool:
        """Whether what goes over the line is encrypted."""
        return self.tls_cert is not None

    @property
    def scheme(self) -> str:
        """As in the page's address."""
        return "https" if self.tls else "http"


def is_loopback(host: str) -> bool:
    """Whether an address or name never leaves this machine."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]").split("%")[0]).is_loopback
    except ValueError:
        return False
