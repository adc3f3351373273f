"""Processes that outlive their parent: start one and wait for it, or become one."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, TypeVar

import printctl
from printctl.machine.errors import LinkError, NoLink
from printctl.processes.alive import is_alive
from printctl.sources import python_command

START_LIMIT_S: Final = 60.0
_FULL_BYTES: Final = 4096
"""A disk with less free, a block, takes no line of a log."""
Found = TypeVar("Found")


def spawn(command: list[str]) -> int:
    """Start a process that detaches itself; return its number, LinkError when it doesn't start."""
    root = str(Path(printctl.__file__).resolve().parents[1])
    paths = [root, *filter(None, [os.environ.get("PYTHONPATH")])]
    try:
        started = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
            timeout=START_LIMIT_S,
            check=False,
            start_new_session=True,  # a Ctrl-C in the terminal is for whoever starts it
        )
    except subprocess.TimeoutExpired as exc:
        raise LinkError(
            f"the process didn't start within {START_LIMIT_S:g} s: this computer is overloaded; "
            "end other programs, then try again"
        ) from exc
    if started.returncode != 0:
        said = started.stderr.decode(errors="replace").strip()[-500:]
        raise LinkError(f"the process didn't start: {said}")
    return int(started.stdout)


@contextmanager
def interrupt_held() -> Iterator[None]:
    """Hold Ctrl-C back until the block has ended, so that what it starts isn't lost sight of."""
    handler = signal.getsignal(signal.SIGINT)
    main = threading.current_thread() is threading.main_thread()
    if not main or handler in (None, signal.SIG_IGN):
        yield
        return
    pressed = []
    signal.signal(signal.SIGINT, lambda *_: pressed.append(True))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)
    if pressed:
        signal.raise_signal(signal.SIGINT)


def await_process(
    pid: int, name: str, look: Callable[[], Found | None], log: Path, limit_s: float
) -> Found:
    """Return what ``look`` finds of a process that was spawned.

    LinkError with its last words where it has ended; NoLink when nothing is found in time.
    """
    limit = time.monotonic() + limit_s
    while time.monotonic() < limit:
        over = not is_alive(pid)
        found = look()
        if found is not None:
            return found
        if over:
            raise LinkError(f"the {name} ended at once: {_last_words(log)}")
        time.sleep(0.02)
    raise NoLink(f"the {name} didn't come up within {limit_s:g} s; see {log}")


def _last_words(log: Path) -> str:
    """Return what a process said last, in its log; on a full disk it could say nothing."""
    if shutil.disk_usage(log.parent).free < _FULL_BYTES:
        return f"the disk of {log.parent} is full; free space on it, then try again"
    lines = log.read_text(encoding="utf-8", errors="replace").splitlines()
    return lines[-1] if lines else "no word"


def detach(log: Path, module: str) -> None:
    """Go on as a process of its own session, which nobody waits for; print its number.

    On Windows there is no fork; a copy of this command is started instead.
    """
    if not hasattr(os, "fork"):
        command = [*python_command(module), *sys.argv[1:]]
        command.remove("--detach")
        with log.open("ab") as handle:
            flags = 0x00000008 | 0x00000200  # DETACHED_PROCESS, CREATE_NEW_PROCESS_GROUP
            environment = dict(os.environ)
            base = getattr(sys, "_base_executable", sys.executable)
            if base != sys.executable:  # the number of a virtual environment's launcher is no use
                command[0], environment["__PYVENV_LAUNCHER__"] = base, sys.executable
            copy = subprocess.Popen(
                command, stdout=handle, stderr=handle, creationflags=flags, env=environment
            )
        print(copy.pid, flush=True)
        os._exit(0)
    pid = os.fork()
    if pid:
        print(pid, flush=True)
        os._exit(0)
    os.setsid()
    null, out = os.open(os.devnull, os.O_RDWR), os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    for source, target in ((null, 0), (out, 1), (out, 2)):
        os.dup2(source, target)
