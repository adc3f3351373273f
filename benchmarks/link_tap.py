"""Relay between a pseudo-terminal and TCP that records when given words pass."""

from __future__ import annotations

import os
import select
import socket
import threading
import time
import tty


class Tap:
    """Offers ``name`` to a host, and relays to the printer at ``port``.

    Attributes
    ----------
    name : str
        The terminal for the host.
    """

    def __init__(self, port: int) -> None:
        self._printer = socket.create_connection(("127.0.0.1", port))
        self._printer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.name = os.ttyname(self._slave)
        self._down: list[tuple[float, bytes]] = []
        self._up: list[tuple[float, bytes]] = []
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._relay, daemon=True)

    def __enter__(self) -> Tap:
        self._thread.start()
        return self

    def __exit__(self, *problem: object) -> None:
        self._over.set()
        self._thread.join(2.0)
        self._printer.close()
        os.close(self._master)
        os.close(self._slave)

    def _relay(self) -> None:
        while not self._over.is_set():
            ready, _, _ = select.select([self._master, self._printer], [], [], 0.05)
            if self._master in ready:
                data = os.read(self._master, 65536)
                self._down.append((time.monotonic(), data))
                self._printer.sendall(data)
            if self._printer in ready:
                data = self._printer.recv(65536)
                if not data:
                    return
                self._up.append((time.monotonic(), data))
                os.write(self._master, data)

    def down_at(self, word: bytes) -> float:
        """When the host's ``word`` had passed whole, s; infinite for never."""
        return _passed(self._down, word)

    def up_at(self, word: bytes) -> float:
        """When the printer's ``word`` had passed whole, s; infinite for never."""
        return _passed(self._up, word)


def _passed(chunks: list[tuple[float, bytes]], word: bytes) -> float:
    seen = b""
    for when, data in list(chunks):
        seen = seen[-len(word) :] + data
        if word in seen:
            return when
    return float("inf")
