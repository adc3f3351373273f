"""Write files atomically: a failure leaves the old file in place."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def atomic_replacement(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside ``path``; on success it takes ``path``'s place.

    The temporary file keeps the suffix, because several writers choose their format by it. It
    is flushed to the disk before the rename. On any error it is removed and ``path`` stays as
    it was.

    Raises
    ------
    OSError
        When the disk is full or the folder can't be written; it names ``path``.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        yield draft
        with draft.open("rb+") as handle:
            os.fsync(handle.fileno())
        draft.replace(path)
    except OSError as exc:
        if exc.filename in (None, str(draft), draft):  # a full disk says no name by itself
            exc.filename = str(path)
        raise
    finally:
        draft.unlink(missing_ok=True)


def write_bytes(path: Path, data: bytes) -> None:
    """Write ``data`` to ``path`` by way of a temporary file."""
    with atomic_replacement(path) as draft:
        draft.write_bytes(data)


def write_text(path: Path, text: str) -> None:
    r"""Write UTF-8 ``text`` with ``\n`` line ends to ``path`` by way of a temporary file."""
    write_bytes(path, text.encode())
