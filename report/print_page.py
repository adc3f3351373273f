"""Print an HTML page to PDF by an installed Chromium, Chrome or Edge.

The pages' style sheets say how they look on paper (``@media print``); the browser lays them out.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from report.errors import ReportError

TIME_LIMIT_S: Final = 180.0
_NAMES: Final = (
    "chromium-headless-shell", "chromium", "chromium-browser", "google-chrome",
    "google-chrome-stable", "chrome", "microsoft-edge", "microsoft-edge-stable", "msedge",
)  # fmt: skip
_PLACES: Final = (
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
    "/Applications/Chromium.app/Contents/MacOS/Chromium",
    "/Applications/Microsoft Edge.app/Contents/MacOS/Microsoft Edge",
    "C:/Program Files/Google/Chrome/Application/chrome.exe",
    "C:/Program Files (x86)/Google/Chrome/Application/chrome.exe",
    "C:/Program Files (x86)/Microsoft/Edge/Application/msedge.exe",
    "C:/Program Files/Microsoft/Edge/Application/msedge.exe",
)
_OPTIONS: Final = (
    "--headless",
    "--no-first-run",
    "--no-pdf-header-footer",
    # Without a graphics card the page's 3D view is drawn by the processor.
    "--enable-unsafe-swiftshader",
    # Scripts may run for so long (ms of the page's own clock) before the page is printed.
    "--virtual-time-budget=10000",
)
_PDF: Final = b"%PDF-"


def find_browser() -> str | None:
    """Return the path of a browser that prints pages; None where none is installed."""
    return next(_installed(), None)


def _installed() -> Iterator[str]:
    yield from filter(None, map(shutil.which, _NAMES))
    yield from (place for place in _PLACES if Path(place).is_file())


def browser_missing() -> str | None:
    """Return the remedy where no browser is installed; None where one is."""
    if find_browser() is not None:
        return None
    return (
        "a PDF is printed by Chromium, Chrome or Edge, and none was found; install one, or open "
        "the page in any browser and print it"
    )


def print_page(page: Path, pdf: Path) -> None:
    """Print an HTML page to a PDF; an old one is replaced only by a whole new one.

    Parameters
    ----------
    page : Path
        It must hold all that it shows.
    pdf : Path

    Raises
    ------
    ReportError
        When no browser is installed, or it fails or takes longer than `TIME_LIMIT_S`.
    OSError
        When the file can't be written.
    """
    browser = find_browser()
    if browser is None:
        raise ReportError(str(browser_missing()))
    # Beside the page: a browser in a container of its own (snap) sees no other temporary folder.
    with TemporaryDirectory(prefix="printing-", dir=pdf.parent, ignore_cleanup_errors=True) as name:
        folder = Path(name).resolve()
        draft = folder / "page.pdf"
        # A profile of its own: the user's may be in use, and holds extensions.
        command = [browser, *_OPTIONS, *_root(), f"--user-data-dir={folder / 'profile'}",
                   f"--print-to-pdf={draft}", page.resolve().as_uri()]  # fmt: skip
        said = _run(command, folder / "log", page)
        if not (draft.is_file() and draft.read_bytes().startswith(_PDF)):
            raise ReportError(
                f"{page}: {Path(browser).name} wrote no PDF ({said}); open the page in a browser "
                "and print it"
            )
        draft.replace(pdf)


def _root() -> list[str]:
    """Return the option without which the browser refuses to run as root."""
    return ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []


def _run(command: list[str], log: Path, page: Path) -> str:
    """Run the browser to its end; return the last line that it wrote."""
    with log.open("wb") as out:
        try:
            subprocess.run(
                command, stdin=subprocess.DEVNULL, stdout=out, stderr=out, timeout=TIME_LIMIT_S,
                check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired as exc:
            raise ReportError(
                f"{page}: {Path(command[0]).name} didn't print it within {TIME_LIMIT_S:g} s; open "
                "the page in a browser and print it"
            ) from exc
    lines = log.read_text(encoding="utf-8", errors="replace").splitlines()
    return lines[-1] if lines else "it said nothing"
