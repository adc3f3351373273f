"""The door by which clients speak to the link process: JSON lines over a local socket.

A client sends objects with ``do`` (and ``token`` where the socket is TCP): ``status``,
``subscribe``, ``stop``, ``kill``, ``pause`` (with ``after``: layer, vessel or nothing), ``reload``
(with ``head``, of several),
``resume`` (with ``change``, the fields of `NewSyringe`, or ``unchanged``), ``alive``, ``detach``,
``command`` (with ``text``). The server sends ``{"event": "status", ...}`` and, to a command,
``{"event": "reply", "command": ..., "lines": [...]}``. What can't be done is answered by
``{"event": "refused", "message": ...}``; a wish with ``answer`` set that can, by ``heard``.

One thread serves all clients and never waits for any: sockets are non-blocking, and a client that
doesn't read what it is sent is dropped. ``kill`` is handed to a thread that was started in
advance and does nothing else.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import secrets
import selectors
import socket
import tempfile
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from printctl.link.care import NewSyringe
from printctl.link.errors import LinkError
from printctl.link.heads import head_chosen
from printctl.link.marks import MarkKind
from printctl.link.pausing import Pausing
from printctl.link.states import Status

_BACKLOG_LIMIT: Final = 1_000_000
_LINE_LIMIT: Final = 10_000
_UNIX_PATH_LIMIT: Final = 100
_TEMPORARY: Final = "printctl-link-"
_CODE: Final = re.compile(r"([A-Z])0*(\d+)")
_REFUSED: Final = frozenset({"M110", "M112", "M83", "G91", "G92", "G20", "M18", "M84", "M410"})
"""Besides another count or frame: what takes the motors' power or throws moves away."""


def listen(folder: Path) -> tuple[socket.socket, str, str]:
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
    path = folder.resolve() / "link.sock"
    if len(os.fsencode(path)) > _UNIX_PATH_LIMIT:
        path = Path(tempfile.mkdtemp(prefix=_TEMPORARY)) / "link.sock"
    path.unlink(missing_ok=True)
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    listener.bind(str(path))
    path.chmod(0o600)
    listener.listen()
    return listener, f"unix:{path}", ""


def forget(address: str) -> None:
    """Remove what `listen` left on the disk."""
    if address.startswith("unix:"):
        path = Path(address.removeprefix("unix:"))
        path.unlink(missing_ok=True)
        if path.parent.name.startswith(_TEMPORARY):
            path.parent.rmdir()


@dataclass
class _Guest:
    """One client's connection."""

    socket: socket.socket
    heard: bytes = b""
    unsent: bytes = b""
    subscribed: bool = False


@dataclass
class Server:
    """Serves clients in a thread of its own, from `start` to `finish`.

    Attributes
    ----------
    listener : socket
    token : str
    channel : Pausing
    """

    listener: socket.socket
    token: str
    channel: Pausing
    _guests: dict[socket.socket, _Guest] = field(default_factory=dict)
    _mail: deque[tuple[_Guest | None, dict[str, Any]]] = field(default_factory=deque)
    _kill: threading.Event = field(default_factory=threading.Event)
    _over: threading.Event = field(default_factory=threading.Event)

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

    def publish(self, status: Status) -> None:
        """Tell all subscribers; from any thread, never waiting."""
        self._post(None, {"event": "status", **status.to_dict()})

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

    # --- threads ---------------------------------------------------------------------------

    def _kill_path(self) -> None:
        self._kill.wait()
        if not self._over.is_set():
            self.channel.kill()

    def _serve(self) -> None:
        while not self._over.is_set():
            for key, mask in self._selector.select():
                if key.fileobj is self.listener:
                    self._welcome()
                elif key.fileobj is self._woken:
                    self._drain_waker()
                else:
                    self._attend(self._guests[key.fileobj], mask)  # type: ignore[index]
            self._deliver()
        self._deliver()
        for guest in list(self._guests.values()):
            guest.socket.settimeout(0.5)
            with contextlib.suppress(OSError):
                guest.socket.sendall(guest.unsent)
            self._dismiss(guest)
        self.listener.close()

    def _post(self, guest: _Guest | None, message: dict[str, Any]) -> None:
        self._mail.append((guest, message))
        self._wake()

    def _wake(self) -> None:
        with contextlib.suppress(OSError):  # full: it is awake anyway; closed: it is over
            self._waker.send(b"!")

    def _drain_waker(self) -> None:
        with contextlib.suppress(BlockingIOError):
            self._woken.recv(4096)

    # --- clients ---------------------------------------------------------------------------

    def _welcome(self) -> None:
        with contextlib.suppress(OSError):
            connection, _ = self.listener.accept()
            connection.setblocking(False)
            self._guests[connection] = _Guest(connection)
            self._selector.register(connection, selectors.EVENT_READ)

    def _dismiss(self, guest: _Guest) -> None:
        with contextlib.suppress(KeyError, ValueError):
            self._selector.unregister(guest.socket)
        self._guests.pop(guest.socket, None)
        guest.socket.close()

    def _attend(self, guest: _Guest, mask: int) -> None:
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
        if not data or len(guest.heard) > _LINE_LIMIT:
            self._dismiss(guest)
            return
        *lines, guest.heard = (guest.heard + data).split(b"\n")
        for line in lines:
            self._answer(guest, line)

    def _answer(self, guest: _Guest, line: bytes) -> None:
        try:
            wish = json.loads(line)
            if not secrets.compare_digest(str(wish.get("token", "")), self.token):
                self._post(guest, {"event": "refused", "message": "wrong token"})
                return
            _WISHES[wish["do"]](self, guest, wish)
            if wish.get("answer"):
                self._post(guest, {"event": "heard", "do": wish["do"]})
        except LinkError as exc:
            self._post(guest, {"event": "refused", "message": str(exc)})
        except (ValueError, KeyError, AttributeError, TypeError, RecursionError):
            self._post(guest, {"event": "refused", "message": f"can't read {line[:80]!r}"})

    def _subscribe(self, guest: _Guest, wish: dict[str, Any]) -> None:
        guest.subscribed = True
        self._post(guest, {"event": "status", **self.channel.status.to_dict()})

    def _status(self, guest: _Guest, wish: dict[str, Any]) -> None:
        self._post(guest, {"event": "status", "asked": True, **self.channel.status.to_dict()})

    def _do_kill(self, guest: _Guest, wish: dict[str, Any]) -> None:
        self._kill.set()

    def _do_stop(self, guest: _Guest, wish: dict[str, Any]) -> None:
        self.channel.stop()

    def _do_pause(self, guest: _Guest, wish: dict[str, Any]) -> None:
        after = wish.get("after")
        self.channel.pause(MarkKind(after) if after else None)
        self.publish(self.channel.status)

    def _do_reload(self, guest: _Guest, wish: dict[str, Any]) -> None:
        head = wish.get("head")
        self.channel.reload(*(() if head is None else (int(head),)))
        self.publish(self.channel.status)

    def _do_resume(self, guest: _Guest, wish: dict[str, Any]) -> None:
        change = wish.get("change")
        self.channel.resume(NewSyringe(**change) if change else None, bool(wish.get("unchanged")))

    def _do_alive(self, guest: _Guest, wish: dict[str, Any]) -> None:
        self.channel.alive()

    def _do_detach(self, guest: _Guest, wish: dict[str, Any]) -> None:
        guest.subscribed = False

    def _do_command(self, guest: _Guest, wish: dict[str, Any]) -> None:
        text = str(wish["text"]).strip()
        if not text.isascii() or not text.isprintable() or "*" in text or not text:
            raise ValueError(text)
        code = _CODE.match(text.upper())  # "g092E0" is read as G92 by a firmware
        if head_chosen(text.upper().encode()) is not None and self.channel.wiring.printer.heads:
            message = (
                f"{text} would take another head than the job's; its syringe is changed by "
                "`printctl reload RUN --head`, which takes it and gives it back"
            )
            self._post(guest, {"event": "refused", "message": message})
            return
        if code and (code[1] + code[2] in _REFUSED or code[1] == "N"):
            message = f"{text} isn't for manual use: it would break the link's count or position"
            self._post(guest, {"event": "refused", "message": message})
            return

        def done(lines: tuple[bytes, ...]) -> None:
            said = [line.decode("ascii", "backslashreplace") for line in lines]
            self._post(guest, {"event": "reply", "command": text, "lines": said})

        self.channel.command(text.encode(), done)

    def _deliver(self) -> None:
        while self._mail:
            guest, message = self._mail.popleft()
            data = json.dumps(message).encode() + b"\n"
            guests = [guest] if guest else [g for g in self._guests.values() if g.subscribed]
            for one in guests:
                if one.socket in self._guests:
                    one.unsent += data
                    self._flush(one)

    def _flush(self, guest: _Guest) -> None:
        try:
            guest.unsent = guest.unsent[guest.socket.send(guest.unsent) :]
        except BlockingIOError:
            pass
        except OSError:
            self._dismiss(guest)
            return
        if len(guest.unsent) > _BACKLOG_LIMIT:
            self._dismiss(guest)
            return
        write = selectors.EVENT_WRITE if guest.unsent else 0
        self._selector.modify(guest.socket, selectors.EVENT_READ | write)


_WISHES: Final[dict[str, Callable[[Server, _Guest, dict[str, Any]], None]]] = {
    "status": Server._status,
    "subscribe": Server._subscribe,
    "stop": Server._do_stop,
    "kill": Server._do_kill,
    "pause": Server._do_pause,
    "reload": Server._do_reload,
    "alive": Server._do_alive,
    "resume": Server._do_resume,
    "detach": Server._do_detach,
    "command": Server._do_command,
}
