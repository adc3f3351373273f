"""Bind a server's socket, give its address, and accept connections within limits."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import json
import random
import socket
from collections import Counter
from functools import partial
from itertools import count, islice
from typing import Any, Final

import h11
import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.server import ServerState

from printctl.errors import UsageError
from printctl.web.settings import ServeSettings

STRANGERS: Final = 3000
"""Most connections that have shown no session or token; a third of the files asked for."""
KNOWN: Final = 256
"""Most connections that have shown one."""
SHOW_S: Final = 10.0
"""Time for a connection to show one, its TLS handshake included, s."""
HEAD_BYTES: Final = 16_384
"""Most of a request's head."""


def bind(host: str, port: int) -> socket.socket:
    """Listen at a port, which nobody else gets then; connections wait until they are accepted.

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
        taken.listen(1024)
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


class Connections:
    """Connections of one server by uvicorn's HTTP/1.1, which limits neither their number nor time.

    The app calls ``scope["state"]["know"]()`` for a request with a valid session or token: its
    connection is never closed for others without. One that shows none has `SHOW_S`, whatever it
    has sent; where there are too many, the oldest of the address with most of them are closed.
    """

    def __init__(
        self, config: uvicorn.Config, state: ServerState, app_state: dict[str, Any]
    ) -> None:
        self._config, self._state, self._app_state = config, state, app_state
        files = _raise_file_limit() // 3
        self._most_strangers, self._most_known = min(STRANGERS, files), min(KNOWN, files)
        self._strangers: dict[socket.socket, str] = {}
        self._known: dict[socket.socket, None] = {}

    async def accept(self, listener: socket.socket) -> None:
        """Accept connections until cancelled."""
        loop = asyncio.get_running_loop()
        listener.setblocking(False)
        for number in count():
            if number % 32 == 0:
                await asyncio.sleep(0)  # a stop may wait behind a crowd
            try:
                one, address = await loop.sock_accept(listener)
            except OSError:  # gone already, or no file is left for it
                self._make_room()
                await asyncio.sleep(0.02)
                continue
            if len(self._strangers) >= self._most_strangers:
                self._make_room()
            self._strangers[one] = address[0]
            # In two steps: a loop that was late itself reads what has come before it closes.
            rest_s = random.uniform(0.1, SHOW_S / 2)  # not thousands at once: a stop may wait
            loop.call_later(SHOW_S, loop.call_later, rest_s, self._close_stranger, one)
            try:  # no protocol before the first byte: a crowd of silent connections costs little
                loop.add_reader(one, self._begin, one)
            except NotImplementedError:  # Windows' own loop
                self._begin(one)

    def _begin(self, one: socket.socket) -> None:
        loop = asyncio.get_running_loop()
        with contextlib.suppress(NotImplementedError):
            loop.remove_reader(one)
        task = loop.create_task(self._speak(one))
        self._state.tasks.add(task)
        task.add_done_callback(self._state.tasks.discard)

    async def _speak(self, one: socket.socket) -> None:
        tls, state = self._config.ssl, {**self._app_state, "know": partial(self._know, one)}
        try:
            await asyncio.get_running_loop().connect_accepted_socket(
                lambda: _Http(self._config, self._state, state), one,
                ssl=tls, ssl_handshake_timeout=SHOW_S if tls else None,
            )  # fmt: skip
        except (OSError, ValueError):  # gone already, or no TLS handshake
            one.close()

    def _make_room(self) -> None:
        self._strangers = {one: host for one, host in self._strangers.items() if one.fileno() >= 0}
        counts = Counter(self._strangers.values())
        most = max(counts, key=counts.__getitem__, default="")
        oldest = (one for one, host in self._strangers.items() if host == most)
        for one in list(islice(oldest, 1 + len(self._strangers) // 16)):
            self._close_stranger(one)

    def _close_stranger(self, one: socket.socket) -> None:
        if self._strangers.pop(one, None) is not None:
            _close(one)

    def _know(self, one: socket.socket) -> None:
        if self._strangers.pop(one, None) is not None:
            self._known[one] = None
            if len(self._known) > self._most_known:
                self._known = {known: None for known in self._known if known.fileno() >= 0}
                for oldest in list(self._known)[: -self._most_known]:
                    del self._known[oldest]
                    _close(oldest)


class _Http(H11Protocol):
    def data_received(self, data: bytes) -> None:
        """Refuse a large head that comes at once; h11 measures only what isn't whole yet."""
        head = self.conn.their_state is not h11.SEND_BODY
        if head and len(data) > HEAD_BYTES and b"\r\n\r\n" not in data[:HEAD_BYTES]:
            self.send_400_response("")
        else:
            super().data_received(data)

    def send_400_response(self, msg: str) -> None:
        """Refuse as the app does, in JSON."""
        if self.cycle is None or self.cycle.response_complete or not self.cycle.response_started:
            message = (
                "this is no HTTP/1.1 request: a malformed line, Host missing or twice, or a head "
                f"of more than {HEAD_BYTES // 1024} kB"
            )
            self.transport.write(
                b"HTTP/1.1 400 Bad Request\r\ncontent-type: application/json\r\n"
                b"connection: close\r\n\r\n"
                + json.dumps({"error": "BadRequestError", "message": message}).encode()
            )
        self.transport.close()


def _close(one: socket.socket) -> None:
    with contextlib.suppress(OSError, ValueError):  # gone already
        try:
            asyncio.get_running_loop().remove_reader(one)
            one.close()
        except RuntimeError:  # it has a transport, which closes it at the end of what comes
            one.shutdown(socket.SHUT_RDWR)


def _raise_file_limit() -> int:
    """Ask for as many files as the system gives, within reason; return how many."""
    wanted = 3 * STRANGERS
    try:
        import resource  # Windows has none: its sockets aren't counted as files.
    except ImportError:
        return wanted
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard != resource.RLIM_INFINITY:
        wanted = min(wanted, hard)
    if soft < wanted:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
    return max(soft, wanted)
