"""Fixtures shared by tests of several rooms."""

from __future__ import annotations

import pytest

from tests.printctl.machine.link.jobs import quick_profile


@pytest.fixture(scope="session")
def profile(tmp_path_factory) -> str:
    """A printer that doesn't reset when its port is opened: no wait for its boot."""
    return quick_profile(tmp_path_factory.mktemp("profile"))
