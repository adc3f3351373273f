"""Fixtures that close what link tests open."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.printctl.machine.link.journals import close_all


@pytest.fixture(autouse=True)
def closed_journals() -> Iterator[None]:
    """Close each journal that the test has opened."""
    yield
    close_all()
