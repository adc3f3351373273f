"""Write and read files of the compiled-kernel store, atomically and with a checksum."""

from __future__ import annotations

import hashlib
import os
import pickle
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

_DIGEST_BYTES: Final = 32


def read_whole(path: Path) -> tuple[Any, ...] | None:
    """Read a file that `write_whole` wrote; None where it is missing or damaged."""
    try:
        data = path.read_bytes()
        content = data[_DIGEST_BYTES:]
        if data[:_DIGEST_BYTES] != _checksum(path, content):
            return None
        payload: tuple[Any, ...] = pickle.loads(content)
    except (OSError, pickle.UnpicklingError, EOFError, AttributeError, ImportError, ValueError):
        return None
    return payload


def write_whole(path: Path, content: bytes) -> None:
    """Write a pickle so that readers see all of it or none."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, scratch = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(_checksum(path, content) + content)
        os.chmod(scratch, 0o644)  # a cache that one user made may serve others
        os.replace(scratch, path)
    except OSError:
        with suppress(OSError):
            os.unlink(scratch)
        raise


def _checksum(path: Path, content: bytes) -> bytes:
    """Digest of a file's name and content: a file under another's name is damaged, too."""
    return hashlib.sha256(path.name.encode() + b"\0" + content).digest()
