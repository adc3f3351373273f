"""Start a print's observer and wait until it is ready, before anything moves.

Knows nothing of pictures, so that whatever starts or resumes a print may ask for it.
"""

from __future__ import annotations

import contextlib
import signal
import time
from pathlib import Path
from typing import Final

from printctl.errors import PrintctlError
from printctl.machine.errors import LinkError
from printctl.machine.job.care import Care
from printctl.machine.process.clients.launch import spawn
from printctl.machine.process.contact import alive, stays_alive
from printctl.machine.records.record import RECORD, load_record
from printctl.observe.records import LOG_FILE, OBSERVER_LOCK, ORDER_FILE, READY_FILE
from printctl.processes.alive import KILL, is_alive, send_signal
from printctl.sources import python_command

_READY_LIMIT_S: Final = 300.0
"""Loading takes some seconds; a camera's first picture has a limit of its own."""
_END_LIMIT_S: Final = 10.0
"""Time for an observer to end, which may be judging a picture."""
_DEFAULT_REMEDY: Final = "print without the recipe's section observe"


class ObserverError(PrintctlError):
    """Failure to observe a print as its recipe requests."""


def start_observer(folder: Path, remedy: str = _DEFAULT_REMEDY) -> None:
    """Start the observer of the print that is about to begin or go on in ``folder``.

    Returns once it has loaded all that it needs and has tried its device; it then waits for the
    print. The folder has its order (`ORDER_FILE`).

    Parameters
    ----------
    folder : Path
    remedy : str
        What the user may do where that fails, beside seeing to it.

    Raises
    ------
    ObserverError
        When it can't observe; nothing has moved then.
    """
    if stays_alive(folder, OBSERVER_LOCK):
        if not _has_lost_link(folder):
            raise ObserverError(f"an observer is at work in {folder} already; end its print first")
        _end_and_wait(folder)
    ready = folder / READY_FILE
    ready.unlink(missing_ok=True)
    try:
        pid = spawn([*python_command("printctl.observe"), str(folder.resolve()), "--detach"])
    except LinkError as exc:
        raise ObserverError(_refusal(str(exc), remedy)) from exc
    limit = time.monotonic() + _READY_LIMIT_S
    while time.monotonic() < limit:
        over = not is_alive(pid)
        if _ready_pid(folder) == pid:
            return
        if over:
            raise ObserverError(_refusal(_last_line(folder / LOG_FILE), remedy))
        time.sleep(0.05)
    _end(pid)
    raise ObserverError(_refusal(f"it wasn't ready after {_READY_LIMIT_S:g} s", remedy))


def ensure_observer(folder: Path) -> bool:
    """Start an observer for a print in ``folder`` that is to go on, if it is one with looks.

    Nothing happens where an observer is at work.

    Returns
    -------
    bool
        Whether one was started.

    Raises
    ------
    ObserverError
        When none can be started.
    """
    if not has_looks(folder) or not (folder / ORDER_FILE).is_file():
        return False
    if stays_alive(folder, OBSERVER_LOCK) and not _has_lost_link(folder):
        return False
    start_observer(folder, f"go on without by `printctl resume {folder} --unobserved`")
    return True


def has_looks(folder: Path) -> bool:
    """Return whether the print in ``folder`` is held for looks; False without a print."""
    try:
        return Care.from_dict(load_record(folder).care).looks
    except LinkError:
        return False


def end_idle_observer(folder: Path) -> None:
    """End an observer whose print hasn't begun; one with a print ends with it."""
    pid = _ready_pid(folder)
    if pid and not alive(folder) and alive(folder, OBSERVER_LOCK):
        _end(pid)


def _has_lost_link(folder: Path) -> bool:
    """Return whether an observer's link has begun and is gone, and it waits for its device.

    It would end behind that, perhaps once the print goes on.
    """
    try:
        begun = (folder / RECORD).stat().st_mtime_ns > (folder / READY_FILE).stat().st_mtime_ns
    except OSError:
        return False
    return begun and not alive(folder)


def _end_and_wait(folder: Path) -> None:
    """End the observer in a folder, by force if it doesn't end in time."""
    pid, limit = _ready_pid(folder), time.monotonic() + _END_LIMIT_S
    _end(pid)
    while alive(folder, OBSERVER_LOCK):
        if time.monotonic() > limit:
            _end(pid, KILL)
            return
        time.sleep(0.05)


def _end(pid: int, how: int = signal.SIGTERM) -> None:
    if pid:
        with contextlib.suppress(OSError):
            send_signal(pid, how)


def _ready_pid(folder: Path) -> int:
    try:
        return int((folder / READY_FILE).read_text(encoding="ascii"))
    except (OSError, ValueError):
        return 0


def _last_line(log: Path) -> str:
    try:
        lines = log.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    return next((line for line in reversed(lines) if line.strip()), "it ended without a word")


def _refusal(why: str, remedy: str) -> str:
    end = "" if why.endswith("?") else "."
    return f"no observer can be started: {why}{end} Nothing was moved; see to it, or {remedy}"
