"""Locks between processes, on files and printer network addresses, freed if their holder dies."""

from __future__ import annotations

import contextlib
import os
import socket
import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import IO

from printctl.machine.errors import PortInUse, PortMissing


def lock(handle: IO[bytes], shared: bool = False) -> None:
    """Lock a file until it is closed; raises `OSError` where another process holds it.

    ``shared`` lets others have a shared lock meanwhile, as several do who only look whether anybody
    holds it. Windows has none through this door: there two who look can meet.
    """
    if os.name == "nt":
        import msvcrt  # only there

        msvcrt.locking(handle.fileno(), msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
    else:
        import fcntl  # only there

        kind = fcntl.LOCK_SH if shared else fcntl.LOCK_EX
        fcntl.flock(handle, kind | fcntl.LOCK_NB)


def hold_address(host: str, port: int, name: str) -> ExitStack:
    """Hold a printer's network address until the stack is closed; users know it by ``name``.

    Taken before anything is sent there: many bridges serve one client, and drop the first when a
    second one calls. Another machine isn't kept out; only the bridge itself could do that. Raises
    `PortMissing` where the host's name can't be resolved, `PortInUse` where any process of this
    machine holds it, under whatever name.
    """
    try:
        addresses = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    except OSError as exc:
        raise PortMissing(f"host {host} not found ({exc}); check the host of {name}") from exc
    with ExitStack() as held:
        for address in sorted({str(entry[4][0]) for entry in addresses}):
            plain = "".join(letter if letter.isalnum() else "-" for letter in address)
            path = Path(tempfile.gettempdir()) / f"printctl-tcp-{plain}-{port}.lock"
            handle = held.enter_context(_open(path))
            try:
                lock(handle)
            except OSError as exc:
                raise PortInUse(
                    f"{name} is held by another printctl on this machine; attach to its print, or "
                    "wait until it has ended"
                ) from exc
        return held.pop_all()


def _open(path: Path) -> IO[bytes]:
    """Open a file that every user of the machine can lock; nothing is ever written into it."""
    flags = os.O_CLOEXEC | os.O_NOFOLLOW if os.name != "nt" else 0
    try:
        descriptor = os.open(path, os.O_RDONLY | flags)
    except FileNotFoundError:
        descriptor = os.open(path, os.O_RDONLY | os.O_CREAT | flags, 0o644)
    handle = os.fdopen(descriptor, "rb")
    with contextlib.suppress(OSError):
        path.chmod(0o644)
    return handle
