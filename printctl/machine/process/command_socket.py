"""Serve JSON commands on a local socket: owner-only access, never blocked by a client.

A client sends objects with ``do`` (and ``token`` where the socket is TCP). ``status`` and
``subscribe`` are answered by ``{"event": "status", ...}``, what can't be done by
``{"event": "refused", "message": ..., "error": ...}``, a request with ``answer`` set that can, by
``heard``. ``kill`` and ``detach`` every command socket knows; further requests are a kind's own.

One thread serves all clients and never waits for any: sockets are non-blocking, and a client that
doesn't read what it is sent is dropped. ``kill`` is handed to a thread that was started in
advance and does nothing else. Beyond `MOST_GUESTS` clients, and where the system has no file handle
left, the client that matters least leaves for the new one (`door_places`), which may bring a kill.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import secrets
import selectors
import socket
import tempfile
import threading
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from printctl.machine.errors import LinkError, Refused
from printctl.machine.process.socket_clients import (
    MOST_GUESTS,
    NO_HANDLE,
    RETRY_S,
    ClientPlace,
    ClientPlaces,
    Reserve,
)

log = logging.getLogger(__name__)

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

    Returns
    -------
    listener : socket
    address : str
        ``unix:PATH`` or ``tcp:HOST:PORT``.
    token : str
        What clients must show; empty for a Unix socket, which only its owner may open.
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


def forget(address: str) -> None:
    """Remove what `listen` left on the disk."""
    if address.startswith("unix:"):
        path = Path(address.removeprefix("unix:"))
        path.unlink(missing_ok=True)
        if path.parent.name.startswith(_TEMPORARY):
            path.parent.rmdir()


@dataclass
class SocketServer(ABC):
    """Serves clients in a thread of its own, from `start` to `finish`.

    A subclass says what may be requested (`requests`), what a client is told (`told`) and what
    `kill` is.

    Attributes
    ----------
    listener : socket
    token : str
    reserve : Reserve
        The handle for a client where no other is left.
    """

    listener: socket.socket
    token: str
    reserve: Reserve = field(init=False, default_factory=Reserve)
    _guests: ClientPlaces = field(init=False, default_factory=ClientPlaces)
    _deaf_until: float = field(init=False, default=0.0)
    _mail: deque[tuple[ClientPlace | None, dict[str, Any]]] = field(
        init=False, default_factory=deque
    )
    _kill: threading.Event = field(init=False, default_factory=threading.Event)
    _over: threading.Event = field(init=False, default_factory=threading.Event)

    def __post_init__(self) -> None:
        self._granted = {
            "status": self._status,
            "subscribe": self._subscribe,
            "kill": self._do_kill,
            "detach": self._do_detach,
            **self.requests(),
        }
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

    # --- a kind's own ------------------------------------------------------------------------

    @abstractmethod
    def kill(self) -> None:
        """Halt the printer; called in a thread that does nothing else."""

    @abstractmethod
    def told(self) -> dict[str, Any]:
        """Status as a JSON object."""

    @abstractmethod
    def requests(self) -> Mapping[str, Callable[[ClientPlace, dict[str, Any]], None]]:
        """What grants each request; raises `LinkError` for one that can't be granted."""

    # --- for any thread ------------------------------------------------------------------------

    def tell_all(self, status: dict[str, Any]) -> None:
        """Tell all subscribers, never waiting."""
        self.post(None, {"event": "status", **status})

    def post(self, guest: ClientPlace | None, message: dict[str, Any]) -> None:
        """Send to one client, or to all subscribers, never waiting."""
        self._mail.append((guest, message))
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

    # --- threads ---------------------------------------------------------------------------

    def _kill_path(self) -> None:
        while self._kill.wait() and not self._over.is_set():
            self._kill.clear()
            try:
                self.kill()
            except Exception:  # this thread must be there for the next one
                log.exception("the kill met an error of its own")

    def _serve(self) -> None:
        while not self._over.is_set():
            for key, mask in self._selector.select(RETRY_S if self._deaf_until else None):
                if key.fileobj is self.listener:
                    self._welcome()
                elif key.fileobj is self._woken:
                    self._drain_waker()
                else:
                    guest = self._guests.of(key.fileobj)
                    if guest is not None:  # else it has just left for another
                        self._attend(guest, mask)
            self._listen_again()
            self._deliver()
        self._deliver()
        for guest in self._guests.all():
            guest.socket.settimeout(0.5)
            with contextlib.suppress(OSError):
                guest.socket.sendall(guest.unsent)
            self._dismiss(guest)
        self.listener.close()

    def _wake(self) -> None:
        with contextlib.suppress(OSError):  # full: it is awake anyway; closed: it is over
            self._waker.send(b"!")

    def _drain_waker(self) -> None:
        with contextlib.suppress(BlockingIOError):
            self._woken.recv(4096)

    # --- clients ---------------------------------------------------------------------------

    def _welcome(self) -> None:
        try:
            connection, _ = self.listener.accept()
        except OSError as exc:
            if exc.errno in NO_HANDLE:
                self._make_room()
            return
        connection.setblocking(False)
        if len(self._guests) >= MOST_GUESTS:
            self._one_leaves()
        guest = ClientPlace(connection)
        self._guests.add(guest)
        self._selector.register(connection, selectors.EVENT_READ)
        self.reserve.refill()

    def _make_room(self) -> None:
        """Free a handle for who knocks; where that can't be, don't listen for a moment."""
        if not (self._one_leaves() or self.reserve.close()):
            self._selector.unregister(self.listener)
            self._deaf_until = time.monotonic() + RETRY_S

    def _listen_again(self) -> None:
        if self._deaf_until and time.monotonic() >= self._deaf_until:
            self._deaf_until = 0.0
            self._selector.register(self.listener, selectors.EVENT_READ)

    def _one_leaves(self) -> bool:
        leaver = self._guests.leaver()
        if leaver is not None:
            self._dismiss(leaver)
        return leaver is not None

    def _dismiss(self, guest: ClientPlace) -> None:
        with contextlib.suppress(KeyError, ValueError):
            self._selector.unregister(guest.socket)
        self._guests.remove(guest)
        guest.socket.close()

    def _attend(self, guest: ClientPlace, mask: int) -> None:
        if mask & selectors.EVENT_WRITE:
            self._flush(guest)
        if not mask & selectors.EVENT_READ:
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

    def _cut(self, guest: ClientPlace) -> None:
        """Refuse a message that goes beyond the limit, once; the rest of it isn't kept."""
        limit = _LONG_LIMIT if guest.known else _LINE_LIMIT
        if not guest.too_long and len(guest.heard) > limit:
            guest.too_long = True
            first = "" if guest.known else " as the first (`status` may come before a long one)"
            why = f"a message may have {limit:,} bytes{first}; this one has more, nothing was done"
            self.post(guest, {"event": "refused", "message": why, "error": Refused.__name__})
        if guest.too_long:
            guest.heard = b""

    def _answer(self, guest: ClientPlace, line: bytes) -> None:
        try:
            request = json.loads(line)
            if not secrets.compare_digest(str(request.get("token", "")), self.token):
                self.post(guest, {"event": "refused", "message": "wrong token"})
                return
            grant = self._granted[request["do"]]
            guest.known = True
            grant(guest, request)
            if request.get("answer"):
                self.post(guest, {"event": "heard", "do": request["do"]})
        except LinkError as exc:
            error = type(exc).__name__
            self.post(guest, {"event": "refused", "message": str(exc), "error": error})
        except (ValueError, KeyError, AttributeError, TypeError, RecursionError):
            self.post(guest, {"event": "refused", "message": f"can't read {line[:80]!r}"})

    def _subscribe(self, guest: ClientPlace, request: dict[str, Any]) -> None:
        guest.subscribed = True
        self.post(guest, {"event": "status", **self.told()})

    def _status(self, guest: ClientPlace, request: dict[str, Any]) -> None:
        self.post(guest, {"event": "status", "asked": True, **self.told()})

    def _do_kill(self, guest: ClientPlace, request: dict[str, Any]) -> None:
        self._kill.set()

    def _do_detach(self, guest: ClientPlace, request: dict[str, Any]) -> None:
        guest.subscribed = False

    def _deliver(self) -> None:
        while self._mail:
            guest, message = self._mail.popleft()
            data = json.dumps(message).encode() + b"\n"
            for one in [guest] if guest else self._guests.subscribers():
                if one in self._guests:
                    one.unsent += data
                    self._flush(one)

    def _flush(self, guest: ClientPlace) -> None:
        try:
            guest.unsent = guest.unsent[guest.socket.send(guest.unsent) :]
        except BlockingIOError:
            pass
        except OSError:  # it has left; what it wrote before that is still to be read: a stop, say
            guest.unsent, guest.subscribed = b"", False
        if len(guest.unsent) > _BACKLOG_LIMIT:
            self._dismiss(guest)
            return
        write = selectors.EVENT_WRITE if guest.unsent else 0
        self._selector.modify(guest.socket, selectors.EVENT_READ | write)
