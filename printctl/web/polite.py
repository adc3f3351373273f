"""Work of the pages that a print comes before."""

from __future__ import annotations

import contextlib
import os
from typing import Final

_LATER: Final = 10


def step_back(niceness: int = _LATER) -> None:
    """Let this process run behind a print's; nothing happens where the system has no such thing."""
    with contextlib.suppress(AttributeError, OSError):  # no os.nice on Windows
        os.nice(niceness)
