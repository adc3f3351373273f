"""Read method, path, headers, cookies and client from a request, for the access guard."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final
from urllib.parse import parse_qs

from starlette.types import Scope

from printctl.web.security.cookies import cookie_of

_SAFE: Final = frozenset({"GET", "HEAD", "OPTIONS"})
_NO_PAGES: Final = ("/api/", "/_nicegui", "/static/")
_BROWSERS: Final = (
    ("Edg", "Edge"),
    ("OPR/", "Opera"),
    ("Firefox", "Firefox"),
    ("Chrom", "Chrome"),
    ("Safari", "Safari"),
)
_SYSTEMS: Final = ("Android", "iPhone", "iPad", "Windows", "Macintosh", "CrOS", "Linux")


@dataclass(frozen=True)
class RequestFacts:
    """The parts of a request that decide about it.

    Attributes
    ----------
    websocket : bool
    method, path : str
    headers : dict
        Lower-case name to value.
    query : dict of lists
    address : str
        Of the client.
    """

    websocket: bool
    method: str
    path: str
    headers: dict[str, str]
    query: dict[str, list[str]]
    address: str

    @classmethod
    def of(cls, scope: Scope) -> RequestFacts:
        """Read an ASGI scope."""
        client = scope.get("client")
        return cls(
            websocket=scope["type"] == "websocket",
            method=scope.get("method", "GET"),
            path=scope["path"],
            headers={k.decode("latin-1").lower(): v.decode("latin-1") for k, v in scope["headers"]},
            query=parse_qs(scope.get("query_string", b"").decode("latin-1")),
            address=client[0] if client else "",
        )

    @property
    def changes(self) -> bool:
        """Whether it may change something."""
        return self.websocket or self.method not in _SAFE

    @property
    def host(self) -> str:
        """The ``Host`` header."""
        return self.headers.get("host", "")

    @property
    def site(self) -> str:
        """``Sec-Fetch-Site``; empty from what isn't a browser, or an old one."""
        return self.headers.get("sec-fetch-site", "")

    @property
    def for_page(self) -> bool:
        """Whether a browser asks for a page to show."""
        if self.websocket or self.method != "GET" or self.path.startswith(_NO_PAGES):
            return False
        return self.headers.get("sec-fetch-mode", "navigate") == "navigate"

    @property
    def bearer(self) -> str | None:
        """The token shown, or None."""
        kind, _, value = self.headers.get("authorization", "").partition(" ")
        return value.strip() if kind.lower() == "bearer" else None

    def cookie(self, name: str) -> str:
        """A cookie's value; empty without."""
        return cookie_of(self.headers.get("cookie", ""), name)

    @property
    def browser(self) -> str:
        """The browser in words: ``Chrome on Android at 192.168.1.7``."""
        agent = self.headers.get("user-agent", "")
        name = next((said for sign, said in _BROWSERS if sign in agent), "a browser")
        system = next((one for one in _SYSTEMS if one in agent), "")
        system = "Mac" if system == "Macintosh" else system
        where = "this machine" if self.address.startswith(("127.", "::1")) else self.address
        return f"{name}{' on ' + system if system else ''} at {where or 'an unknown address'}"
