"""Emergency stops under load by rude clients.

A rude client holds 2,000 idle connections open and shows 1,000 wrong tokens a minute, from one
address and from many, and comes again as soon as it is dropped. The page's server is suspended
(SIGSTOP). A stop counts from the first byte of its connection to the kill's arrival at what stands
for a print's process.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final
from urllib.parse import urlsplit

import numpy as np

from benchmarks.common import ROOT, Row, all_of
from benchmarks.operator.server import page_server, workspace

IDLE, WRONG_A_MINUTE = 2000, 1000
LIMIT_MS: Final = 100.0
FOUND_S: Final = 3.0
CROWDED_S: Final = 4.0
_GIVE_UP_S: Final = 10.0


class PrintDouble:
    """Listens where a print's process would, and notes when a kill comes."""

    def __init__(self, workspace: Path) -> None:
        folder = workspace / "jobs" / "part.gcode.print"
        folder.mkdir(parents=True)
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._listener.bind(str(folder / "link.sock"))
        self._listener.listen()
        self.came, self.at = threading.Event(), 0.0
        record = {"pid": os.getpid(), "address": f"unix:{folder / 'link.sock'}", "token": "t"}
        (folder / "link.json").write_text(json.dumps(record))
        threading.Thread(target=self._welcome, daemon=True).start()

    def _welcome(self) -> None:
        while True:
            one, _ = self._listener.accept()
            threading.Thread(target=self._hear, args=(one,), daemon=True).start()

    def _hear(self, one: socket.socket) -> None:
        with one, one.makefile("rb") as lines:
            for line in lines:
                request = json.loads(line)
                if request["do"] == "kill":
                    self.at = time.monotonic()
                    self.came.set()
                if request["do"] == "subscribe":
                    one.sendall(b'{"event": "status", "state": "killed", "message": "halted"}\n')


@contextmanager
def rude(places: str) -> Iterator[subprocess.Popen[str]]:
    """Run the rude client against ``HOST:PORT,HOST:PORT``."""
    command = [sys.executable, "-m", "benchmarks.checkers.rude_client", places]
    command += ["--idle", str(IDLE), "--wrong-a-minute", str(WRONG_A_MINUTE)]
    with subprocess.Popen(
        command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        yield process
        process.kill()


def one_stop(place: tuple[str, int], headers: dict[str, str], double: PrintDouble) -> float:
    """Ask for a stop over a connection of its own; ms to the kill's arrival, infinite for none."""
    double.came.clear()
    lines = [f"{name}: {value}" for name, value in headers.items()]
    text = "\r\n".join(["POST /stop HTTP/1.1", *lines, "Content-Length: 0", "", ""])
    begin = time.monotonic()
    try:
        with socket.create_connection(place, _GIVE_UP_S) as one:
            one.sendall(text.encode())
            there = double.came.wait(_GIVE_UP_S) and b" 200 " in one.recv(4096)
    except OSError:
        return float("inf")
    return 1e3 * (double.at - begin) if there else float("inf")


def rows(quick: bool) -> Iterator[Row]:
    """Yield a hundred stops by token beside the crowd, from its address; quick has ten."""
    tries, took = 10 if quick else 100, list[float]()
    with workspace() as place:
        double = PrintDouble(place)
        with page_server(place) as server:
            door, page = urlsplit(server["stop"]), urlsplit(server["url"])
            address = (str(door.hostname), int(door.port or 0))
            headers = {"Host": door.netloc, "Authorization": f"Bearer {server['token']}"}
            time.sleep(FOUND_S)
            with rude(f"{door.netloc},{page.netloc}") as client:
                time.sleep(CROWDED_S)
                os.kill(server["pid"], signal.SIGSTOP)
                try:
                    for _ in range(tries):
                        took.append(one_stop(address, headers, double))
                        time.sleep(0.1)
                finally:
                    os.kill(server["pid"], signal.SIGCONT)
                crowd, _ = client.communicate("")
    good = sum(one <= LIMIT_MS for one in took)
    name = f"stop beside {IDLE} idle connections and {WRONG_A_MINUTE} wrong tokens a minute"
    facts = {"median_ms": round(float(np.median(took)), 2), "longest_ms": round(max(took), 2)}
    made = all_of(f"{name}, server suspended: in 100 ms", good, tries)
    yield made | facts | {"clock": "wall"} | json.loads(crowd)
