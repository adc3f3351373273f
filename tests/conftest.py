"""Pytest settings and fixtures shared by all tests."""

import atexit
import gc
import os
import shutil
import tempfile
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import settings

from tests.slower import examples

# Workers fill the cores: of matrices so small a second thread would do nothing but spin.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# No test asserts a wall-clock time; CI tries the same examples each time, a developer new ones.
settings.register_profile(
    "printctl", deadline=None, derandomize="CI" in os.environ, max_examples=examples(100)
)
settings.load_profile("printctl")

# Prints made by tests don't belong into the history of whoever runs them.
os.environ["PRINTCTL_DATA"] = tempfile.mkdtemp(prefix="printctl-test-data-")
atexit.register(shutil.rmtree, os.environ["PRINTCTL_DATA"], ignore_errors=True)


# What is imported and collected stays: to look through it again and again is a fifth of the work.
gc.disable()


def pytest_collection_finish() -> None:
    """Look for garbage among what tests make, not among what was collected."""
    gc.freeze()
    gc.enable()


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """Chromium, once for each worker; skips where there is none."""
    from tests.printctl.web.shell.browsers import chromium  # what pages need, only for them

    with chromium() as found:
        yield found


@pytest.fixture(autouse=True)
def nothing_mounted() -> None:
    """Forget what an earlier test mounted."""
    shutil.rmtree(os.path.join(os.environ["PRINTCTL_DATA"], "mounted"), ignore_errors=True)


@pytest.fixture(autouse=True)
def closed_pages(request: pytest.FixtureRequest) -> Iterator[None]:
    """Close what a browser test has opened: a page left open goes on drawing and asking."""
    if "browser" not in request.fixturenames:
        yield
        return
    browser = request.getfixturevalue("browser")
    before, shared = list(browser.contexts), browser.contexts[0]
    pages = list(shared.pages)
    yield
    for one in [page for page in shared.pages if page not in pages]:
        one.close()
    for context in browser.contexts:
        if context not in before:
            context.close()


LONGEST = (
    "system/test_plate_run", "web/shell/test_pages", "system/test_operator_page",
    "web/design/test_pages", "anatomy/test_templates", "link/test_link_process", "kernels/test_",
    "web/job/test_page", "station/test_kill", "web/stop_process", "web/printer/test_page",
    "system/", "web/job/camera", "web/job", "feedback/test_printed_with", "web/live/test_browser",
    "web/test_serve", "registration/test_register", "cli/test_compare_command",
)  # fmt: skip
"""Files of twenty seconds and more, or their folders, those of a browser among them."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the longest files, so that no worker waits for another's at the end."""
    ranks = {
        path: next((k for k, name in enumerate(LONGEST) if name in path.as_posix()), len(LONGEST))
        for path in {item.path for item in items}
    }
    items.sort(key=lambda item: ranks[item.path])
