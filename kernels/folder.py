"""Folder of compiled kernels, named by everything that their machine code depends on."""

from __future__ import annotations

import hashlib
import os
import platform
import shutil
import tempfile
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Final

SOURCES: Final = Path(__file__).resolve().parent.parent
"""Parent folder of all packages."""

PACKAGES: Final = (
    "design",
    "firmware_profiles",
    "gcode",
    "kernels",
    "printctl/checks/lumens",
    "printctl/inspection",
    "registration",
    "report",
    "sim",
)
"""Folders whose source files may change a kernel; of `printctl` two packages, whose kernels take
nothing from its others."""

_KEPT_FOLDERS: Final = 4
"""Folders of earlier sources or versions that stay, newest first; each takes about 100 MB."""


def cache_dir() -> Path:
    """Return the folder of all compiled kernels, below the user's cache.

    ``PRINTCTL_CACHE`` moves it.
    """
    base = os.environ.get("PRINTCTL_CACHE")
    root = Path(base) if base else Path.home() / ".cache" / "printctl"
    return _absolute(root) / "kernels"


@cache
def _absolute(root: Path) -> Path:
    """Where ``root`` was when it was first asked for: a process may change its folder."""
    return root.absolute()


def kernel_folder() -> Path:
    """Return the folder for kernels of these sources, compiler versions and this processor.

    A folder of this process alone where the user's cache can't be written.
    """
    return _made(cache_dir())


@cache
def _made(root: Path) -> Path:
    folder = root / _digest()
    try:
        if not folder.is_dir():
            folder.mkdir(parents=True, mode=0o700)
            _remove_old(root, folder)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return Path(tempfile.mkdtemp(prefix="printctl-kernels-"))
    return folder


def _digest() -> str:
    """Digest of all source files that a kernel can see: too many rather than too few."""
    # Within a folder numba's own index tells processors' features apart.
    versions = [platform.python_version(), platform.machine()]
    versions += [version(one) for one in ("numba", "llvmlite", "numpy")]
    hasher = hashlib.sha1(" ".join(versions).encode(), usedforsecurity=False)
    for package in PACKAGES:
        for folder, _, names in sorted(os.walk(SOURCES / package)):
            for name in sorted(names):
                if name.endswith(".py"):
                    with open(os.path.join(folder, name), "rb") as file:
                        content = file.read()
                    hasher.update(f"{name} {len(content)} ".encode())
                    hasher.update(content)
    return hasher.hexdigest()


def _remove_old(root: Path, kept: Path) -> None:
    """Remove folders of former sources but the newest few."""
    with suppress(OSError):
        others = sorted(
            (one for one in root.iterdir() if one != kept), key=lambda one: one.stat().st_mtime
        )
        for one in others[:-_KEPT_FOLDERS]:
            shutil.rmtree(one, ignore_errors=True)
