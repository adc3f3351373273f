"""Start the web server and browsers, for benchmarks."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from benchmarks.common import ROOT, SkippedError, scratch
from benchmarks.link.printers import PeerFailedError

START_S = 120.0
# The wall clock of the touch, before any listener of the page has it.
_NOTE = """window.addEventListener("pointerdown",
  () => { window.touched = performance.timeOrigin + performance.now(); }, true);"""


def serve_record(workspace: Path) -> Path:
    """Return the file with address, process and token of a workspace's server."""
    return workspace / ".printctl" / "serve.json"


@contextmanager
def page_server(workspace: Path) -> Iterator[dict[str, Any]]:
    """Start ``printctl serve``; give its record."""
    command = [sys.executable, "-m", "printctl", "serve", str(workspace), "--port", "0"]
    record = serve_record(workspace)
    with subprocess.Popen([*command, "--no-open"], cwd=ROOT) as process:
        try:
            limit = time.monotonic() + START_S
            while not record.exists():
                if process.poll() is not None or time.monotonic() > limit:
                    raise PeerFailedError("the page's server didn't start")
                time.sleep(0.1)
            yield json.loads(record.read_text())
        finally:
            process.send_signal(signal.SIGCONT)
            process.send_signal(signal.SIGINT)
            process.wait(30)


@contextmanager
def workspace() -> Iterator[Path]:
    """Make a workspace in a temporary folder."""
    with scratch() as folder:
        made = folder / "workspace"
        made.mkdir()
        yield made


def chromium_path() -> str:
    """Return where Chromium is, or skip the part."""
    found = shutil.which("chromium") or shutil.which("chromium-headless-shell")
    if found is None:
        raise SkippedError("needs chromium")
    return found


@contextmanager
def browsers(count: int) -> Iterator[list[Any]]:
    """Open pages of so many profiles of one browser, empty as yet; WebGL is SwiftShader's."""
    chromium = chromium_path()
    from playwright.sync_api import sync_playwright  # Of the extra `test`.

    arguments = ["--no-sandbox", "--enable-unsafe-swiftshader"]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=arguments)
        pages = [browser.new_context().new_page() for _ in range(count)]
        for page in pages:
            page.add_init_script(_NOTE)
        yield pages
        browser.close()


def touched_at(page: Any) -> float:
    """Return when the button of a page was touched, on `time.monotonic`, s."""
    _, offset = min(_offset(page) for _ in range(20))
    return float(page.evaluate("window.touched")) / 1e3 + offset


def _offset(page: Any) -> tuple[float, float]:
    """Return an answer's time and the way from the browser's clock to ours at its middle, s."""
    begin = time.monotonic()
    there = float(page.evaluate("performance.timeOrigin + performance.now()")) / 1e3
    end = time.monotonic()
    return end - begin, (begin + end) / 2 - there


def until(page: Any, expression: str) -> None:
    """Wait until a JavaScript expression is true; the pages allow no eval, so it is asked anew."""
    limit = time.monotonic() + START_S
    while not page.evaluate(expression):
        if time.monotonic() > limit:
            raise PeerFailedError(f"not within {START_S:g} s: {expression}")
        page.wait_for_timeout(5)
