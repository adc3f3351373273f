"""Tell numba where kernels of these packages are stored."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from numba.core.caching import InTreeCacheLocator

from kernels.folder import PACKAGES, SOURCES, kernel_folder


class KernelLocator(InTreeCacheLocator):
    """Folder of a module's kernels: the same for every copy of the same sources."""

    def __init__(self, function: Callable[..., Any], file: str) -> None:
        super().__init__(function, file)
        self._folder = _folder_of(Path(file).resolve().parent)

    def get_cache_path(self) -> str:
        """Return the folder's path."""
        return str(self._folder)

    def ensure_cache_path(self) -> None:
        """Make the folder; `kernel_folder` has found that it can be written."""
        self._folder.mkdir(parents=True, exist_ok=True)

    @classmethod
    def from_function(cls, function: Callable[..., Any], file: str) -> KernelLocator | None:
        """Return the locator of a kernel of ours, and None for any other function."""
        folder = Path(file).resolve().parent
        if not any(folder.is_relative_to(SOURCES / one) for one in PACKAGES):
            return None
        located: KernelLocator | None = super().from_function(function, file)
        return located


@cache
def _folder_of(folder: Path) -> Path:
    return kernel_folder() / ".".join(folder.relative_to(SOURCES).parts)
