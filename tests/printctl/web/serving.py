"""Test server, in this process or as a separate one."""

from __future__ import annotations

import json
import os
import secrets
import signal
import subprocess
import sys
import time
from base64 import b64encode
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import itsdangerous
from fastapi import FastAPI
from starlette.responses import HTMLResponse
from starlette.testclient import TestClient
from starlette.types import ASGIApp

from printctl.web.app import build_app, guarded
from printctl.web.core import Core
from printctl.web.security.access import Access, make_access
from printctl.web.settings import ServeSettings
from printctl.web.workspace import Workspace

ROOT = Path(__file__).resolve().parents[3]
PORT = 8080
PAGE = f"http://127.0.0.1:{PORT}"
_DESCRIBED: dict[str, Callable[[], dict[str, Any]]] = {}


@dataclass(frozen=True)
class Served:
    """An app behind its guard, in this process."""

    core: Core
    app: FastAPI
    access: Access
    guard: ASGIApp

    def client(self, address: str = "127.0.0.1", base: str = PAGE) -> TestClient:
        """A client at an address; it follows no redirect, and keeps cookies."""
        return TestClient(
            self.guard, base_url=base, client=(address, 50_000), follow_redirects=False
        )


def served(folder: Path, **said: object) -> Served:
    """Make one; ``said`` are fields of `ServeSettings`."""
    settings = replace(ServeSettings(folder), **said)  # type: ignore[arg-type]
    workspace = Workspace(folder).make()
    core = Core(settings, workspace)
    app = build_app(core, pages=False)

    @app.get("/printer", include_in_schema=False)
    def page() -> HTMLResponse:
        return HTMLResponse("<!doctype html><script>1</script>")

    described = _DESCRIBED.setdefault("app", app.openapi)
    app.openapi = described  # type: ignore[method-assign]  # the same of every app, slow to make
    access = make_access(settings, workspace, PORT)
    return Served(core, app, access, guarded(app, core, access, PORT + 1))


def session_cookie(access: Access, age_s: float = 0.0, session: str = "") -> dict[str, str]:
    """Return the ``Cookie`` header of a session whose cookie was given ``age_s`` ago."""

    class Signer(itsdangerous.TimestampSigner):
        def get_timestamp(self) -> int:
            return int(time.time() - age_s)

    issued = {"id": session or secrets.token_hex(16), "at": int(time.time() - age_s)}
    data = b64encode(json.dumps(issued).encode())
    return {"Cookie": f"a=b; {access.cookie}={Signer(access.secret).sign(data).decode()}"}


@dataclass(frozen=True)
class Process:
    """A server in a process of its own."""

    url: str
    pid: int
    token: str
    stop: str
    process: subprocess.Popen[str]

    def halt(self) -> None:
        """Make it hang, as a process that never gets the processor."""
        os.kill(self.process.pid, signal.SIGSTOP)

    def go_on(self) -> None:
        """Let it go on."""
        os.kill(self.process.pid, signal.SIGCONT)


@contextmanager
def server_process(workspace: Path, *options: str, limit_s: float = 60.0) -> Iterator[Process]:
    """Start ``printctl serve`` and end it at last."""
    command = [sys.executable, "-m", "printctl", "serve", str(workspace)]
    command += [] if "--port" in options else ["--port", "0"]
    said = workspace.parent / "serve.log"
    with said.open("a") as log:
        process = subprocess.Popen(
            [*command, "--no-open", *options], cwd=ROOT, stderr=log, stdout=log, text=True
        )
    record = workspace / ".printctl" / "serve.json"
    try:
        limit = time.monotonic() + limit_s
        while not _is_of(record, process.pid):
            if process.poll() is not None or time.monotonic() > limit:
                raise RuntimeError(f"the server didn't start: {said.read_text()}")
            time.sleep(0.05)
        told = json.loads(record.read_text())
        yield Process(told["url"], told["pid"], told["token"], told["stop"], process)
    finally:
        process.send_signal(signal.SIGCONT)
        process.send_signal(signal.SIGINT)
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _is_of(record: Path, pid: int) -> bool:
    try:
        return int(json.loads(record.read_text())["pid"]) == pid
    except (OSError, ValueError, KeyError):
        return False
