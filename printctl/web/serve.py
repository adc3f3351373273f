"""Run the web server as one process until terminated; running prints aren't affected."""

from __future__ import annotations

import gc
import logging
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

import uvicorn

from printctl.errors import UsageError
from printctl.web.core import Core
from printctl.web.listening import bind, url
from printctl.web.security.gate import Gate, make_gate
from printctl.web.security.redaction import Scrubbing
from printctl.web.server_register import Running, only_server
from printctl.web.settings import ServeSettings
from printctl.web.stop_process.start_message import StartMessage
from printctl.web.stop_process.supervisor import StopProcess
from printctl.web.workspace import Workspace

_GRACE_S = 1


def serve(settings: ServeSettings, started: Callable[[Running], None]) -> None:
    """Serve until Ctrl-C.

    Parameters
    ----------
    settings : ServeSettings
    started : callable
        Told where, once browsers are answered.

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
        gate = make_gate(settings, workspace, port)
        door = StopProcess(stop_start_message(settings, workspace, gate, port))
        door.start()
        try:
            gate = replace(gate, stop_port=door.port)
            running = Running(
                url=url(settings, port),
                pid=os.getpid(),
                token=gate.token,
                stop=f"{url(settings, door.port)}/stop",
                started=time.time(),
            )
            with _nothing_collected():
                config = _config(settings, workspace, gate)
            server = _Server(config, running, workspace, started)
            server.run(sockets=[taken])
        except KeyboardInterrupt:
            pass  # uvicorn has ended in order, and hands the signal on
        finally:
            door.end()


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
    if settings.password == "":
        raise UsageError("the password is empty")


def stop_start_message(
    settings: ServeSettings, workspace: Workspace, gate: Gate, port: int
) -> StartMessage:
    """What the stop process is told."""
    return StartMessage(
        root=str(workspace.root),
        host=settings.host,
        port=port + 1 if port < 65535 else 0,
        page_port=port,
        scheme=settings.scheme,
        names=tuple(sorted(gate.ours.names)),
        loopback=gate.ours.loopback,
        secret=gate.sessions.secret.hex(),
        token=gate.token,
        cookie=gate.cookie,
        revoked=str(gate.sessions.revoked),
        cert=str(settings.tls_cert or ""),
        key=str(settings.tls_key or ""),
    )


class _Server(uvicorn.Server):
    """Tells when it answers."""

    def __init__(
        self,
        config: uvicorn.Config,
        running: Running,
        workspace: Workspace,
        started: Callable[[Running], None],
    ) -> None:
        super().__init__(config)
        self._running, self._workspace, self._told = running, workspace, started

    async def startup(self, sockets: list[object] | None = None) -> None:  # type: ignore[override]
        await super().startup(sockets=sockets)  # type: ignore[arg-type]
        if self.started:
            self._running.save(self._workspace)
            self._told(self._running)


def _config(settings: ServeSettings, workspace: Workspace, gate: Gate) -> uvicorn.Config:
    os.environ.setdefault("NICEGUI_STORAGE_PATH", str(workspace.private / "nicegui"))
    from printctl.web.app import build_app, guarded  # Loads NiceGUI, which reads the environment.

    core = Core(settings, workspace)
    return uvicorn.Config(
        guarded(build_app(core), core, gate),
        log_config=None,
        access_log=logging.getLogger("uvicorn.access").isEnabledFor(logging.INFO),
        proxy_headers=False,
        server_header=False,
        timeout_graceful_shutdown=_GRACE_S,
        ssl_certfile=settings.tls_cert,
        ssl_keyfile=settings.tls_key,
    )


@contextmanager
def _nothing_collected() -> Iterator[None]:
    """Let what is loaded meanwhile be: all of it stays.

    Looking through it for garbage takes a sixth of the start, and would hold the event loop for
    0.1 s now and then as long as the server runs.
    """
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


def log_to_terminal(verbose: bool) -> None:
    """Have the server's warnings, or each request, written to the terminal, without secrets."""
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
    handler.addFilter(Scrubbing())
    logging.basicConfig(level=logging.INFO if verbose else logging.WARNING, handlers=[handler])
