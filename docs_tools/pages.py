"""Draw the guide's pictures of the page: `python -m docs_tools.pages`, in about three minutes.

Two examples are rehearsed in a workspace of its own as a user would, one of them printed and held;
what the page shows then is the picture.
"""

from __future__ import annotations

import io
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from PIL import Image
from playwright.sync_api import Page, sync_playwright

PICTURES: Final = Path(__file__).parents[1] / "docs" / "images"
WIDE: Final = (1280, 800)
PHONE: Final = (400, 800)
_LONG_MS: Final = 600_000


def main() -> None:
    """Draw them all."""
    found = next(filter(None, map(shutil.which, ("chromium-headless-shell", "chromium"))), None)
    with (
        tempfile.TemporaryDirectory() as folder,
        _server(Path(folder)) as url,
        sync_playwright() as playwright,
    ):
        browser = playwright.chromium.launch(
            executable_path=found, args=["--no-sandbox", "--enable-unsafe-swiftshader"]
        )
        page = browser.new_page()
        page.set_default_timeout(_LONG_MS)
        _way(page, url, "A small tree")
        _way(page, url, "Four channels", drawn=False)
        _design(page, url)
        _scan(page, url)
        _job(page, url)
        _history(page, url)
        browser.close()


@contextmanager
def _server(workspace: Path) -> Iterator[str]:
    """Start the server with a history of its own; give its address."""
    command = [sys.executable, "-m", "printctl", "serve", str(workspace / "lab"), "--port", "0"]
    environment = os.environ | {"PRINTCTL_DATA": str(workspace / "data")}
    record = workspace / "lab" / ".printctl" / "serve.json"
    with subprocess.Popen([*command, "--no-open"], env=environment) as process:
        while not record.exists():
            if process.poll() is not None:
                raise RuntimeError("the server didn't start")
            time.sleep(0.1)
        try:
            yield json.loads(record.read_text(encoding="utf-8"))["url"]
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(30)


def _draw(page: Page, name: str, size: tuple[int, int] = WIDE, theme: Any = "light") -> None:
    """Write what the page shows as ``page_NAME.png``."""
    page.set_viewport_size({"width": size[0], "height": size[1]})
    page.emulate_media(color_scheme=theme)
    page.wait_for_timeout(1500)
    picture = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
    picture.quantize(128, dither=Image.Dither.NONE).save(
        PICTURES / f"page_{name}.png", optimize=True
    )


def _press(page: Page, name: str | re.Pattern[str]) -> None:
    page.get_by_role("button", name=name, exact=isinstance(name, str)).first.click()


def _way(page: Page, url: str, example: str, drawn: bool = True) -> None:
    """From the open page to the report of a rehearsed print."""
    page.goto(url)
    button = page.get_by_role("button", name=f"Start from {example}", exact=True)
    button.wait_for()
    if drawn:
        _draw(page, "home")
    button.click()
    page.get_by_text(re.compile(r"grown in \d|written as")).first.wait_for()
    if drawn:
        _draw(page, "home_shape")
    _press(page, "Make it")
    page.get_by_role("heading", name="let it be printed").wait_for()
    _press(page, "Next: print or rehearse")
    page.get_by_label("How fast").select_option("100")
    _press(page, "Rehearse")
    page.get_by_role("heading", name=re.compile("The rehearsal is|verdict")).wait_for()
    if drawn:
        page.wait_for_timeout(4000)  # the report's picture in 3D
        _draw(page, "home_judge")


def _design(page: Page, url: str) -> None:
    page.goto(f"{url}/design?recipe=planar_tree")
    box = page.get_by_label("x", exact=True).first
    box.wait_for()
    box.fill("-16")
    page.keyboard.press("Tab")
    _draw(page, "design_recipe")
    box.fill("16")
    page.keyboard.press("Tab")
    page.get_by_role("tab", name="Look").click()
    page.wait_for_timeout(4000)
    _draw(page, "design_look")


def _scan(page: Page, url: str) -> None:
    page.goto(f"{url}/scan?scan=run~planar_fresh.rehearsal&run=planar_fresh.rehearsal")
    page.get_by_role("tab", name="Result").click()
    _draw(page, "scan_result")
    page.get_by_role("tab", name="Slices").click()
    page.wait_for_timeout(2000)
    _draw(page, "scan_slices")


def _job(page: Page, url: str) -> None:
    """A simulated printer is connected, prints, and is held."""
    page.goto(f"{url}/job?job=run~planar_fresh")
    _press(page, "Rehearse (simulated)")
    page.get_by_role("button", name="Move the tip to the start").wait_for()
    page.set_viewport_size({"width": WIDE[0], "height": WIDE[1]})
    _draw(page, "job_before")
    _press(page, "Move the tip to the start")
    start = page.get_by_role("button", name=re.compile("^Start on "))
    while not start.is_enabled():
        page.wait_for_timeout(200)
    page.goto(f"{url}/printer")
    page.get_by_role("heading", name="Move").first.wait_for()
    _draw(page, "printer_light")
    _draw(page, "printer_dark", theme="dark")
    _draw(page, "printer_phone", PHONE)
    page.goto(f"{url}/job?job=run~planar_fresh")
    start.click()
    _press(page, "Yes, start it")
    page.get_by_role("heading", name="Printing ·").wait_for()
    page.wait_for_selector("[data-drawn]")
    page.wait_for_timeout(60_000)
    if page.locator("#pc-take").inner_text() != "Release":
        page.locator("#pc-take").click()
    _press(page, "Pause now")
    page.get_by_role("heading", name="Paused ·").wait_for()
    _draw(page, "job_paused")
    _press(page, "Cancel print")
    _press(page, "Yes, cancel it")
    page.get_by_role("heading", name="Stopped ·").wait_for()


def _history(page: Page, url: str) -> None:
    page.goto(f"{url}/history")
    page.get_by_text(re.compile(r"^\d prints")).wait_for()
    _draw(page, "history_list")
    page.get_by_role("region", name="Prints").get_by_role("link").nth(1).click()
    page.wait_for_timeout(1500)
    _draw(page, "history_print")


if __name__ == "__main__":
    main()
