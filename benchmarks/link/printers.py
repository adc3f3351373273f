"""Simulated printers, a peer that only answers, and a tap in the cable, for prints in real time."""

from __future__ import annotations

import json
import os
import select
import socket
import subprocess
import sys
import threading
import time
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from benchmarks.common import ROOT
from benchmarks.link.files import START_MM


class PeerFailedError(Exception):
    """A process of the benchmark didn't do what it should, and what it said."""


def profile(folder: Path, name: str, **changes: object) -> str:
    """A variant of `generic_marlin`; its path."""
    data = ROOT / "firmware_profiles" / "data" / "printers" / "generic_marlin.yaml"
    facts = yaml.safe_load(data.read_text()) | changes
    path = folder / f"{name}.yaml"
    path.write_text(yaml.safe_dump(facts))
    return str(path)


@contextmanager
def answerer(record: Path) -> Iterator[str]:
    """The peer that only answers; gives its port. Its record is written at the end."""
    with _process(["-m", "benchmarks.link.answerer", str(record)]) as (process, port):
        yield port
        if process.stdin is not None:
            process.stdin.close()
        process.wait(60)


def read_record(path: Path) -> list[tuple[float, bytes]]:
    """What the answering peer took."""
    return [(when, text.encode("latin-1")) for when, text in json.loads(path.read_text())]


@contextmanager
def simulated(printer: str, *words: str) -> Iterator[str]:
    """The simulated printer as a process; gives its port."""
    start = ",".join(map(str, START_MM))
    with _process(["-m", "sim", "--printer", printer, "--start", start, *words]) as (process, port):
        yield port
        process.terminate()
        process.wait(30)


@contextmanager
def _process(words: list[str]) -> Iterator[tuple[subprocess.Popen[str], str]]:
    pipe = subprocess.PIPE
    with subprocess.Popen(
        [sys.executable, *words], cwd=ROOT, stdin=pipe, stdout=pipe, text=True
    ) as process:
        try:
            said = process.stdout.readline().strip() if process.stdout else ""
            if not said:
                raise PeerFailedError(f"{' '.join(words)} ended at once")
            yield process, said
        finally:
            process.kill()


class Tap:
    """Offers the terminal ``name`` to a host, and relays to the printer at ``port``."""

    def __init__(self, port: int) -> None:
        self._printer = socket.create_connection(("127.0.0.1", port))
        self._printer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.name = os.ttyname(self._slave)
        self._down: list[tuple[float, bytes]] = []
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
            ends: list[Any] = [self._master, self._printer]
            ready, _, _ = select.select(ends, [], [], 0.05)
            if self._master in ready:
                data = os.read(self._master, 65536)
                self._down.append((time.monotonic(), data))
                self._printer.sendall(data)
            if self._printer in ready:
                data = self._printer.recv(65536)
                if not data:
                    return
                os.write(self._master, data)

    def down_at(self, word: bytes) -> float:
        """Return when the host's ``word`` had passed whole, s; infinite for never."""
        seen = b""
        for when, data in list(self._down):
            seen = seen[-len(word) :] + data
            if word in seen:
                return when
        return float("inf")
