"""Client that attacks a server with idle connections and wrong tokens.

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


class WrongTokens:
    """Sends stops with wrong tokens at a rate; who doesn't answer is left waiting."""

    def __init__(self, place: tuple[str, int], a_minute: float) -> None:
        self.place, self._period = place, 60.0 / a_minute
        self.sent = 0
        self._begin = time.monotonic()

    @property
    def a_minute(self) -> float:
        """How many were sent a minute, so far."""
        return 60.0 * self.sent / max(time.monotonic() - self._begin, 1e-3)

    def run(self) -> None:
        """Send for ever; a try that was held up is made up for."""
        host, port = self.place
        request = (
            f"POST /stop HTTP/1.1\r\nHost: {host}:{port}\r\n"
            "Authorization: Bearer {}\r\nContent-Length: 0\r\n\r\n"
        )
        waiting: list[socket.socket] = []
        self._begin = due = time.monotonic()
        while True:
            with contextlib.suppress(OSError):
                one = socket.create_connection(self.place, 5)
                one.sendall(request.format(f"{self.sent:043d}").encode())
                waiting.append(one)
                self.sent += 1
            if len(waiting) > 100:
                waiting.pop(0).close()
            due += self._period
            time.sleep(max(due - time.monotonic(), 0.0))


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
    crowd = IdleCrowd(places[0], asked.idle)
    tokens = [WrongTokens(place, asked.wrong_a_minute) for place in places]
    for work in (crowd.run, *(one.run for one in tokens)):
        threading.Thread(target=work, daemon=True).start()
    sys.stdin.read()
    told: dict[str, Any] = {"made": crowd.made, "dropped": crowd.dropped, "held": crowd.held}
    told["wrong_tokens"] = sum(one.sent for one in tokens)
    told["wrong_tokens_a_minute_by_place"] = [round(one.a_minute) for one in tokens]
    print(json.dumps(told))


if __name__ == "__main__":
    main()
