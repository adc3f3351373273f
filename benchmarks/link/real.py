"""Speed of the link process in real time, to a peer that only answers."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.checkers.link_order import body_of
from benchmarks.common import Row, at_least, limited, row, scratch
from benchmarks.link.files import zigzag
from benchmarks.link.printers import answerer, profile, read_record
from printctl.machine.process.clients.starting import start_print
from printctl.machine.process.orders import Order
from printctl.machine.records.states import LinkState

REAL = {"clock": "wall"}
_TICK_S = 1.0 / os.sysconf("SC_CLK_TCK")


def speed_rows(quick: bool) -> Iterator[Row]:
    """Yield lines per second and the link process's CPU per line, to a peer that only answers."""
    lines = 20_000 if quick else 100_000
    file = zigzag(lines)
    with scratch() as folder:
        facts, record = profile(folder, "no_reset", resets_on_connect=False), folder / "taken.json"
        with answerer(record) as port, _Watched() as cpu:
            job = file.write(folder / "speed.gcode")
            client = start_print(Order(job, facts, port, folder / "speed"))
            cpu.watch(client.record.pid)
            outcome = client.wait(600)
        taken = read_record(record)
    begin = max(k for k, (_, text) in enumerate(taken) if b"M110" in text)
    taken = taken[begin + 1 :]
    sent = [(when, body_of(text)[1].strip()) for when, text in taken]
    known = set(file.lines)
    times = [when for when, text in sent if text in known]
    in_order = [text for _, text in sent if text in known] == file.lines and not _wrong_sums(taken)
    seconds = times[-1] - times[0]
    rate = (len(times) - 1) / seconds
    name = f"{lines:,} lines to a peer that only answers, journal on"
    yield at_least(f"{name}: speed", round(rate), "lines/s", 8000) | REAL
    each = 1e6 * cpu.seconds / lines
    made = limited(f"{name}: CPU of the link process", round(each, 1), "µs/line", 45)
    yield made | {"clock": "CPU", "resolution_us": round(1e6 * _TICK_S / lines, 2)}
    right = in_order and outcome.state is LinkState.DONE
    yield row(f"{name}: all in order, by the peer's record", int(right), "", "1", right)


def _wrong_sums(taken: list[tuple[float, bytes]]) -> int:
    """Lines whose checksum the peer, which takes all, should have refused."""
    wrong = 0
    for _, text in taken:
        body, star, said = text.rpartition(b"*")
        if star:
            xor = int(np.bitwise_xor.reduce(np.frombuffer(body, np.uint8)))
            wrong += int(said) != xor
    return wrong


class _Watched:
    """Follows a process's CPU time until it ends."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self._begin = 0.0
        self._over = threading.Event()
        self._thread: threading.Thread | None = None

    def __enter__(self) -> _Watched:
        return self

    def __exit__(self, *problem: object) -> None:
        self._over.set()
        if self._thread is not None:
            self._thread.join()

    def watch(self, pid: int) -> None:
        self._begin = _cpu_s(pid) or 0.0
        self._thread = threading.Thread(target=self._follow, args=(pid,), daemon=True)
        self._thread.start()

    def _follow(self, pid: int) -> None:
        while not self._over.wait(0.01):
            used = _cpu_s(pid)
            if used is None:
                return
            self.seconds = used - self._begin


def _cpu_s(pid: int) -> float | None:
    try:
        words = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return None
    return (int(words[11]) + int(words[12])) * _TICK_S
