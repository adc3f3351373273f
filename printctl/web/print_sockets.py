"""Connect to a workspace's running prints and its station; send all of them a kill.

A link process and a station write where they listen into a JSON file of their folder (``address``,
``token``) and take JSON lines; only ``kill``, ``subscribe`` and ``detach`` are sent from here.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, cast

from printctl.machine.records.actor import ACTOR

RECORDS: Final = (
    "station/station.json", "station/link.json", "runs/*/print/link.json", "jobs/*.print/link.json",
)  # fmt: skip
ENDED: Final = {"killed", "halted", "failed", "stopped", "done", "position_unknown", "given_up"}
"""States after which nothing more comes of a stop."""
UNCONFIRMED: Final = "no word that the printer has halted: CUT ITS POWER"
PATIENCE_S: Final = 4.5
"""For the outcome of a stop: M112 leaves 3.8 s after it at the latest (two lines in flight)."""
_LOOK_S: Final = 0.5
_CONNECT_S: Final = 1.0
_POLL_S: Final = 0.02


@dataclass(frozen=True)
class SentStop:
    """A stop that was sent: to the print or station of ``folder``, ``after_ms`` the request.

    ``process`` speaks to the machine; a station and its print have the same.
    """

    folder: str
    after_ms: float
    process: int = 0


class _PrintSocket(asyncio.Protocol):
    def __init__(self, path: Path, record: dict[str, Any]) -> None:
        self.path, self._token, self._unread = path, str(record["token"]), b""
        self.process = int(record.get("pid", 0))
        self.status: dict[str, Any] = {}

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = cast(asyncio.Transport, transport)
        self.send("detach")  # makes it a known client, which is kept before strangers

    def data_received(self, data: bytes) -> None:
        *lines, self._unread = (self._unread + data).split(b"\n")
        for line in lines:
            with contextlib.suppress(ValueError, AttributeError):
                message = json.loads(line)
                self.status = message if message.get("event") == "status" else self.status

    def send(self, *requests: str) -> bool:
        """Send requests; return whether the connection takes them."""
        about = {"token": self._token, "by": ACTOR.get()}
        lines = [json.dumps({"do": one, **about}) + "\n" for one in requests]
        if not self.transport.is_closing():
            self.transport.write("".join(lines).encode())
        return not self.transport.is_closing()


class PrintSockets:
    """Open connections to all prints and stations below ``root``; `follow` keeps them."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._records: dict[Path, tuple[int, dict[str, Any]]] = {}
        self._open: dict[Path, _PrintSocket] = {}
        self._killed: dict[SentStop, _PrintSocket] = {}
        self._looking = asyncio.Lock()

    @property
    def connected(self) -> int:
        """Number of prints and stations that are connected."""
        return sum(not one.transport.is_closing() for one in self._open.values())

    async def follow(self) -> None:
        """Connect to new prints until cancelled; the prints go on."""
        try:
            while True:
                with contextlib.suppress(OSError):  # a folder that goes away meanwhile
                    await self._look()
                await asyncio.sleep(_LOOK_S)
        finally:
            for one in self._open.values():
                one.transport.close()

    async def kill(self, began: float) -> list[SentStop]:
        """Send a kill to all that is connected, at once, then to what a last look finds.

        ``began`` is when the request came in, s of `time.monotonic`.
        """
        known = list(self._open.values())
        sent = [self._kill(one, began) for one in known]
        with contextlib.suppress(OSError, TimeoutError):  # a disk that doesn't answer
            await asyncio.wait_for(self._look(), _CONNECT_S)
        sent += [self._kill(one, began) for one in list(self._open.values()) if one not in known]
        return [one for one in sent if one is not None]

    async def outcomes(self, sent: Sequence[SentStop]) -> list[dict[str, Any]]:
        """Return ``folder``, ``state``, ``message`` of each; `UNCONFIRMED` after `PATIENCE_S`."""
        limit = time.monotonic() + PATIENCE_S
        return list(await asyncio.gather(*(self._outcome(one, limit) for one in sent)))

    async def _outcome(self, sent: SentStop, limit: float) -> dict[str, Any]:
        one = self._killed.pop(sent)
        status: dict[str, Any] = {}
        while status.get("state") not in ENDED and time.monotonic() < limit:
            await asyncio.sleep(_POLL_S)
            status = one.status
            if one.transport.is_closing():  # its last status is in the file, soon
                status = _status(await asyncio.to_thread(_read, one.path)) or status
        state = str(status.get("state", "unknown"))
        message = status.get("message", "") if state in ENDED else UNCONFIRMED
        return {"folder": sent.folder, "state": state, "message": message}

    def _kill(self, one: _PrintSocket, began: float) -> SentStop | None:
        one.status = {}
        if not one.send("kill", "subscribe"):
            return None
        after_ms = (time.monotonic() - began) * 1e3
        stop = SentStop(str(one.path.parent), after_ms, one.process)
        self._killed[stop] = one
        return stop

    async def _look(self) -> None:
        async with self._looking:
            found = await asyncio.to_thread(lambda: list(self._find()))
            self._open = {p: o for p, o in self._open.items() if not o.transport.is_closing()}
            for path, record in found:
                if path not in self._open:
                    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
                        async with asyncio.timeout(_CONNECT_S):
                            self._open[path] = await _connect(_PrintSocket(path, record), record)

    def _find(self) -> Iterator[tuple[Path, dict[str, Any]]]:
        for path in (path for pattern in RECORDS for path in self._root.glob(pattern)):
            try:
                changed = path.stat().st_mtime_ns
            except FileNotFoundError:
                continue
            if self._records.get(path, (0, {}))[0] != changed:
                self._records[path] = changed, _read(path)
            record = self._records[path][1]
            ended = path.name == "link.json" and _status(record).get("state") in ENDED
            if record.get("address") and not ended:
                yield path, record


def _read(path: Path) -> dict[str, Any]:
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return record if isinstance(record, dict) else {}


def _status(record: dict[str, Any]) -> dict[str, Any]:
    status = record.get("status")
    return status if isinstance(status, dict) else {}


async def _connect(one: _PrintSocket, record: dict[str, Any]) -> _PrintSocket:
    loop = asyncio.get_running_loop()
    kind, _, place = str(record["address"]).partition(":")
    if kind == "unix":
        await loop.create_unix_connection(lambda: one, place)
    else:
        host, _, port = place.rpartition(":")
        await loop.create_connection(lambda: one, host, int(port))
    return one
