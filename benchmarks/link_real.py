"""Link benchmark rows in real time: processes, pseudo-terminals, kill -9."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.checkers.link_order import body_of, unreached
from benchmarks.link_files import PrintFile, zigzag
from benchmarks.link_printers import (
    PeerFailedError,
    answerer,
    profile,
    read_record,
    simulated,
)
from benchmarks.link_runs import ends_of
from benchmarks.link_tap import Tap
from benchmarks.machine import row
from printctl.machine.link import LinkState, PrintClient, resume_print, start_print
from sim.gcode.motion.executed import ExecutedMotion

Row = dict[str, Any]
REAL = {"clock": "wall"}
_TICK_S = 1.0 / os.sysconf("SC_CLK_TCK")


def speed_rows(lines: int, folder: Path) -> Iterator[Row]:
    """Lines per second and the link process's CPU per line, against a peer that only answers."""
    file, record = zigzag(lines), folder / "answered.json"
    quick = profile(folder, "no_reset", resets_on_connect=False)
    with answerer(record) as port, _Watched() as cpu:
        job = file.write(folder / "speed.gcode")
        client = start_print(job, quick, port, folder / "speed")
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
    yield row(f"{name}: speed", round(rate), "lines/s", ">= 8000", rate >= 8000) | REAL
    each = 1e6 * cpu.seconds / lines
    made = row(f"{name}: CPU of the link process", round(each, 1), "µs/line", "<= 45", each <= 45)
    yield made | {"clock": "CPU", "resolution_us": round(1e6 * _TICK_S / lines, 2)}
    done = outcome.state is LinkState.DONE
    right = in_order and done
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


def kill_nine_rows(prints: int, kills: int, folder: Path) -> Iterator[Row]:
    """The link process is killed by kill -9 in mid-print, and the print resumed."""
    file, exact, done = zigzag(40_000), 0, 0
    job = file.write(folder / "killed.gcode")
    for k in range(prints):
        rng = np.random.default_rng(k)
        record = folder / f"killed-{k}.npz"
        with simulated("generic_marlin", "--record", str(record)) as port:
            client = start_print(job, "generic_marlin", port, folder / f"killed-{k}")
            at = 0
            for _ in range(kills):
                at = _wait_for(client, at + int(rng.integers(500, 7000)))
                time.sleep(rng.uniform(0.0, 0.1))
                os.kill(client.record.pid, signal.SIGKILL)
                done += 1
                client.wait(30)
                client = resume_print(folder / f"killed-{k}", port)
            outcome = client.wait(120)
        exact += outcome.state is LinkState.DONE and _exact(file, record)
    made = row(
        "link process killed by kill -9 and resumed: prints exact",
        exact,
        f"of {prints}",
        "all",
        exact == prints,
    )
    yield made | REAL | {"kills": done, "by": "the simulated printer's step counters"}


def _wait_for(client: PrintClient, lines: int) -> int:
    """Until so many lines are done, or the print is over; how many are."""
    for status in client.events():
        if status.lines_done >= lines or status.ended:
            return status.lines_done
    return 0


def _exact(file: PrintFile, record: Path) -> bool:
    return unreached(file.ends, ends_of(ExecutedMotion.load(record))) == (0, 0)


def stop_rows(tries: int, folder: Path) -> Iterator[Row]:
    """Kill with the planner full, by both parsers, timed by a tap in the cable.

    With an emergency parser M410 goes first, which stops the motors, and M112 some 1.8 s later.
    """
    job = zigzag(2000, 300).write(folder / "slow.gcode")
    for parser, lines in ((False, 1), (True, 1), (False, 2)):
        first = b"M410\n" if parser else b"M112\n"
        name = f"{first.decode().strip()} leaves first, planner full, "
        name += f"{'with' if parser else 'no'} emergency parser"
        name += ", two lines in flight" if lines == 2 else ""
        changes = {"emergency_parser": parser, "lines_in_flight": lines}
        facts = profile(folder, f"stop-{parser}-{lines}", resets_on_connect=False, **changes)
        host, halt = [], []
        for k in range(tries):
            print(f"{name}: {k + 1} of {tries}", file=sys.stderr, flush=True)
            left, halted = _one_stop(job, facts, folder / f"stop-{parser}-{lines}-{k}", k, first)
            host.append(1e3 * left)
            halt.append(1e3 * halted)
        middle, worst = float(np.median(host)), float(np.percentile(host, 99))
        made = row(f"{name}: host, median", round(middle, 2), "ms", "<= 5", middle <= 5)
        yield made | REAL | {"tries": tries}
        yield row(f"{name}: host, p99", round(worst, 2), "ms", "<= 20", worst <= 20) | REAL
        longest = max(halt)
        made = row(f"{name}: printer halted after", round(longest, 1), "ms", "<= 20", longest <= 20)
        yield made | REAL | {"median": round(float(np.median(halt)), 1), "of": "the longest"}


def _one_stop(job: Path, facts: str, folder: Path, seed: int, first: bytes) -> tuple[float, float]:
    """Return the time from the call to ``first`` on the wire, and from M112 to the halt, s."""
    with simulated(facts, "--speed", "1", "--tcp", "0") as port, Tap(_tcp(port)) as tap:
        with start_print(job, facts, tap.name, folder) as client:
            _wait_for(client, 20)  # the planner is full and the next line waits
            time.sleep(float(np.random.default_rng(seed).uniform(0.0, 0.5)))
            asked = time.monotonic()
            client.kill()
            outcome = client.wait(30)
        if outcome.state is not LinkState.KILLED:
            raise PeerFailedError(f"M112 ended as {outcome.state}: {outcome.message}")
        halting = tap.up_at(b"Error:Printer halted") - tap.down_at(b"M112\n")
        return tap.down_at(first) - asked, halting


def _tcp(address: str) -> int:
    return int(address.rsplit(":", 1)[1])


def fault_rows(folder: Path) -> Iterator[Row]:
    """The same faults as in virtual time, through the link process and a pseudo-terminal."""
    job = zigzag(3000).write(folder / "faults.gcode")
    for kind, state in (("reset", "position_unknown"), ("kill", "killed"), ("unplug", "failed")):
        place = folder / f"fault-{kind}"
        with (
            simulated("generic_marlin", "--fault", f"{kind}@1000") as port,
            start_print(job, "generic_marlin", port, place) as client,
        ):
            outcome = client.wait(60)
        right = outcome.state == state
        name = f"{kind} in mid-print, real processes: ends as {state}"
        yield row(name, int(right), "", "1", right) | REAL | {"message": outcome.message}
