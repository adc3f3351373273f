"""Connect to a workspace's running prints and its station; send all of them a kill.

A link process and a station write where they listen into a JSON file of their folder (``address``,
``token``), and take JSON lines; of these only ``kill``, ``subscribe`` and ``detach`` (which asks
for nothing) are sent from here.
Standard library only: the stop process must be up at once and have nothing in it that can fail.
"""

from __future__ import annotations

import contextlib
import json
import socket
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

RECORDS: Final = (
    "station/station.json",
    "station/link.json",
    "runs/*/print/link.json",
    "jobs/*.print/link.json",
)
OVER: Final = frozenset(
    {"killed", "halted", "failed", "stopped", "done", "position_unknown", "given_up"}
)
"""States after which nothing more comes of a stop."""
UNHEARD: Final = "no word that the printer has halted: CUT ITS POWER"
_LOOK_S: Final = 0.5
_SEND_S: Final = 1.0
_SHORTLY_S: Final = 0.02


@dataclass(frozen=True)
class SentStop:
    """Record of a stop that was sent.

    Attributes
    ----------
    folder : str
        Of the print or station.
    after_ms : float, ms
        From the request to the last byte in the socket.
    process : int
        The one that speaks to the machine; a station's print and the station are of one process.
    """

    folder: str
    after_ms: float
    process: int = 0


@dataclass(frozen=True)
class _Record:
    """What a record says, as of its last change."""

    changed_ns: int
    address: str
    token: str
    process: int = 0


@dataclass
class Wires:
    """The open connections; `follow` looks for new prints, `kill` stops all.

    Attributes
    ----------
    root : Path
        Workspace.
    clock : callable
        Monotonic, s.
    """

    root: Path
    clock: Callable[[], float] = time.monotonic
    _records: dict[Path, _Record] = field(default_factory=dict)
    _open: dict[Path, tuple[socket.socket, str]] = field(default_factory=dict)
    _looking: threading.Lock = field(default_factory=threading.Lock)
    _over: threading.Event = field(default_factory=threading.Event)

    @property
    def live(self) -> int:
        """How many prints and stations are connected."""
        return len(self._open)

    def follow(self) -> None:
        """Look for prints until `close`, in a thread of its own."""
        threading.Thread(target=self._follow, name="wires", daemon=True).start()

    def close(self) -> None:
        """Let go of all; the prints go on."""
        self._over.set()
        for path in list(self._open):
            self._drop(path)

    def look(self) -> list[Path]:
        """Connect to what is new, let go of what has ended; give the new ones."""
        with self._looking:
            for path, (wire, _) in list(self._open.items()):
                if _ended(wire):
                    self._drop(path)
            return [path for path in self._candidates() if self._connect(path)]

    def kill(self, began: float) -> Iterator[SentStop]:
        """Send a kill to all that is connected, then to what a last look finds.

        Parameters
        ----------
        began : float, s
            On `clock`, when the request came in.
        """
        known = list(self._open)
        for path in known:
            if self._send_kill(path):
                yield self._sent(path, began)
        for path in self.look():
            if self._send_kill(path):
                yield self._sent(path, began)

    def outcome(self, folder: str, patience_s: float) -> dict[str, Any]:
        """What a print or station says of itself after a kill: ``state`` and ``message``."""
        limit = self.clock() + patience_s
        said: dict[str, Any] = {}
        path = next((p for p in self._records if str(p.parent) == folder), None)
        while path is not None and said.get("state") not in OVER and self.clock() < limit:
            said = self._hear(path, limit - self.clock()) or _last_word(path) or said
            if said.get("state") not in OVER:
                time.sleep(_SHORTLY_S)  # its socket has closed, its last word isn't written yet
        state = said.get("state", "unknown")
        return {"state": state, "message": said.get("message", "") if state in OVER else UNHEARD}

    def unheard(self, sent: Sequence[SentStop], patience_s: float) -> bool:
        """Whether one of them hasn't said within ``patience_s`` that it has halted."""
        limit = self.clock() + patience_s
        words = (
            self.outcome(one.folder, max(limit - self.clock(), _SHORTLY_S))["message"]
            for one in sent
        )
        return any(word == UNHEARD for word in words)

    # --- within --------------------------------------------------------------------------

    def _follow(self) -> None:
        while not self._over.wait(_LOOK_S):
            with contextlib.suppress(OSError):  # a folder that goes away while it is looked at
                self.look()

    def _candidates(self) -> Iterator[Path]:
        for pattern in RECORDS:
            for path in self.root.glob(pattern):
                try:
                    changed = path.stat().st_mtime_ns
                except FileNotFoundError:
                    continue
                known = self._records.get(path)
                if known is None or known.changed_ns != changed:
                    self._records[path] = known = _read(path, changed)
                if known.address and path not in self._open:
                    yield path

    def _connect(self, path: Path) -> bool:
        record = self._records[path]
        wire = _dial(record.address)
        if wire is not None:
            with contextlib.suppress(
                OSError
            ):  # said, so that the stop process keeps it before strangers
                wire.sendall(_message("detach", record.token))
            self._open[path] = (wire, record.token)
        return wire is not None

    def _send_kill(self, path: Path) -> bool:
        connection = self._open.get(path)
        if connection is None:
            return False
        wire, token = connection
        try:
            wire.sendall(_message("kill", token))
        except OSError:
            self._drop(path)
            return False
        return True

    def _sent(self, path: Path, began: float) -> SentStop:
        record = self._records[path]
        return SentStop(str(path.parent), (self.clock() - began) * 1e3, record.process)

    def _drop(self, path: Path) -> None:
        connection = self._open.pop(path, None)
        if connection:
            connection[0].close()

    def _hear(self, path: Path, patience_s: float) -> dict[str, Any]:
        record = self._records[path]
        wire = _dial(record.address)
        if wire is None:
            return {}
        limit, heard = self.clock() + patience_s, b""
        last: dict[str, Any] = {}
        with wire, contextlib.suppress(OSError, ValueError):
            wire.sendall(_message("subscribe", record.token))
            while (left := limit - self.clock()) > 0:
                wire.settimeout(left)
                data = wire.recv(65536)
                if not data:
                    return _last_word(path) or last
                *lines, heard = (heard + data).split(b"\n")
                for message in map(json.loads, lines):
                    if message.get("event") == "status":
                        last = message
                if last.get("state") in OVER:
                    break
        return last


def _read(path: Path, changed: int) -> _Record:
    try:
        said = json.loads(path.read_text(encoding="utf-8"))
        ended = bool(said.get("status", {}).get("state") in OVER) if path.name == "link.json" else 0
        address = "" if ended else str(said.get("address", ""))
        return _Record(changed, address, str(said["token"]), int(said.get("pid", 0)))
    except (OSError, ValueError, KeyError, AttributeError, TypeError):
        return _Record(changed, "", "")


def _last_word(path: Path) -> dict[str, Any]:
    try:
        status = json.loads(path.read_text(encoding="utf-8")).get("status") or {}
    except (OSError, ValueError, AttributeError):
        return {}
    return dict(status)


def _dial(address: str) -> socket.socket | None:
    kind, _, rest = address.partition(":")
    try:
        if kind == "unix":
            wire = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            wire.settimeout(_SEND_S)
            try:
                wire.connect(rest)
            except OSError:
                wire.close()
                raise
            return wire
        host, _, port = rest.rpartition(":")
        wire = socket.create_connection((host, int(port)), _SEND_S)
        wire.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    except (OSError, ValueError):
        return None
    return wire


def _message(do: str, token: str) -> bytes:
    return json.dumps({"do": do, "token": token}).encode() + b"\n"


def _ended(wire: socket.socket) -> bool:
    """Whether the other side has gone; nothing that it said is taken."""
    wire.settimeout(0)
    try:
        return wire.recv(1, socket.MSG_PEEK) == b""
    except (BlockingIOError, InterruptedError):
        return False
    except OSError:
        return True
    finally:
        with contextlib.suppress(OSError):
            wire.settimeout(_SEND_S)
