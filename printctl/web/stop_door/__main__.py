"""``python -m printctl.web.stop_door``: the stop door's process; `keeping` starts it.

It reads its order from standard input, and says its port on standard output. When the input ends
without a word (the server died), it stays as long as something is connected that a page might
want to stop, unless a new server has taken over the workspace.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import ssl
import sys
import threading
import time
from http.server import ThreadingHTTPServer
from pathlib import Path
from typing import Any, Final

from printctl.web.stop_door.answering import Answering
from printctl.web.stop_door.order import DoorOrder
from printctl.web.stop_door.wires import Wires

_LOOK_S: Final = 1.0
_MOST: Final = 200
"""Connections at a time; who only holds one open is dropped after `Answering.timeout`."""


class DoorServer(ThreadingHTTPServer):
    """A thread a connection, so that none waits for another."""

    daemon_threads = True
    request_queue_size = 64
    context: ssl.SSLContext | None = None

    def __init__(self, order: DoorOrder, port: int, answering: type[Answering]) -> None:
        self.address_family = socket.AF_INET6 if ":" in order.host else socket.AF_INET
        self._places = threading.BoundedSemaphore(_MOST)
        super().__init__((order.host, port), answering)
        if order.cert:
            self.context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
            self.context.load_cert_chain(order.cert, order.key or None)

    def server_bind(self) -> None:
        """Bind without asking a name server for our own name, which can take seconds."""
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        socket.socket.bind(self.socket, self.server_address)
        self.server_address = self.socket.getsockname()

    def process_request(self, request: Any, client_address: Any) -> None:
        """Hand a connection to a thread, or drop it when there are too many."""
        if self._places.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Serve a connection; a handshake is made here, where it holds nobody up."""
        try:
            if self.context is not None:
                request.settimeout(Answering.timeout)
                request = self.context.wrap_socket(request, server_side=True)
        except (OSError, ValueError):
            self.shutdown_request(request)
        else:
            super().process_request_thread(request, client_address)
        finally:
            self._places.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Take no notice of a browser that went away."""


def main() -> None:
    """Serve until the server says so, or has gone and nothing is connected."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the server's Ctrl-C; it tells us
    order = DoorOrder.from_json(sys.stdin.readline())
    wires = Wires(Path(order.root))
    answering = type("AnsweringHere", (Answering,), {"order": order, "wires": wires})
    server = _listen(order, answering)
    wires.follow()
    threading.Thread(target=server.serve_forever, args=(0.2,), daemon=True).start()
    print(json.dumps({"port": server.server_address[1]}), flush=True)
    if not sys.stdin.readline():
        _outlive(order, wires)
    wires.close()


def _listen(order: DoorOrder, answering: type[Answering]) -> DoorServer:
    try:
        return DoorServer(order, order.port, answering)
    except OSError:
        return DoorServer(order, 0, answering)


def _outlive(order: DoorOrder, wires: Wires) -> None:
    """Stay while something may have to be stopped and no new server has its own door."""
    record = Path(order.root) / ".printctl" / "serve.json"
    mine = _pid(record)
    while wires.live and _pid(record) == mine:
        time.sleep(_LOOK_S)


def _pid(record: Path) -> int | None:
    try:
        return int(json.loads(record.read_text(encoding="utf-8"))["pid"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


if __name__ == "__main__":
    main()
    os._exit(0)  # without waiting for connections that browsers keep open
