"""Stop process: an ASGI app beside the server that can always stop a print; its supervisor.

``python -m printctl.web.serving.stop_process`` reads one line of JSON from standard input and
writes its port to standard output. It serves ``POST /stop`` and ``GET /alive`` to scripts with the
token and to our page, which is of another port, so another origin: it gets CORS headers, nobody
else.

Whoever has shown a valid session or token is never kept out by others; see `Connections`.
"""

from __future__ import annotations

import asyncio
import contextlib
import gc
import json
import logging
import os
import socket
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import AsyncIterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import uvicorn
from starlette.datastructures import Headers
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.types import Receive, Scope, Send
from uvicorn.server import ServerState

import printctl
from printctl.errors import PrintctlError, UsageError
from printctl.machine.records.actor import ACTOR
from printctl.sources import python_command
from printctl.web.controls import Principal
from printctl.web.detached_runs import DetachedProcesses
from printctl.web.print_sockets import PATIENCE_S, PrintSockets, SentStop
from printctl.web.security.access import STOP_GRACE_S, Access, bearer, doubled
from printctl.web.serving.listening import Connections, bind
from printctl.web.settings import MAX_PORT, ServeSettings

FORMER_S: Final = 5.0
"""Longest wait for the stop process of a server that died; it looks once a second."""
log = logging.getLogger("printctl.web")
IDLE_S: Final = 60
"""So long a known connection may be silent; a page asks every 10 s."""
_REHEARSALS_END_S: Final = 1.0


class StopApp:
    """Stops every print of the workspace ``root`` for whoever may, and ends its rehearsals."""

    def __init__(self, access: Access, root: Path) -> None:
        self.prints, self._access, self._root = PrintSockets(root), access, root
        self._ending: asyncio.Task[int] | None = None

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
        answer = Response(status_code=204, headers=more)
        if method != "OPTIONS":
            refusal = self._refusal(f"{method} {scope['path']}", headers, host, ours)
            if refusal is not None:
                body = {"error": refusal[1], "message": refusal[2]}
                answer = JSONResponse(body, refusal[0], more | {"connection": "close"})
            else:
                scope["state"]["know"]()
                if method == "GET":
                    facts = {"ready": True, "connected": self.prints.connected}
                    answer = JSONResponse(facts, headers=more)
                else:
                    session = self._access.session(headers, STOP_GRACE_S) or {}
                    address = (scope.get("client") or ["an unknown address"])[0]
                    name = f"the emergency stop at {address} ({session.get('id', 'script')[:3]})"
                    ACTOR.set(Principal("", name, session.get("user", "")).actor)
                    sent = await self.prints.kill(began)
                    ending = asyncio.to_thread(DetachedProcesses().end_rehearsals, self._root)
                    self._ending = asyncio.create_task(ending)
                    lines = self._lines(sent, self._ending)
                    answer = StreamingResponse(lines, 200, more, "application/x-ndjson")
        await answer(scope, receive, send)

    async def _lines(
        self, sent: Sequence[SentStop], ending: asyncio.Task[int]
    ) -> AsyncIterator[str]:
        yield json.dumps({"sent": [asdict(one) for one in sent]}) + "\n"
        yield json.dumps({"outcome": await self.prints.outcomes(sent)}) + "\n"
        await asyncio.wait({ending}, timeout=_REHEARSALS_END_S)
        if ending.done() and not ending.exception() and ending.result():
            yield json.dumps({"rehearsals_ended": ending.result()}) + "\n"

    def _refusal(
        self, request: str, headers: Headers, host: str | None, ours: bool
    ) -> tuple[int, str, str] | None:
        """Return status, error and reason for who may not; None for who may."""
        if request not in ("POST /stop", "GET /alive"):
            return 404, "NotFoundError", "there is only POST /stop and GET /alive"
        if reason := doubled(headers):
            return 400, "BadRequestError", reason
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


async def _serve(order: dict[str, Any]) -> None:
    """Serve until the input has a word; when it ends without (the server died), while needed.

    Needed is this process as long as something is connected that a page might want to stop, unless
    a new server has taken over the workspace.
    """
    root = Path(order["root"])
    app = StopApp(Access(**order["access"]), root)
    record = root / ".printctl" / "serve.json"
    try:
        if not order.get("again"):
            await _end_former(order["port"], record)
        listener = bind(order["host"], order["port"])
    except UsageError:
        if order.get("again"):
            os._exit(1)
        listener = bind(order["host"], 0)
    loop = asyncio.get_running_loop()
    word: asyncio.Future[str] = loop.create_future()
    read = lambda: loop.call_soon_threadsafe(word.set_result, sys.stdin.readline())  # noqa: E731
    threading.Thread(target=read, daemon=True).start()
    config = uvicorn.Config(
        app, interface="asgi3", lifespan="off", http="h11", ws="none", log_config=None,
        access_log=False, proxy_headers=False, timeout_keep_alive=IDLE_S,
        ssl_certfile=order["cert"] or None, ssl_keyfile=order["key"] or None,
    )  # fmt: skip
    config.load()
    gc.freeze()  # looking through all modules for garbage would hold up a stop
    connections = Connections(config, ServerState(), {})
    work = (app.prints.follow(), connections.accept(listener))
    tasks: set[asyncio.Future[Any]] = {asyncio.create_task(one) for one in work}
    print(json.dumps({"port": listener.getsockname()[1]}), flush=True)
    await asyncio.wait({*tasks, word}, return_when=asyncio.FIRST_COMPLETED)
    if not word.done():  # a task that should never end: the server starts this process again
        raise RuntimeError([task.exception() for task in tasks if task.done()])
    mine = _text(record)
    while not word.result() and app.prints.connected and _text(record) == mine:
        await asyncio.sleep(1.0)
    if not word.result() and _text(record) == mine:
        await asyncio.sleep(PATIENCE_S)  # the answer to what stopped the last print goes out


async def _end_former(port: int, record: Path) -> None:
    """Have the stop process of a server that died give up its port, which open pages know.

    It ends once the record of its server is gone. The server of now holds the workspace's lock.
    """
    if f":{port}/stop" not in _text(record):
        return
    record.unlink(missing_ok=True)
    limit = time.monotonic() + FORMER_S
    while time.monotonic() < limit and _answers(port):
        await asyncio.sleep(0.1)


def _answers(port: int) -> bool:
    with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), 0.5):
        return True
    return False


def _text(path: Path) -> str:
    with contextlib.suppress(OSError):
        return path.read_text(encoding="utf-8")
    return ""


class NoStopProcessError(PrintctlError):
    """The stop process doesn't start."""


class StopProcess:
    """The stop process, held by the server; it listens at ``port``.

    Raises
    ------
    NoStopProcessError
    """

    def __init__(self, settings: ServeSettings, access: Access) -> None:
        self._order = {
            "root": str(settings.workspace.resolve()),
            "host": settings.host,
            "cert": str(settings.tls_cert or ""),
            "key": str(settings.tls_key or ""),
            "access": asdict(access),
        }
        self.port = access.port + 1 if access.port < MAX_PORT else 0
        self._again = False
        self._over = threading.Event()
        self._process = self._start()
        threading.Thread(target=self._restart, name="stop process", daemon=True).start()

    def end(self) -> None:
        """End it, with the server."""
        self._over.set()
        with contextlib.suppress(OSError, subprocess.TimeoutExpired):
            self._process.communicate("end\n", timeout=1.0)
        self._process.kill()
        self._process.wait()

    def _start(self) -> subprocess.Popen[str]:
        paths = [str(Path(printctl.__file__).resolve().parents[1]), os.environ.get("PYTHONPATH")]
        process = subprocess.Popen(
            python_command("printctl.web.serving.stop_process"),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))},
            start_new_session=True,  # a Ctrl-C is the server's alone
        )
        assert process.stdin is not None
        assert process.stdout is not None
        with contextlib.suppress(OSError):
            order = {**self._order, "port": self.port, "again": self._again}
            print(json.dumps(order), file=process.stdin, flush=True)
        line = process.stdout.readline()
        if not line:
            raise NoStopProcessError(
                f"the stop process didn't start (it ended with {process.wait()}); the page isn't "
                "served without, for its red button would depend on the server alone"
            )
        self.port = int(json.loads(line)["port"])
        self._again = True  # pages and `serve.json` say this port: it is taken again, or none
        return process

    def _restart(self) -> None:
        while not self._over.wait(0.1):
            if self._process.poll() is not None:
                log.error("the stop process ended; starting it again")
                try:
                    self._process = self._start()
                except NoStopProcessError:
                    log.error("port %d isn't free for it; trying again", self.port)
                    self._over.wait(1.0)


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
