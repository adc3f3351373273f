"""Send one request to a station over a separate connection."""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from printctl.machine.control.station_status import NO_PRINTER
from printctl.machine.errors import BY_NAME, LinkError, NoLink
from printctl.machine.process.find_link import alive, open_address
from printctl.machine.process.station_record import LOCK, LOG, StationRecord, load_station

_COMES_UP_S: Final = 5.0
_CHUNK: Final = 65536


def open_connection(folder: Path) -> tuple[socket.socket, StationRecord] | None:
    """Connect to a folder's station; None when it has gone.

    Raises
    ------
    NoLink
        When none was ever opened there, or one is alive and can't be reached.
    """
    limit = time.monotonic() + _COMES_UP_S
    while True:
        record = load_station(folder)
        connection = open_address(record.address)
        if connection is not None:
            return connection, record
        if not alive(folder, LOCK):
            return None
        if time.monotonic() > limit:
            raise NoLink(f"the station of {folder} doesn't answer; see {folder / LOG}")
        time.sleep(0.02)


def send_request(
    connection: socket.socket, record: StationRecord, do: str, /, **values: Any
) -> None:
    """Send a request."""
    message = {"do": do, "token": record.token, **values}
    connection.sendall(json.dumps(message).encode() + b"\n")


def messages(connection: socket.socket, timeout: float | None) -> Iterator[dict[str, Any]]:
    """Give what the station says, until it hangs up or the time is over."""
    limit = None if timeout is None else time.monotonic() + timeout
    heard = b""
    while True:
        left = None if limit is None else limit - time.monotonic()
        if left is not None and left <= 0:
            return
        try:
            connection.settimeout(left)
            data = connection.recv(_CHUNK)
        except OSError:
            return
        if not data:
            return
        *lines, heard = (heard + data).split(b"\n")
        yield from map(json.loads, lines)


def request_answer(folder: Path, do: str, patience_s: float, /, **values: Any) -> dict[str, Any]:
    """Ask, and wait for the answer.

    Raises
    ------
    LinkError
        As the station says; `NoLink` where there is none, or no answer within ``patience_s``.
    """
    opened = open_connection(folder)
    if opened is None:
        raise NoLink(NO_PRINTER)
    connection, record = opened
    with connection:
        try:
            send_request(connection, record, do, **values)
        except OSError as exc:
            raise NoLink(NO_PRINTER) from exc
        for message in messages(connection, patience_s):
            if message["event"] == "refused":
                raise BY_NAME.get(message.get("error", ""), LinkError)(message["message"])
            if message["event"] in ("reply", "heard") or message.get("asked"):
                return message
    raise NoLink(f"no answer to {do!r} from the station of {folder} within {patience_s:g} s")
