"""Path of the folder of compiled kernels, and the kernel's name from a file's name."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path
from typing import Final

ALL: Final = ".nbc"
"""How the names of all files of the store end."""
FOR_KERNELS: Final = f".inner{ALL}"
"""How those end of kernels that only other kernels call; they hold no machine code."""


def cache_dir() -> Path:
    """Return the folder of compiled kernels, below the user's cache.

    ``PRINTCTL_CACHE`` moves it.
    """
    base = os.environ.get("PRINTCTL_CACHE")
    root = Path(base) if base else Path.home() / ".cache" / "printctl"
    return _absolute(root) / "kernels"


@cache
def _absolute(root: Path) -> Path:
    """Where ``root`` was when it was first asked for: a process may change its folder."""
    return root.absolute()


def kernel_of(file: Path) -> str:
    """Return module and name of the kernel that a file of the store holds."""
    return file.name.rpartition("-")[0]
