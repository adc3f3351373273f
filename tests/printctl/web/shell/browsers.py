"""Chromium for tests of pages."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

CHROMIUM = shutil.which("chromium")
WIDE = {"width": 1280, "height": 800}
PHONE = {"width": 390, "height": 844}
TABLET = {"width": 820, "height": 1180}


@contextmanager
def chromium() -> Iterator[Any]:
    """A browser; skips the test where there is none."""
    if CHROMIUM is None:
        pytest.skip("no chromium here")
    sync_api = pytest.importorskip("playwright.sync_api")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


def shown(browser: Any, url: str, **options: Any) -> Any:
    """A page in a browser profile of its own, once its header hears the server."""
    page = browser.new_context(viewport=options.pop("viewport", WIDE), **options).new_page()
    page.goto(url)
    page.wait_for_selector("#pc-take:visible")
    return page
