"""Serve JSON commands on a local socket: owner-only access, never blocked by a client.

A client sends objects with ``do`` (and ``token`` where the socket is TCP); what may be requested is
in `printctl.machine.process.vocabulary`. ``status`` and ``subscribe`` (``of``: print or printer)
are answered by ``{"event": "status", ...}``, what can't be done by
``{"event": "refused", "message": ..., "error": ...}``, a request with ``answer`` set that can, by
``heard``, unless it has an answer of its own once it is done.

One thread serves all clients and never waits for any: sockets are non-blocking, and a client that
doesn't read what it is sent is dropped. ``kill`` is handed to a thread that was started in
advance and does nothing else. Beyond `MAX_CLIENTS`, and where the system has no file handle left,
the client that matters least leaves for the new one, which may bring a kill.
"""

from __future__ import annotations

import contextlib
import errno
import json
import logging
import os
import secrets
import selectors
import socket
import tempfile
import threading
import time
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Protocol

from printctl.machine.errors import LinkError, Refused

log = logging.getLogger(__name__)

MAX_CLIENTS: Final = 200
_ANSWER_LIMIT_S: Final = 5.0
RETRY_S: Final = 0.25
"""So long a socket that can't accept waits before it tries again."""
_NO_HANDLE: Final = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)
_BACKLOG_LIMIT: Final = 1_000_000
_LINE_LIMIT: Final = 10_000
"""Of a client's first message."""
_LONG_LIMIT: Final = 1_000_000
"""Of the later ones: an insert of some ten thousand lines."""
_UNIX_PATH_LIMIT: Final = 100
_KNOCKING: Final = 1024
"""Connections that may wait to be accepted: beyond, a Unix socket refuses at once."""
_TEMPORARY: Final = "printctl-link-"


def listen(folder: Path, name: str = "link.sock") -> tuple[socket.socket, str, str]:
    """Open the socket: Unix in ``folder`` where there are such, else TCP on the loopback.

    Returned with its address (``unix:PATH`` or ``tcp:HOST:PORT``) and the token that clients must
    show; empty for a Unix socket, which only its owner may open.
    """
    if not hasattr(socket, "AF_UNIX"):
        listener = socket.create_server(("127.0.0.1", 0))
        address = f"tcp:127.0.0.1:{listener.getsockname()[1]}"
        return listener, address, secrets.token_hex(16)
    path = folder.resolve() / name
    if len(os.fsencode(path)) > _UNIX_PATH_LIMIT:
        path = Path(tempfile.mkdtemp(prefix=_TEMPORARY)) / name
    path.unlink(missing_ok=True)
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    listener.bind(str(path))
    path.chmod(0o600)
    listener.listen(_KNOCKING)
    return listener, f"unix:{path}", ""


def open_address(address: str) -> socket.socket | None:
    """Connect to an address given by `listen`; None when it is dead, or a Unix one elsewhere."""
    kind, _, rest = address.partition(":")
    if not kind:
        return None
    host, _, port = rest.rpartition(":")
    tcp = kind == "tcp"
    family = socket.AF_INET if tcp else getattr(socket, "AF_UNIX", None)
    if family is None:
        return None
    connection = socket.socket(family, socket.SOCK_STREAM)
    connection.settimeout(_ANSWER_LIMIT_S)
    try:
        connection.connect((host, int(port)) if tcp else rest)
    except OSError:
        connection.close()
        return None
    connection.settimeout(None)
    return connection


def forget(address: str) -> None:
    """Remove what `listen` left on the disk."""
    if address.startswith("unix:"):
        path = Path(address.removeprefix("unix:"))
        path.unlink(missing_ok=True)
        if path.parent.name.startswith(_TEMPORARY):
            path.parent.rmdir()


@dataclass(eq=False)
class Guest:
    """One client's connection.

    Attributes
    ----------
    known : bool
        Whether it has sent a request that is understood.
    subscribed : str
        ``print`` or ``printer``; empty for neither.
    of_print : bool
        Whether it speaks of the print that goes on, so that the connection ends with it.
    too_long : bool
        Whether the message that it is sending was refused for its length.
    leaving : bool
        Whether it is hung up on once it has been sent what is left.
    """

    socket: socket.socket
    heard: bytes = b""
    unsent: bytes = b""
    known: bool = False
    subscribed: str = ""
    of_print: bool = False
    too_long: bool = False
    leaving: bool = False


class RequestTaker(Protocol):
    """What a socket serves: a `Machine`."""

    def kill(self) -> None:
        """Halt the printer; called in a thread that does nothing else."""

    def take(self, guest: Guest, request: dict[str, Any]) -> bool:
        """Take a request; return whether it has an answer of its own. LinkError refuses it."""


class Reserve:
    """A file handle kept back, so that a socket without handles can let one client in."""

    def __init__(self) -> None:
        self._handle = -1
        self.refill()

    def refill(self) -> None:
        """Take a handle back, if one is free."""
        if self._handle < 0:
            with contextlib.suppress(OSError):
                self._handle = os.open(os.devnull, os.O_RDONLY)

    def close(self) -> bool:
        """Give the handle away; return whether there was one."""
        if self._handle < 0:
            return False
        os.close(self._handle)
        self._handle = -1
        return True


@dataclass
class Server:
    """Serves clients in a thread of its own, from `start` to `finish`."""

    listener: socket.socket
    token: str
    machine: RequestTaker
    reserve: Reserve = field(init=False, default_factory=Reserve)
    _guests: dict[object, Guest] = field(init=False, default_factory=dict)
    """By socket, the oldest first."""
    _deaf_until: float = field(init=False, default=0.0)
    _mail: deque[tuple[Guest | str, dict[str, Any] | None]] = field(
        init=False, default_factory=deque
    )
    _kill: threading.Event = field(init=False, default_factory=threading.Event)
    _over: threading.Event = field(init=False, default_factory=threading.Event)

    def __post_init__(self) -> None:
        self._selector = selectors.DefaultSelector()
        self._waker, self._woken = socket.socketpair()
        for end in (self.listener, self._waker, self._woken):
            end.setblocking(False)
        self._selector.register(self.listener, selectors.EVENT_READ)
        self._selector.register(self._woken, selectors.EVENT_READ)
        self._threads = [
            threading.Thread(target=self._serve, name="server", daemon=True),
            threading.Thread(target=self._kill_path, name="kill", daemon=True),
        ]

    def start(self) -> None:
        """Begin to serve."""
        for thread in self._threads:
            thread.start()

    # --- for any thread; none of these waits -----------------------------------------------------

    def kill(self) -> None:
        """Have the printer halted by the thread that does nothing else."""
        self._kill.set()

    def tell(self, of: str, status: dict[str, Any]) -> None:
        """Send a status to all who have subscribed to it."""
        self._send(of, {"event": "status", **status})

    def post(self, guest: Guest, message: dict[str, Any]) -> None:
        """Send a message to one client."""
        self._send(guest, message)

    def hang_up(self, guest: Guest | None = None) -> None:
        """End a connection, or those of the print that is over, once all was sent there."""
        self._send(guest or "print", None)

    def _send(self, whom: Guest | str, message: dict[str, Any] | None) -> None:
        self._mail.append((whom, message))
        self._wake()

    def finish(self, patience_s: float = 1.0) -> None:
        """Send what is left, at most for ``patience_s``, and close."""
        self._over.set()
        self._kill.set()
        self._wake()
        for thread in self._threads:
            thread.join(patience_s)
        if not self._threads[0].is_alive():
            self._selector.close()
            self._waker.close()
            self._woken.close()
            self.reserve.close()

    # --- threads ---------------------------------------------------------------------------------

    def _kill_path(self) -> None:
        while self._kill.wait() and not self._over.is_set():
            self._kill.clear()
            try:
                self.machine.kill()
            except Exception:  # this thread must be there for the next one
                log.exception("the kill met an error of its own")

    def _serve(self) -> None:
        while not self._over.is_set():
            for key, mask in self._selector.select(RETRY_S if self._deaf_until else None):
                if key.fileobj is self.listener:
                    self._welcome()
                elif key.fileobj is self._woken:
                    with contextlib.suppress(BlockingIOError):
                        self._woken.recv(4096)
                elif (guest := self._guests.get(key.fileobj)) is not None:
                    self._attend(guest, mask)  # else it has just left for another
            if self._deaf_until and time.monotonic() >= self._deaf_until:
                self._deaf_until = 0.0
                self._selector.register(self.listener, selectors.EVENT_READ)
            self._deliver()
        self._deliver()
        for guest in list(self._guests.values()):
            guest.socket.settimeout(0.5)
            with contextlib.suppress(OSError):
                guest.socket.sendall(guest.unsent)
            self._dismiss(guest)
        self.listener.close()

    def _wake(self) -> None:
        with contextlib.suppress(OSError):  # full: it is awake anyway; closed: it is over
            self._waker.send(b"!")

    # --- clients ---------------------------------------------------------------------------------

    def _welcome(self) -> None:
        try:
            connection, _ = self.listener.accept()
        except OSError as exc:
            if exc.errno in _NO_HANDLE:
                self._make_room()
            return
        connection.setblocking(False)
        if len(self._guests) >= MAX_CLIENTS:
            self._one_leaves()
        self._guests[connection] = Guest(connection)
        self._selector.register(connection, selectors.EVENT_READ)
        self.reserve.refill()

    def _make_room(self) -> None:
        """Free a handle for who knocks; where that can't be, don't listen for a moment."""
        if not (self._one_leaves() or self.reserve.close()):
            self._selector.unregister(self.listener)
            self._deaf_until = time.monotonic() + RETRY_S

    def _one_leaves(self) -> bool:
        """Dismiss who has sent no request yet, else who isn't subscribed; of these the oldest."""
        leaver = min(
            self._guests.values(), key=lambda one: (one.known, bool(one.subscribed)), default=None
        )
        if leaver is not None:
            self._dismiss(leaver)
        return leaver is not None

    def _dismiss(self, guest: Guest) -> None:
        with contextlib.suppress(KeyError, ValueError):
            self._selector.unregister(guest.socket)
        self._guests.pop(guest.socket, None)
        guest.socket.close()

    def _attend(self, guest: Guest, mask: int) -> None:
        if mask & selectors.EVENT_WRITE:
            self._flush(guest)
        if not mask & selectors.EVENT_READ or guest.socket not in self._guests:
            return
        try:
            data = guest.socket.recv(4096)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self._dismiss(guest)
            return
        *lines, guest.heard = (guest.heard + data).split(b"\n")
        for line in lines:
            if guest.too_long:  # this is its end, and it was answered
                guest.too_long = False
            else:
                self._answer(guest, line)
        self._cut(guest)

    def _cut(self, guest: Guest) -> None:
        """Refuse a message that goes beyond the limit, once; the rest of it isn't kept."""
        limit = _LONG_LIMIT if guest.known else _LINE_LIMIT
        if not guest.too_long and len(guest.heard) > limit:
            guest.too_long = True
            first = "" if guest.known else " as the first (`status` may come before a long one)"
            why = f"a message may have {limit:,} bytes{first}; this one has more, nothing was done"
            self.post(guest, refusal(Refused(why)))
        if guest.too_long:
            guest.heard = b""

    def _answer(self, guest: Guest, line: bytes) -> None:
        try:
            request = json.loads(line)
            if not secrets.compare_digest(str(request.get("token", "")), self.token):
                self.post(guest, {"event": "refused", "message": "wrong token"})
                return
            answered = self.machine.take(guest, request)
            if request.get("answer") and not answered:
                self.post(guest, {"event": "heard", "do": request["do"]})
        except LinkError as exc:
            self.post(guest, refusal(exc))
        except Exception:  # this thread must be there for a kill
            log.info("a request that can't be read", exc_info=True)
            self.post(guest, {"event": "refused", "message": f"can't read {line[:80]!r}"})

    def _deliver(self) -> None:
        while self._mail:
            whom, message = self._mail.popleft()
            data = b"" if message is None else json.dumps(message).encode() + b"\n"
            for guest in self._addressed(whom, hang_up=message is None):
                guest.leaving |= message is None
                guest.unsent += data
                self._flush(guest)

    def _addressed(self, whom: Guest | str, hang_up: bool) -> list[Guest]:
        """Return those whom a message is for; one alone is looked up, as there may be hundreds."""
        if isinstance(whom, Guest):
            return [whom] if whom.socket in self._guests else []
        guests = self._guests.values()
        return [one for one in guests if (one.of_print if hang_up else one.subscribed == whom)]

    def _flush(self, guest: Guest) -> None:
        try:
            guest.unsent = guest.unsent[guest.socket.send(guest.unsent) :]
        except BlockingIOError:
            pass
        except OSError:  # it has left; what it wrote before that is still to be read: a stop, say
            guest.unsent, guest.subscribed = b"", ""
        if len(guest.unsent) > _BACKLOG_LIMIT or (guest.leaving and not guest.unsent):
            self._dismiss(guest)
            return
        write = selectors.EVENT_WRITE if guest.unsent else 0
        self._selector.modify(guest.socket, selectors.EVENT_READ | write)


def refusal(exc: LinkError) -> dict[str, Any]:
    """Return the answer to a request that wasn't granted."""
    return {"event": "refused", "message": str(exc), "error": type(exc).__name__}
