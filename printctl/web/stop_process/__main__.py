"""Entry point of the stop process (``python -m printctl.web.stop_process``).

It reads its order from standard input, and says its port on standard output. When the input ends
without a word (the server died), it stays as long as something is connected that a page might
want to stop, unless a new server has taken over the workspace.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import time
from pathlib import Path
from typing import Final

from printctl.web.stop_process.connections import Wires
from printctl.web.stop_process.event_loop import StopServer
from printctl.web.stop_process.start_message import StartMessage

_LOOK_S: Final = 1.0


def main() -> None:
    """Serve until the server says so, or has gone and nothing is connected."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the server's Ctrl-C; it tells us
    order = StartMessage.from_json(sys.stdin.readline())
    wires = Wires(Path(order.root))
    server = _listen(order, wires)
    wires.follow()
    threading.Thread(target=server.serve, name="door", daemon=True).start()
    print(json.dumps({"port": server.port}), flush=True)
    if not sys.stdin.readline():
        _outlive(order, wires)
    wires.close()


def _listen(order: StartMessage, wires: Wires) -> StopServer:
    try:
        return StopServer(order, order.port, wires)
    except OSError:
        return StopServer(order, 0, wires)


def _outlive(order: StartMessage, wires: Wires) -> None:
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
