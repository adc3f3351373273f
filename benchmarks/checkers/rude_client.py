"""A client that fills a server with idle connections and wrong tokens.

``python -m benchmarks.checkers.rude_client HOST:PORT,... --idle 2000 --wrong-a-minute 1000`` runs
until its input ends. It connects from addresses 127.0.x.y, and again as soon as it is dropped.
It knows nothing of the product.
"""

from __future__ import annotations

import argparse
import contextlib
import errno
import json
import resource
import selectors
import socket
import sys
import threading
import time
from typing import Any, Final

_AT_ONCE: Final = 50
_WAITING: Final = (errno.EINPROGRESS, errno.EWOULDBLOCK, errno.EAGAIN)


class IdleCrowd:
    """Holds so many connections open and says nothing."""

    def __init__(self, place: tuple[str, int], count: int) -> None:
        self._place, self._count = place, count
        self._open: set[socket.socket] = set()
        self._selector = selectors.DefaultSelector()
        self.made = self.dropped = 0

    def run(self) -> None:
        """Connect, and connect again what was dropped, for ever."""
        while True:
            for _ in range(min(_AT_ONCE, self._count - len(self._open))):
                self._connect()
            for key, _ in self._selector.select(0.02):
                self._look(key.fileobj)

    def _connect(self) -> None:
        one = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        number, self.made = self.made, self.made + 1
        half = number % 2  # one half of one address, the other of many
        origin = "127.0.0.1" if half else f"127.0.{1 + number % 4}.{1 + number // 4 % 250}"
        one.setblocking(False)
        with contextlib.suppress(OSError):
            one.bind((origin, 0))
            if one.connect_ex(self._place) in (0, *_WAITING):
                self._open.add(one)
                self._selector.register(one, selectors.EVENT_READ)
                return
        one.close()

    def _look(self, one: Any) -> None:
        try:
            if one.recv(4096):
                return
        except BlockingIOError:
            return
        except OSError:
            pass
        self._selector.unregister(one)
        self._open.discard(one)
        one.close()
        self.dropped += 1

    @property
    def held(self) -> int:
        """Connections that are open now, as far as this side knows."""
        return len(self._open)


def try_tokens(place: tuple[str, int], a_minute: float, told: dict[str, int]) -> None:
    """Send stops with wrong tokens, for ever; a server that doesn't answer is left waiting."""
    request = (
        f"POST /stop HTTP/1.1\r\nHost: {place[0]}:{place[1]}\r\n"
        "Authorization: Bearer {}\r\nContent-Length: 0\r\n\r\n"
    )
    waiting: list[socket.socket] = []
    number = 0
    while True:
        number += 1
        with contextlib.suppress(OSError):
            one = socket.create_connection(place, 5)
            one.sendall(request.format(f"{number:043d}").encode())
            waiting.append(one)
            told["wrong_tokens"] += 1
        if len(waiting) > 100:
            waiting.pop(0).close()
        time.sleep(60.0 / a_minute)


def main() -> None:
    """Be rude until the input ends; then tell how much, as one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("places", help="HOST:PORT,HOST:PORT; the first gets the idle ones")
    parser.add_argument("--idle", type=int, default=2000)
    parser.add_argument("--wrong-a-minute", type=float, default=1000.0)
    asked = parser.parse_args()
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(most, asked.idle + 1000), most))
    places = [
        (host, int(port)) for host, _, port in (p.partition(":") for p in asked.places.split(","))
    ]
    crowd, told = IdleCrowd(places[0], asked.idle), {"wrong_tokens": 0}
    work = [threading.Thread(target=crowd.run, daemon=True)]
    work += [
        threading.Thread(target=try_tokens, args=(place, asked.wrong_a_minute, told), daemon=True)
        for place in places
    ]
    for one in work:
        one.start()
    sys.stdin.read()
    print(json.dumps({"made": crowd.made, "dropped": crowd.dropped, "held": crowd.held, **told}))


if __name__ == "__main__":
    main()
