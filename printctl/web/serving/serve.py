"""Run the web server; register of running servers."""

from __future__ import annotations

import asyncio
import gc
import json
import logging
import os
import re
import socket
import ssl
import stat
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Final

import uvicorn
from filelock import FileLock, Timeout

from printctl.errors import PrintctlError, UsageError
from printctl.web.core import Core
from printctl.web.security.access import Access, make_access
from printctl.web.serving.listening import Connections, bind, url
from printctl.web.serving.stop_process import StopProcess
from printctl.web.settings import ServeSettings
from printctl.web.workspace import Workspace

SERVE: Final = "serve.json"


class AlreadyServedError(PrintctlError):
    """Another server runs in the workspace."""


@dataclass(frozen=True)
class Running:
    """A server, as ``.printctl/serve.json`` tells of it; only the owner may read the file.

    Scripts send ``Authorization: Bearer TOKEN``; ``stop`` is the stop process's address,
    ``started`` s since 1970.
    """

    url: str
    pid: int
    token: str = field(repr=False)
    stop: str
    started: float

    def save(self, workspace: Workspace) -> None:
        """Write it for whoever looks for the server."""
        path = workspace.private / SERVE
        new = path.with_suffix(".new")
        new.unlink(missing_ok=True)
        handle = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            json.dump(asdict(self), file, indent=1)
        new.replace(path)


def find_server(workspace: Workspace) -> Running | None:
    """The server of a workspace; None when it has none, or its end wasn't orderly."""
    try:
        return Running(**json.loads((workspace.private / SERVE).read_text(encoding="utf-8")))
    except (FileNotFoundError, ValueError, TypeError):
        return None


@contextmanager
def only_server(workspace: Workspace) -> Iterator[None]:
    """Hold the workspace's lock.

    Raises
    ------
    AlreadyServedError
        When another server holds it.
    """
    lock = FileLock(workspace.private / "serve.lock")
    try:
        lock.acquire(timeout=0)
    except Timeout as exc:
        other = find_server(workspace)
        where = f" at {other.url} (process {other.pid})" if other else ""
        raise AlreadyServedError(
            f"the workspace {workspace.root} is served already{where}; open that page, or end "
            "that server first"
        ) from exc
    try:
        yield
    finally:
        (workspace.private / SERVE).unlink(missing_ok=True)
        lock.release()


_GRACE_S = 1
MIN_PASSWORD: Final = 12
"""Characters of a password of a page that other machines reach."""
_SECRETS = re.compile(r"((?:token|password)=|bearer\s+|printctl_\d+=)[^&\s\"';]+", re.IGNORECASE)


def serve(settings: ServeSettings, started: Callable[[Running], None]) -> None:
    """Serve until Ctrl-C; ``started`` is told where, once browsers are answered.

    Raises
    ------
    UsageError
        When others could reach the page without a password or token, or the port can't be had.
    AlreadyServedError
        When the workspace has a server.
    """
    check(settings)
    workspace = Workspace(settings.workspace.resolve()).make()
    with only_server(workspace), bind(settings.host, settings.port) as taken:
        port = taken.getsockname()[1]
        access = make_access(settings, workspace, port)
        stop = StopProcess(settings, access)
        try:
            running = Running(
                url=url(settings, port),
                pid=os.getpid(),
                token=access.token,
                stop=f"{url(settings, stop.port)}/stop",
                started=time.time(),
            )

            def answering() -> None:
                running.save(workspace)
                started(running)

            config = _config(settings, workspace, access, stop.port)
            _Server(config, answering).run(sockets=[taken])
        except KeyboardInterrupt:
            pass  # uvicorn has ended in order, and hands the signal on
        finally:
            stop.end()


def check(settings: ServeSettings) -> None:
    """Refuse what would let anybody in.

    Raises
    ------
    UsageError
    """
    if not settings.loopback and settings.password is None and not settings.token_link:
        raise UsageError(
            f"--host {settings.host} can be reached from other machines, who could move the "
            "printer: set a password (--password or --password-file), or let browsers in by a link "
            "(--token)"
        )
    if (settings.tls_cert is None) != (settings.tls_key is None):
        raise UsageError("--tls-cert and --tls-key go together: the certificate and its key")
    for path in filter(None, (settings.tls_cert, settings.tls_key)):
        if not path.is_file():
            raise UsageError(f"there is no file {path}")
    if settings.tls_cert is not None:
        try:
            ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(
                settings.tls_cert, settings.tls_key, password=lambda: b""
            )
        except OSError as exc:
            raise UsageError(
                f"--tls-cert {settings.tls_cert} and --tls-key {settings.tls_key} can't be used: "
                f"{exc.strerror or exc}; give a certificate and its own key, both PEM, without a "
                "password"
            ) from exc
    if settings.password == "":
        raise UsageError("the password is empty")
    length = len(settings.password or "")
    if settings.password is not None and not settings.loopback and length < MIN_PASSWORD:
        raise UsageError(
            f"the password has {length} characters, and --host {settings.host} can be reached from "
            f"other machines, who could try them all: give at least {MIN_PASSWORD}, or let "
            "browsers in by a link (--token)"
        )
    if settings.tls_key is not None:
        refuse_readable(settings.tls_key, "--tls-key")


def refuse_readable(path: Path, option: str) -> None:
    """Refuse a file with a secret that every user of this machine can read or change.

    Raises
    ------
    UsageError
    """
    mode = stat.S_IMODE(path.stat().st_mode)
    if os.name == "posix" and mode & 0o007:
        raise UsageError(
            f"{option} {path} can be read or changed by every user of this machine (mode "
            f"{mode:04o}): `chmod 600 {path}`, and change the secret if somebody may have read it"
        )


class _Server(uvicorn.Server):
    """Accepts connections within limits, and calls ``answering`` once it does."""

    def __init__(self, config: uvicorn.Config, answering: Callable[[], None]) -> None:
        super().__init__(config)
        self._answering = answering

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets=[])
        connections = Connections(self.config, self.server_state, self.lifespan.state)
        self._accepting = [asyncio.create_task(connections.accept(one)) for one in sockets or ()]
        self._answering()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        for task in self._accepting:
            task.cancel()
        await super().shutdown(sockets)


def _config(
    settings: ServeSettings, workspace: Workspace, access: Access, stop_port: int
) -> uvicorn.Config:
    # All that is loaded here stays: to look through it for garbage takes a sixth of the start, and
    # would hold the event loop for 0.1 s now and then as long as the server runs.
    gc.disable()
    from printctl.web.app import build_app, guarded

    core = Core(settings, workspace)
    app = guarded(build_app(core), core, access, stop_port)
    gc.freeze()
    gc.enable()
    return uvicorn.Config(
        app,
        http="h11",
        ws="wsproto",
        log_config=None,
        access_log=logging.getLogger("uvicorn.access").isEnabledFor(logging.INFO),
        proxy_headers=False,
        server_header=False,
        timeout_graceful_shutdown=_GRACE_S,
        ssl_certfile=settings.tls_cert,
        ssl_keyfile=settings.tls_key,
    )


def scrubbed(text: str) -> str:
    """Return a log message without tokens, passwords and cookies."""
    return _SECRETS.sub(r"\1***", text)


def _scrub(record: logging.LogRecord) -> bool:
    record.msg, record.args = scrubbed(record.getMessage()), ()
    return True


def log_to_terminal(verbose: bool) -> None:
    """Have the server's warnings, or each request, written to the terminal, without secrets."""
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
    handler.addFilter(_scrub)
    logging.basicConfig(level=logging.INFO if verbose else logging.WARNING, handlers=[handler])
