"""Explain operating system errors (disk, permissions, files, memory), each with a remedy."""

from __future__ import annotations

import errno
from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class SystemTrouble:
    """Operating system error with its explanation.

    Attributes
    ----------
    kind : str
        Name for programs, such as ``DiskFullError``.
    status : int
        HTTP status: 507 for a full disk or a file beyond the limit, else 503.
    message : str
    """

    kind: str
    status: int
    message: str


_FULL: Final = frozenset({errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC)})
_RIGHTS: Final = frozenset({errno.EACCES, errno.EPERM, errno.EROFS})
_FILES: Final = frozenset({errno.EMFILE, errno.ENFILE})


def explain(exc: OSError | MemoryError) -> SystemTrouble:
    """Tell what the system refused, where, and what to do."""
    if isinstance(exc, MemoryError):
        return SystemTrouble(
            "OutOfMemoryError", 503, "the memory doesn't suffice for this; close other programs, "
            "or take a smaller file",
        )  # fmt: skip
    place = f" ({exc.filename})" if exc.filename else ""
    reason = exc.strerror or str(exc) or type(exc).__name__
    if exc.errno in _FULL:
        return SystemTrouble(
            "DiskFullError",
            507,
            f"the disk is full{place}; free some space and do the same again: files that were "
            "there before are untouched",
        )
    if exc.errno == errno.EFBIG:
        return SystemTrouble(
            "FileTooLargeError",
            507,
            f"the file grew too large for this disk or user{place}; write to another disk, or "
            "raise the limit (ulimit -f): files that were there before are untouched",
        )
    if exc.errno in _RIGHTS:
        return SystemTrouble(
            "NoRightsError",
            503,
            f"{reason.lower()}{place}; let the user who runs printctl read and write there, or "
            "choose another folder",
        )
    if exc.errno in _FILES:
        return SystemTrouble(
            "TooManyFilesError",
            503,
            "too many files and connections are open at once; close other pages and programs, "
            "wait a minute and do the same again (ulimit -n is the limit)",
        )
    return SystemTrouble(
        "SystemTroubleError",
        503,
        f"{reason}{place}; see to the disk or folder and do the same again",
    )


def is_known(exc: BaseException) -> bool:
    """Whether it is the system that refused, and not a file that is broken."""
    return isinstance(exc, MemoryError) or (
        isinstance(exc, OSError) and exc.errno in _FULL | _RIGHTS | _FILES | {errno.EFBIG}
    )
