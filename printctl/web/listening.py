"""Bind the server's socket; give the page's address on this machine."""

from __future__ import annotations

import errno
import socket

from printctl.errors import UsageError
from printctl.web.settings import ServeSettings


def bind(host: str, port: int) -> socket.socket:
    """Take a port, which nobody else gets then.

    Raises
    ------
    UsageError
        When it is in use, wants rights, or the address isn't this machine's.
    """
    try:
        family, kind, _, _, place = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    except OSError as exc:
        raise UsageError(f"--host {host} is no address: {exc.strerror}") from exc
    taken = socket.socket(family, kind)
    taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        taken.bind(place)
    except OSError as exc:
        taken.close()
        raise UsageError(_why(exc, host, port)) from exc
    return taken


def _why(exc: OSError, host: str, port: int) -> str:
    if exc.errno == errno.EADDRINUSE:
        return f"port {port} at {host} is in use; choose another by --port, or --port 0 for any"
    if exc.errno == errno.EACCES:
        return f"port {port} wants an administrator's rights; choose one above 1023 by --port"
    if exc.errno == errno.EADDRNOTAVAIL:
        return f"{host} is no address of this machine; 127.0.0.1 is itself, 0.0.0.0 all of them"
    return f"can't listen at {host} port {port}: {exc.strerror}"


def url(settings: ServeSettings, port: int) -> str:
    """The page's address on this machine."""
    host = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}.get(settings.host, settings.host)
    host = f"[{host}]" if ":" in host and not host.startswith("[") else host
    return f"{settings.scheme}://{host}:{port}"
