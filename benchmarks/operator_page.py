"""REST client and process control of the web server, for the kill benchmarks."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
import uuid
from pathlib import Path
from typing import Any

from benchmarks.checkers.journal_verdict import lives
from benchmarks.link_printers import PeerFailedError
from benchmarks.machine import ROOT

_START_S = 120.0
_ANSWER_S = 300.0
"""For an answer: a first check may have to compile kernels."""
_DOOR = b"printctl.web.stop_process"


class PageServer:
    """``printctl serve`` on a workspace; it may be killed and started again.

    Attributes
    ----------
    workspace : Path
    """

    def __init__(self, workspace: Path) -> None:
        self.workspace = workspace
        self._log = (workspace.parent / "serve.log").open("a")
        self._process: subprocess.Popen[bytes] | None = None
        self._told: dict[str, Any] = {}

    def start(self) -> float:
        """Start it; return how long it took to answer, s."""
        begin = time.monotonic()
        command = [sys.executable, "-m", "printctl", "serve", str(self.workspace)]
        command += ["--port", "0", "--no-open", "--sim-speed", "8"]
        self._process = subprocess.Popen(command, cwd=ROOT, stdout=self._log, stderr=self._log)
        while time.monotonic() - begin < _START_S:
            if self._process.poll() is not None:
                break
            if self._read_record() and self._answers():
                return time.monotonic() - begin
            time.sleep(0.02)
        raise PeerFailedError("the page's server didn't start")

    def end(self) -> None:
        """End it as Ctrl-C does."""
        if self._process is not None and self._process.poll() is None:
            self._process.send_signal(signal.SIGINT)
            try:
                self._process.wait(30)
            except subprocess.TimeoutExpired:
                self.kill()
        self._log.close()

    def kill(self) -> None:
        """Kill the server by kill -9."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()

    def kill_door(self) -> None:
        """Kill the stop process by kill -9."""
        os.kill(self._door_pid(), signal.SIGKILL)

    @property
    def url(self) -> str:
        """Where the page is."""
        return str(self._told["url"])

    def ask(self, path: str, method: str = "GET", body: object = None) -> tuple[int, Any]:
        """Ask the REST interface; return the status and what was said."""
        data = None if body is None else json.dumps(body).encode()
        return self._ask(self.url + path, method, data, "application/json")

    def want(self, path: str, method: str = "POST", body: object = None) -> Any:
        """Ask for what must be granted."""
        status, said = self.ask(path, method, body)
        if status >= 300:
            raise PeerFailedError(f"{method} {path}: {status} {said}")
        return said

    def upload(self, name: str, content: bytes) -> str:
        """Upload a job; return its name in the interface."""
        mark = uuid.uuid4().hex
        head = f'--{mark}\r\nContent-Disposition: form-data; name="file"; filename="{name}"\r\n\r\n'
        data = head.encode() + content + f"\r\n--{mark}--\r\n".encode()
        url = f"{self.url}/api/v1/jobs"
        status, said = self._ask(url, "POST", data, f"multipart/form-data; boundary={mark}")
        if status >= 300:
            raise PeerFailedError(f"the upload of {name}: {status} {said}")
        return str(said["id"])

    def door_answers(self) -> bool:
        """Whether the stop process takes requests."""
        try:
            return self._ask(self._told["stop"].replace("/stop", "/alive"), "GET")[0] == 200
        except OSError:
            return False

    def _ask(
        self, url: str, method: str, data: bytes | None = None, sort: str = ""
    ) -> tuple[int, Any]:
        headers = {"Authorization": f"Bearer {self._told['token']}"}
        headers |= {"Content-Type": sort} if sort else {}
        request = urllib.request.Request(url, data, headers, method=method)
        try:
            with urllib.request.urlopen(request, timeout=_ANSWER_S) as answer:
                return answer.status, json.loads(answer.read() or b"null")
        except urllib.error.HTTPError as exc:
            return exc.code, _said(exc.read())

    def _read_record(self) -> bool:
        try:
            told = json.loads((self.workspace / ".printctl" / "serve.json").read_text())
        except (OSError, ValueError):
            return False
        self._told = told
        return self._process is not None and told["pid"] == self._process.pid

    def _answers(self) -> bool:
        try:
            return self.ask("/api/v1/health")[0] == 200
        except OSError:
            return False

    def _door_pid(self) -> int:
        for place in Path("/proc").iterdir():
            if place.name.isdigit() and lives(int(place.name)):
                words = (place / "stat").read_text().rpartition(")")[2].split()
                ours = self._process is not None and int(words[1]) == self._process.pid
                if ours and _DOOR in (place / "cmdline").read_bytes():
                    return int(place.name)
        raise PeerFailedError("no stop process runs")


def _said(data: bytes) -> Any:
    try:
        return json.loads(data)
    except ValueError:
        return data.decode(errors="replace")[:500]
