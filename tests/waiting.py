"""Wait for what another process or thread does."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any


def wait_for(
    done: Callable[[], Any], limit_s: float = 30.0, told: Callable[[], object] = str
) -> Any:
    """Return what ``done`` gives once it is true; ``told`` says what there is instead."""
    limit = time.monotonic() + limit_s
    while not (found := done()):
        assert time.monotonic() < limit, f"it never came: {told()}"
        time.sleep(0.02)
    return found
