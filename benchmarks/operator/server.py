"""Start the web server and browsers, for benchmarks."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from benchmarks.common import ROOT, SkippedError
from benchmarks.link.printers import PeerFailedError

WATCHING = 5
WATCHED = "/printer"
_START_S = 120.0
# The wall clock of the touch, before any listener of the page has it.
_NOTE = """window.addEventListener("pointerdown",
  () => { window.touched = performance.timeOrigin + performance.now(); }, true);"""


@contextmanager
def page_server(workspace: Path) -> Iterator[str]:
    """Start ``printctl serve``; give its address."""
    command = [sys.executable, "-m", "printctl", "serve", str(workspace), "--port", "0"]
    record = workspace / ".printctl" / "serve.json"
    with subprocess.Popen([*command, "--no-open"], cwd=ROOT) as process:
        try:
            limit = time.monotonic() + _START_S
            while not record.exists():
                if process.poll() is not None or time.monotonic() > limit:
                    raise PeerFailedError("the page's server didn't start")
                time.sleep(0.1)
            yield json.loads(record.read_text())["url"]
        finally:
            process.send_signal(signal.SIGCONT)
            process.send_signal(signal.SIGINT)
            process.wait(30)


def chromium_path() -> str:
    """Return where Chromium is, or skip the part."""
    found = shutil.which("chromium")
    if found is None:
        raise SkippedError("needs chromium")
    return found


@contextmanager
def workspace() -> Iterator[Path]:
    """Make a workspace of a temporary folder; its prints aren't the user's."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        os.environ["PRINTCTL_DATA"] = folder
        made = Path(folder) / "workspace"
        made.mkdir()
        yield made


@contextmanager
def browsers(count: int) -> Iterator[list[Any]]:
    """Pages of so many browser profiles, empty as yet."""
    chromium = chromium_path()
    from playwright.sync_api import sync_playwright  # Of the extra `test`.

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        pages = [browser.new_context().new_page() for _ in range(count)]
        for page in pages:
            page.add_init_script(_NOTE)
        yield pages
        browser.close()


def show(pages: list[Any], url: str) -> None:
    """Have all of them look at ``url``, and wait until they hear the server."""
    for page in pages:
        page.goto(url)
        page.wait_for_selector("#pc-take:visible")


def touched_at(page: Any) -> float:
    """When the button of a page was touched, on `time.monotonic`, s."""
    _, offset = min(_offset(page) for _ in range(20))
    return float(page.evaluate("window.touched")) / 1e3 + offset


def _offset(page: Any) -> tuple[float, float]:
    """How long an answer took, and the way from the browser's clock to ours, at its middle; s."""
    begin = time.monotonic()
    said = float(page.evaluate("performance.timeOrigin + performance.now()")) / 1e3
    end = time.monotonic()
    return end - begin, (begin + end) / 2 - said
