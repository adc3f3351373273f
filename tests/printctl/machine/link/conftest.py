"""Fixtures that close what link tests open."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest

from tests.printctl.machine.link.jobs import close_all


@pytest.fixture(autouse=True)
def closed_journals() -> Iterator[None]:
    """Close each journal that the test has opened."""
    yield
    close_all()


@pytest.fixture
def pty() -> Iterator[tuple[int, int]]:
    """Both ends of a pseudo-terminal."""
    if not hasattr(os, "openpty"):
        pytest.skip("no pseudo-terminals here")
    ends = os.openpty()
    yield ends
    for end in ends:
        os.close(end)
