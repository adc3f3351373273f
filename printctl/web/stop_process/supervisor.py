"""Start the stop process beside the server, and restart it if it ends."""

from __future__ import annotations

import contextlib
import json
import logging
import os
import subprocess
import sys
import threading
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import printctl
from printctl.errors import PrintctlError
from printctl.web.stop_process.start_message import StartMessage

_LOOK_S: Final = 0.1
_AGAIN_S: Final = 1.0
"""Between two tries to start a stop process that doesn't start."""
_END_S: Final = 1.0

log = logging.getLogger("printctl.web")


class NoStopDoorError(PrintctlError):
    """The stop process doesn't start."""


@dataclass
class StopProcess:
    """The stop process, as the server holds it.

    Attributes
    ----------
    order : StartMessage
    """

    order: StartMessage
    _process: subprocess.Popen[str] | None = None
    _over: threading.Event = field(default_factory=threading.Event)

    @property
    def port(self) -> int:
        """Where it listens, since `start`."""
        return self.order.port

    def start(self) -> None:
        """Start it, and look after it.

        Raises
        ------
        NoStopDoorError
        """
        self._start()
        threading.Thread(target=self._look_after, name="stop process", daemon=True).start()

    def end(self) -> None:
        """End it, with the server."""
        self._over.set()
        if self._process is not None and self._process.stdin is not None:
            with contextlib.suppress(OSError):
                self._process.stdin.write("end\n")
                self._process.stdin.close()
            try:
                self._process.wait(_END_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
            if self._process.stdout is not None:
                self._process.stdout.close()

    def _start(self) -> None:
        root = str(Path(printctl.__file__).resolve().parents[1])
        paths = os.pathsep.join([root, *filter(None, [os.environ.get("PYTHONPATH")])])
        self._process = process = subprocess.Popen(
            [sys.executable, "-m", "printctl.web.stop_process"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONPATH": paths},
            start_new_session=True,  # a Ctrl-C is the server's alone
        )
        assert process.stdin is not None
        assert process.stdout is not None
        with contextlib.suppress(OSError):
            process.stdin.write(self.order.to_json() + "\n")
            process.stdin.flush()
        line = process.stdout.readline()
        if not line:
            raise NoStopDoorError(
                f"the stop process didn't start (it ended with {process.wait()}); the page isn't "
                "served without, for its red button would depend on the server alone"
            )
        self.order = replace(self.order, port=int(json.loads(line)["port"]))

    def _look_after(self) -> None:
        while not self._over.wait(_LOOK_S):
            if self._process is not None and self._process.poll() is not None:
                log.error("the stop process ended; starting it again")
                try:
                    self._start()
                except NoStopDoorError:
                    self._over.wait(_AGAIN_S)
