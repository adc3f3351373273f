"""Time from clone to first print in the browser.

What a new user does, and nothing else: ``git clone``, ``cd``, ``make serve``, then clicks, until
the page says that the simulated printer prints. The clone has an environment of its own, installed
anew, and its kernels are compiled on the way. Wheels come from wherever pip is told to take them.
"""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from benchmarks.common import ROOT, Row, SkippedError, limited
from benchmarks.operator.server import browsers, chromium_path

GOAL_S = 300.0
_LONG_MS = 240_000
_OURS = ("PYTHONPATH", "VIRTUAL_ENV", "PRINTCTL_CACHE", "PRINTCTL_DATA", "PRINTCTL_SHARED_DATA")


@contextmanager
def cloned_and_served(folder: Path) -> Iterator[str]:
    """Clone and serve as a new user does; give the page's address."""
    clone = folder / "printctl"
    subprocess.run(["git", "clone", "--quiet", str(ROOT), str(clone)], check=True)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    env = {name: value for name, value in os.environ.items() if name not in _OURS}
    env["PRINTCTL_DATA"] = str(folder / "data")
    command = ["make", "serve", f"ARGS=--no-open --port {port}"]
    log = (folder / "serve.log").open("w")
    with subprocess.Popen(
        command, cwd=clone, env=env, stdout=log, stderr=log, start_new_session=True
    ) as serving:
        try:
            url = f"http://127.0.0.1:{port}"
            _wait_for(url, serving)
            yield url
        finally:
            station = [".venv/bin/printctl", "station", "disconnect"]
            where = ["--folder", "workspace/station"]
            subprocess.run([*station, *where], cwd=clone, env=env, check=False, stdout=log)
            os.killpg(serving.pid, signal.SIGTERM)  # make, and the server that it runs
            log.close()


def _wait_for(url: str, serving: subprocess.Popen[bytes]) -> None:
    limit = time.monotonic() + 900.0
    while time.monotonic() < limit and serving.poll() is None:
        try:
            urllib.request.urlopen(f"{url}/api/v1/health", timeout=1).close()
            return
        except OSError:
            time.sleep(0.2)
    raise RuntimeError("make serve didn't come up")


def clicks(page: Any, url: str) -> Iterator[str]:
    """Click through a first print; yield what is done after some of the clicks."""
    page.goto(url)
    page.get_by_role("button", name="Start from A small tree").click()
    page.get_by_role("button", name="Make it").wait_for(timeout=_LONG_MS)
    yield "the page is up, a project begun"
    page.get_by_role("button", name="Make it").click()
    page.get_by_role("button", name="Next: print or rehearse").click(timeout=_LONG_MS)
    yield "design made and checked"
    page.get_by_label("How fast").select_option("1")
    page.get_by_role("button", name="Rehearse", exact=True).click()
    page.get_by_role("link", name="Watch it print").click(timeout=_LONG_MS)
    page.get_by_role("heading", name=re.compile("^Printing ·")).wait_for(timeout=_LONG_MS)
    yield "first print, seen in the browser"


def rows(quick: bool) -> Iterator[Row]:
    """Yield the time after each step of a first print."""
    if quick:
        raise SkippedError("needs minutes, an installation of its own: not in the quick form")
    chromium_path()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        begin = time.monotonic()
        with cloned_and_served(Path(folder)) as url, browsers(1) as (page,):
            for what in clicks(page, url):
                took = time.monotonic() - begin
                yield limited(f"from git clone: {what}", took, "s", GOAL_S)
            page.click("#pc-stop")  # the print would outlive its server, as it should
            page.get_by_text("has halted").first.wait_for(timeout=60_000)
