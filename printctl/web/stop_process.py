"""Stop process: an ASGI app beside the server that can always stop a print.

``python -m printctl.web.stop_process`` reads one line of JSON from standard input and writes its
port to standard output. It serves ``POST /stop`` and ``GET /alive`` to scripts with the token and
to our page, which is of another port, so another origin: it gets CORS headers, nobody else.

Whoever has shown a valid session or token is never kept out by others. A connection that hasn't has
`SHOW_S` to do so, its TLS handshake included, and the oldest of the host with most of them leaves
where there is no place for a new one: a browser sends its request as soon as it is connected.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import os
import socket
import sys
import threading
import time
import traceback
from collections import Counter
from dataclasses import asdict
from itertools import islice
from pathlib import Path
from typing import Any, Final

import uvicorn
from h11 import LocalProtocolError
from starlette.datastructures import Headers
from starlette.types import Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.server import ServerState

from printctl.errors import UsageError
from printctl.web.listening import bind
from printctl.web.print_sockets import PrintSockets
from printctl.web.security.access import STOP_GRACE_S, Access, bearer

UNKNOWN: Final = 3000
"""Connections that have shown nothing: half of the files that the system is asked for."""
KNOWN: Final = 64
SHOW_S: Final = 5.0
IDLE_S: Final = 60
"""So long a known connection may be silent; a page asks every 10 s."""
_OUTCOME_S: Final = 2.5
_AT_ONCE: Final = 32

Client = tuple[str, int]


class StopApp:
    """Stops every print of the workspace ``root`` for whoever may."""

    def __init__(self, access: Access, root: Path) -> None:
        self.prints, self._access = PrintSockets(root), access
        self._limit, self._state = min(UNKNOWN, _files() // 2), ServerState()
        self._tasks: set[asyncio.Task[None]] = set()
        self._hosts: Counter[str] = Counter()
        self._unknown: dict[Client, tuple[socket.socket, float]] = {}
        self._known: dict[Client, socket.socket] = {}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request; a kill goes out before anything is awaited."""
        began, headers, method = time.monotonic(), Headers(scope=scope), scope["method"]
        host, origin = self._access.host(headers), headers.get("origin")
        ours = bool(host and origin and self._access.is_page(origin, host))
        more = {"vary": "Origin", "x-content-type-options": "nosniff", "cache-control": "no-store"}
        if ours:
            more |= {"access-control-allow-origin": origin or ""}
            more |= {"access-control-allow-credentials": "true"}
            more |= {"access-control-allow-headers": "authorization"}

        async def start(status: int, kind: str) -> None:
            fields = [(k.encode(), v.encode()) for k, v in {**more, "content-type": kind}.items()]
            await send({"type": "http.response.start", "status": status, "headers": fields})

        async def write(line: dict[str, Any], last: bool = True) -> None:
            data = json.dumps(line).encode() + b"\n"
            await send({"type": "http.response.body", "body": data, "more_body": not last})

        if method == "OPTIONS":
            await start(204, "text/plain")
            await send({"type": "http.response.body"})
            return
        refusal = self._refusal(f"{method} {scope['path']}", headers, host, ours)
        if refusal is not None:
            more["connection"] = "close"
            with contextlib.suppress(LocalProtocolError):  # its body is no HTTP, which is answered
                await start(refusal[0], "application/json")
                await write({"error": refusal[1], "message": refusal[2]})
            return
        self._know(scope["client"])
        if method == "GET":
            await start(200, "application/json")
            await write({"ready": True, "connected": self.prints.connected})
            return
        sent = await self.prints.kill(began)
        await start(200, "application/x-ndjson")
        await write({"sent": [asdict(one) for one in sent]}, last=False)
        await write({"outcome": await self.prints.outcomes(sent, _OUTCOME_S)})

    def _refusal(
        self, asked: str, headers: Headers, host: str | None, ours: bool
    ) -> tuple[int, str, str] | None:
        """Return status, error and reason for who may not; None for who may."""
        if asked not in ("POST /stop", "GET /alive"):
            return 404, "NotFoundError", "there is only POST /stop and GET /alive"
        no = "NotAllowedError"
        if host is None:
            return 421, no, "this host isn't a name of this server"
        if "origin" in headers and not ours:
            return 403, no, "asked for by a page of another origin"
        token = bearer(headers)
        if token is not None:
            right = self._access.is_token(token)
            return None if right else (401, no, "wrong token; it stands in .printctl/serve.json")
        if ours and self._access.session(headers, STOP_GRACE_S):
            return None
        return 401, no, "no session: open the page first, or send a token"

    # --- connections -------------------------------------------------------------------------

    def listen(self, listener: socket.socket, cert: str, key: str) -> None:
        """Accept connections in the running event loop, by HTTPS with a certificate."""
        self._config = uvicorn.Config(
            self, interface="asgi3", lifespan="off", ws="none", log_config=None, access_log=False,
            proxy_headers=False, timeout_keep_alive=IDLE_S, h11_max_incomplete_event_size=16_384,
            ssl_certfile=cert or None, ssl_keyfile=key or None,
        )  # fmt: skip
        self._config.load()
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(listener, self._accept, listener)

    def _accept(self, listener: socket.socket) -> None:
        for _ in range(_AT_ONCE):
            try:
                one, address = listener.accept()
            except BlockingIOError:
                return
            except OSError:  # gone already, or no file handle is left for it
                if not self._make_room():
                    time.sleep(0.02)
                return
            one.setblocking(False)
            client = address[:2]
            if len(self._unknown) >= self._limit:
                self._make_room()
            self._unknown[client] = one, time.monotonic()
            self._hosts[client[0]] += 1
            # No protocol before the first bytes: a crowd of silent connections costs little.
            self._loop.add_reader(one, self._begin, client, one)

    async def drop_late(self) -> None:
        """Drop those that have shown nothing for `SHOW_S`, few at once: a stop may be waiting."""
        while True:
            first = list(islice(self._unknown.items(), _AT_ONCE))
            late = [client for client, (_, at) in first if time.monotonic() - at > SHOW_S]
            for client in late:
                self._drop(client)
            await asyncio.sleep(0.01 if late else 0.25)

    def _begin(self, client: Client, one: socket.socket) -> None:
        self._loop.remove_reader(one)
        task = self._loop.create_task(self._speak(client, one))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _speak(self, client: Client, one: socket.socket) -> None:
        tls = self._config.ssl
        try:
            await self._loop.connect_accepted_socket(
                lambda: _Connection(self._config, self._state, {"left": self._pop}), one,
                ssl=tls, ssl_handshake_timeout=SHOW_S if tls else None,
            )  # fmt: skip
        except (OSError, ValueError):  # gone already, or no TLS handshake
            self._pop(client)
            one.close()

    def _make_room(self) -> bool:
        """Drop the oldest unknown connection of the host with most of them, if there is any."""
        most = max(self._hosts, key=lambda host: self._hosts[host], default="")
        leaver = next((client for client in self._unknown if client[0] == most), None)
        self._drop(leaver)
        return leaver is not None

    def _know(self, client: Client | None) -> None:
        """Note that a connection has shown a session or token; it may have gone meanwhile."""
        one = self._pop(client)
        if client and one:
            self._known[client] = one
            if len(self._known) > KNOWN:
                self._drop(next(iter(self._known)))

    def _pop(self, client: Client | None) -> socket.socket | None:
        if client is None or client not in self._unknown:
            return None if client is None else self._known.pop(client, None)
        self._hosts[client[0]] -= 1
        if not self._hosts[client[0]]:
            del self._hosts[client[0]]
        return self._unknown.pop(client)[0]

    def _drop(self, client: Client | None) -> None:
        one = self._pop(client)
        if one is None:
            return
        with contextlib.suppress(OSError):
            try:
                self._loop.remove_reader(one)
                one.close()
            except RuntimeError:  # its transport has it, and closes it at the end of what comes
                one.shutdown(socket.SHUT_RDWR)


class _Connection(H11Protocol):
    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        self.app_state["left"](self.client)


def _files() -> int:
    """Ask for as many files as the system gives; return how many."""
    try:
        import resource  # Windows has none: its sockets aren't counted as files.
    except ImportError:
        return 2 * UNKNOWN
    soft, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = 2 * UNKNOWN if most == resource.RLIM_INFINITY else min(2 * UNKNOWN, most)
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, wanted), most))
    return max(soft, wanted)


async def _serve(order: dict[str, Any]) -> None:
    """Serve until the input has a word; when it ends without (the server died), while needed.

    Needed is this process as long as something is connected that a page might want to stop, unless
    a new server has taken over the workspace.
    """
    root = Path(order["root"])
    app = StopApp(Access(**order["access"]), root)
    try:
        listener = bind(order["host"], order["port"])
    except UsageError:
        if order.get("again"):
            os._exit(1)
        listener = bind(order["host"], 0)
    listener.setblocking(False)
    listener.listen(1024)
    loop = asyncio.get_running_loop()
    word: asyncio.Future[str] = loop.create_future()
    read = lambda: loop.call_soon_threadsafe(word.set_result, sys.stdin.readline())  # noqa: E731
    threading.Thread(target=read, daemon=True).start()
    app.listen(listener, order["cert"], order["key"])
    work = (app.prints.follow(), app.drop_late())
    tasks: set[asyncio.Future[Any]] = {asyncio.create_task(one) for one in work}
    print(json.dumps({"port": listener.getsockname()[1]}), flush=True)
    await asyncio.wait({*tasks, word}, return_when=asyncio.FIRST_COMPLETED)
    if not word.done():  # a task that should never end: the server starts this process again
        raise RuntimeError([task.exception() for task in tasks if task.done()])
    mine = _text(root / ".printctl" / "serve.json")
    while not word.result() and app.prints.connected:
        await asyncio.sleep(1.0)
        if _text(root / ".printctl" / "serve.json") != mine:
            break


def _text(path: Path) -> str:
    with contextlib.suppress(OSError):
        return path.read_text(encoding="utf-8")
    return ""


def main() -> None:
    """Run the stop process."""
    logging.getLogger("uvicorn.error").setLevel(logging.ERROR)  # else each malformed request
    try:
        with asyncio.Runner(loop_factory=asyncio.SelectorEventLoop) as runner:  # Windows has two
            runner.run(_serve(json.loads(sys.stdin.readline())))
    except BaseException:
        traceback.print_exc()
        os._exit(1)
    os._exit(0)  # without waiting for connections that browsers keep open


if __name__ == "__main__":
    main()
