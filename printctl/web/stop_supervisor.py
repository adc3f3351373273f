"""Start the stop process beside the server, and restart it if it ends."""

from __future__ import annotations

import contextlib
import json
import logging
import os
import subprocess
import threading
from dataclasses import asdict
from pathlib import Path

import printctl
from printctl.errors import PrintctlError
from printctl.sources import python_command
from printctl.web.security.access import Access
from printctl.web.settings import MAX_PORT, ServeSettings

log = logging.getLogger("printctl.web")


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
            python_command("printctl.web.stop_process"),
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
