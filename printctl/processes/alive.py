"""Signals to processes, on POSIX and on Windows."""

from __future__ import annotations

import os
import signal
import sys
from typing import Final

KILL: Final[int] = getattr(signal, "SIGKILL", signal.SIGTERM)
"""Ends a process that no longer listens; on Windows SIGTERM does."""
_SYNCHRONIZE: Final = 0x00100000
_ACCESS_DENIED: Final = 5
_WAIT_TIMEOUT: Final = 0x102


def has_groups() -> bool:
    """Return whether a process and all that it started can be signalled together."""
    return hasattr(os, "killpg")


def send_signal(pid: int, sign: int, group: bool = False) -> None:
    """Send a signal to a process or, with ``group``, to all processes of its group, too.

    Windows knows the process alone, and ends it whatever the signal.

    Raises
    ------
    OSError
        `ProcessLookupError` when it has ended; `PermissionError` for another user's.
    """
    if sys.platform == "win32":
        os.kill(pid, signal.SIGTERM)  # any other number may be taken for a Ctrl-C
    elif group:
        os.killpg(pid, sign)
    else:
        os.kill(pid, sign)


def is_alive(pid: int) -> bool:
    """Return whether a process exists; on Linux, one that waits for its parent doesn't."""
    if sys.platform == "win32":
        return _is_alive_on_windows(pid)
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    try:
        with open(f"/proc/{pid}/stat", encoding="utf-8", errors="replace") as status:
            return not status.read().rpartition(")")[2].startswith(" Z")
    except OSError:
        return True


def _is_alive_on_windows(pid: int) -> bool:
    """Ask for a handle; ``os.kill(pid, 0)`` would send a Ctrl-C there."""
    import ctypes

    kernel = ctypes.WinDLL("kernel32", use_last_error=True)  # type: ignore[attr-defined]
    handle = kernel.OpenProcess(_SYNCHRONIZE, False, pid)
    if not handle:
        return bool(ctypes.get_last_error() == _ACCESS_DENIED)  # type: ignore[attr-defined]
    try:
        return bool(kernel.WaitForSingleObject(handle, 0) == _WAIT_TIMEOUT)
    finally:
        kernel.CloseHandle(handle)


def ignore_signals() -> None:
    """Leave Ctrl-C and hang-ups to the client."""
    for name in ("SIGINT", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
