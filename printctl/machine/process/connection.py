"""A client's socket connection to a print's link process, with reconnection."""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from printctl.machine.errors import NoLink, Refused
from printctl.machine.process.detached_process import START_LIMIT_S
from printctl.machine.process.find_link import alive, connect
from printctl.machine.records.record import LinkRecord, load_record
from printctl.machine.records.states import Status

ANSWER_LIMIT_S: Final = 5.0


class Connection:
    """A socket to the link process of a folder.

    Parameters
    ----------
    folder : Path
    record : LinkRecord

    Attributes
    ----------
    last : Status or None
        The last one heard, or kept.
    """

    def __init__(self, folder: Path, record: LinkRecord) -> None:
        self.folder, self.record = folder, record
        self.last: Status | None = None
        self._socket: socket.socket | None = None
        self._heard = b""
        self.reach()

    def detach(self) -> None:
        """Leave; the print goes on."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def reach(self) -> bool:
        """Connect, or connect again; False when the print is over.

        Raises
        ------
        NoLink
            When another print was begun in the folder, or its record can't be read.
        """
        limit = time.monotonic() + START_LIMIT_S
        while self._socket is None and time.monotonic() < limit:
            record = load_record(self.folder)
            if self.record.print_id not in ("", record.print_id):
                raise NoLink(f"another print was begun in {self.folder} since; attach to that one")
            self.record = record
            self._socket = connect(record)
            if self._socket is not None:
                self._heard = b""
                self._post("subscribe")
            elif self.record.status or not alive(self.folder):
                return False
            else:
                time.sleep(0.02)
        return self._socket is not None

    def send(self, do: str, **values: Any) -> None:
        """Send a request; without effect when the print is over, which `wait` tells."""
        if not self._post(do, **values):
            self.detach()
            if self.reach():
                self._post(do, **values)

    def ask(self, do: str, **values: Any) -> None:
        """Send a request and hear that it was understood; without effect when the print is over."""
        self.send(do, answer=True, **values)
        for message in self.messages(ANSWER_LIMIT_S):
            self.take(message)
            if message["event"] == "refused":
                raise Refused(message["message"])
            if message["event"] == "heard" and message["do"] == do:
                return

    def take(self, message: dict[str, Any]) -> Status | None:
        """Keep and return the status that a message tells; None for another message."""
        if message["event"] != "status":
            return None
        self.last = Status.from_dict(message)
        return self.last

    def keep(self, status: Status) -> Status:
        """Keep and return what is known of the print without its process."""
        self.last = status
        return status

    def _post(self, do: str, **values: Any) -> bool:
        message = {"do": do, "token": self.record.token, **values}
        try:
            if self._socket is not None:
                self._socket.sendall(json.dumps(message).encode() + b"\n")
        except OSError:
            return False
        return self._socket is not None

    def messages(self, timeout: float | None) -> Iterator[dict[str, Any]]:
        """Give messages until the connection or the time is at its end."""
        limit = None if timeout is None else time.monotonic() + timeout
        while (connection := self._socket) is not None:
            while b"\n" in self._heard:
                line, self._heard = self._heard.split(b"\n", 1)
                yield json.loads(line)
            try:
                left = None if limit is None else limit - time.monotonic()
                if left is not None and left <= 0:
                    return
                connection.settimeout(left)
                data = connection.recv(65536)
            except TimeoutError:
                return
            except OSError:
                data = b""
            if not data:
                self.detach()
            self._heard += data
