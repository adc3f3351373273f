"""Pytest settings and fixtures shared by all tests."""

import atexit
import os
import shutil
import tempfile
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import settings

# Workers fill the cores: of matrices so small a second thread would do nothing but spin.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# No test asserts a wall-clock time; CI tries the same examples each time, a developer new ones.
settings.register_profile("printctl", deadline=None, derandomize="CI" in os.environ)
settings.load_profile("printctl")

# Prints made by tests don't belong into the history of whoever runs them.
os.environ["PRINTCTL_DATA"] = tempfile.mkdtemp(prefix="printctl-test-data-")
atexit.register(shutil.rmtree, os.environ["PRINTCTL_DATA"], ignore_errors=True)


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """Chromium, once for each worker; skips where there is none."""
    from tests.printctl.web.shell.browsers import chromium  # what pages need, only for them

    with chromium() as found:
        yield found


@pytest.fixture(autouse=True)
def closed_pages(request: pytest.FixtureRequest) -> Iterator[None]:
    """Close what a browser test has opened: a page left open goes on drawing and asking."""
    if "browser" not in request.fixturenames:
        yield
        return
    browser = request.getfixturevalue("browser")
    before = list(browser.contexts)
    yield
    for context in browser.contexts:
        if context not in before:
            context.close()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the longest, whole runs, so that no worker waits for another's at the end."""
    items.sort(key=lambda item: "system" not in item.path.parts)
