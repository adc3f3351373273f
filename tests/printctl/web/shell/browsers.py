"""Chromium fixture for page tests."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

# Without windows of its own: half the work of a page in the whole browser.
NAMES = ("chromium-headless-shell", "chromium", "chromium-browser")
CHROMIUM = next(filter(None, map(shutil.which, NAMES)), None)
ARGUMENTS = ["--no-sandbox", "--enable-unsafe-swiftshader"]  # 3D without a graphics card
WIDE = {"width": 1280, "height": 800}
PHONE = {"width": 390, "height": 844}
TABLET = {"width": 820, "height": 1180}


@contextmanager
def chromium() -> Iterator[Any]:
    """A browser; skips the test where there is none."""
    if CHROMIUM is None:
        pytest.skip("no chromium here")
    sync_api = pytest.importorskip("playwright.sync_api")
    sync_api.expect.set_options(timeout=30_000)  # as all waits are: CI's cores are shared
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        browser.new_context()  # the profile that tests share (`shown`)
        yield browser
        browser.close()


def serious(page: Any, within: dict[str, list[list[str]]] | None = None) -> list[str]:
    """What axe finds in a page, or within a part of it, that is serious or worse.

    Skips the test where axe isn't installed.
    """
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    return [
        f"{one['id']}: {node['html'][:400]}"
        for one in axe.run(page, context=within).response["violations"]
        if one["impact"] in ("serious", "critical")
        for node in one["nodes"]
    ]


def take_controls(page: Any) -> None:
    """Press until this browser holds the controls; another's are taken over by a second press."""
    take = page.locator("#pc-take")
    while take.inner_text() != "Release":
        take.click()
        page.wait_for_timeout(300)


def shown(
    browser: Any, url: str, viewport: Any = None, color_scheme: Any = None, own: bool = False
) -> Any:
    """A page, once its header hears the server.

    It is of a browser profile that all tests share, with its cache: a page's libraries are read
    once. Where a test wants another person's browser, the profile is the page's ``own``.
    """
    page = (browser.new_context() if own else browser.contexts[0]).new_page()
    page.set_viewport_size(viewport or WIDE)
    page.emulate_media(color_scheme=color_scheme)
    page.goto(url)
    page.wait_for_selector("#pc-take:visible")
    return page


def until(page: Any, expression: str, seconds: float = 30.0) -> None:
    """Wait until a JavaScript expression is true; our pages allow no eval, so it is asked anew."""
    limit = time.monotonic() + seconds
    while not page.evaluate(expression):
        assert time.monotonic() < limit, f"not within {seconds:g} s: {expression}"
        page.wait_for_timeout(50)
