"""Import optional reader libraries only when a file needs them."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

from registration.errors import ScanFileError


def import_extra(module: str, path: Path) -> Any:
    """A module that only some formats need.

    Parameters
    ----------
    module : str
    path : Path
        The file that needs it.

    Raises
    ------
    ScanFileError
        When it isn't installed; the message names the extra.
    """
    try:
        return importlib.import_module(module)
    except ImportError as exc:
        raise ScanFileError(
            f"{path}: needs {module}, which isn't installed; run: pip install 'printctl[scans]'"
        ) from exc
