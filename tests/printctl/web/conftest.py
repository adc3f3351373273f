"""Browser fixture for page tests."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from tests.printctl.web.shell.browsers import chromium


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Chromium, once for each module; skips where there is none."""
    with chromium() as found:
        yield found
