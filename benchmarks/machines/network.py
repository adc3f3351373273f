"""Prints behind real network hosts with cut connections, restarts and kills at seeded moments.

Each print's strokes are counted where the printer made them (`rigs.py`), each state that the
product reports is compared with what was so at the moment it speaks of.
"""

from __future__ import annotations

import os
import random
import re
import select
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.common import Row, SkippedError, all_of, limited, row, scratch
from benchmarks.firmware.product import records
from benchmarks.machines import rigs
from printctl.machine.errors import LinkError
from printctl.machine.process.clients.client import PrintClient
from printctl.machine.process.clients.starting import find_or_start
from printctl.machine.process.orders import Order
from printctl.machine.records.record import load_record
from printctl.machine.records.states import Status

END_S, STOP_GOAL_MS, SLACK_S = 90.0, 150.0, 0.5
START = {"moonraker": b"/print/start", "octoprint": b'"print": true', "duet": b"M32"}
CANCEL = {"moonraker": b"/print/cancel", "octoprint": b'"cancel"', "duet": b"M25"}
_AGE = re.compile(r"([0-9.]+) s ago")


class Proxy:
    """TCP proxy: cuts all connections for a while, or one request or its answer; keeps that."""

    def __init__(self, target: int) -> None:
        self.target, self.listener = target, socket.create_server(("127.0.0.1", 0))
        self.port = int(self.listener.getsockname()[1])
        self.down_until, self.drop, self.after = 0.0, b"", False
        self.awaited, self.passed_at, self.held = b"", 0.0, b""
        self.pairs: set[tuple[socket.socket, socket.socket]] = set()
        threading.Thread(target=self._accept, daemon=True).start()

    def cut(self, for_s: float = 0.0) -> None:
        """Reset every connection, and those of the next seconds."""
        self.down_until = time.monotonic() + for_s
        for pair in list(self.pairs):
            for end in pair:
                with suppress(OSError):
                    end.shutdown(socket.SHUT_RDWR)

    def release(self) -> None:
        """Hand a request that was cut to the host, late."""
        if self.held:
            with socket.create_connection(("127.0.0.1", self.target), 3) as late:
                late.sendall(self.held)
                late.settimeout(3)
                late.recv(65536)

    def _accept(self) -> None:
        while True:
            near, _ = self.listener.accept()
            threading.Thread(target=self._carry, args=(near,), daemon=True).start()

    def _carry(self, near: socket.socket) -> None:
        try:
            if time.monotonic() < self.down_until:
                return
            far = socket.create_connection(("127.0.0.1", self.target), 3)
        except OSError:
            return
        finally:
            if time.monotonic() < self.down_until:
                near.close()
        self.pairs.add((near, far))
        answer_lost, request = False, b""
        with near, far, suppress(OSError):
            while True:
                for end in select.select([near, far], [], [])[0]:
                    data = end.recv(65536)
                    if not data or (end is far and answer_lost):
                        return
                    request = request + data if end is near else b""
                    if end is near and self.awaited and self.awaited in data:
                        self.awaited, self.passed_at = b"", time.time()
                    if end is near and self.drop and self.drop in data:
                        self.drop, answer_lost = b"", self.after
                        if not self.after:
                            self.held = request
                            return
                    (far if end is near else near).sendall(data)
        self.pairs.discard((near, far))


@dataclass
class Trial:
    """One print and what was done to it; times in s since 1970."""

    rig: rigs.Rig
    proxy: Proxy
    order: Order
    chance: random.Random
    client: PrintClient | None = None
    samples: list[tuple[float, Status]] = field(default_factory=list)
    down: list[tuple[float, float]] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)
    halted: float = 0.0
    cancelled: float = 0.0

    def go(self) -> PrintClient:
        """Start the print, or run the same command again; once more where its process dies."""
        with suppress(LinkError):
            self.client = find_or_start(self.order, lambda: self.order.port)
            return self.client
        self.client = find_or_start(self.order, lambda: self.order.port)
        return self.client

    def watch(self, until_s: float, end: Callable[[], bool] = lambda: False) -> None:
        """Sample the reported state for a while."""
        limit = time.monotonic() + until_s
        while time.monotonic() < limit and not end():
            with suppress(LinkError):
                if self.client is not None:
                    status = self.client.status
                    self.samples.append((time.time(), status))
                    if status.ended:
                        return
            time.sleep(0.1)

    def says(self, state: str) -> bool:
        """Whether this was reported last."""
        return bool(self.samples) and self.samples[-1][1].state.value == state

    def kill_printctl(self) -> None:
        """Kill the print's process, as a power cut does."""
        os.kill(load_record(self.order.folder).pid, signal.SIGKILL)
        time.sleep(0.2)

    def restart_host(self, *names: str) -> None:
        """Kill programs of the host, and start them again a little later."""
        begun = time.time()
        self.rig.kill(*names)
        self.watch(self.chance.uniform(0.0, 5.0))
        self.down.append((begun, time.time()))
        self.rig.start()


def calm(trial: Trial) -> None:
    """Do nothing."""


def cut(trial: Trial) -> None:
    """Cut all connections for some seconds, twice."""
    for _ in range(2):
        trial.proxy.cut(trial.chance.uniform(0.0, 4.0))
        trial.watch(trial.chance.uniform(0.5, 2.0))


def host(trial: Trial) -> None:
    """Restart the host's program."""
    trial.restart_host(*(["moonraker"] if trial.rig.kind == "moonraker" else []))


def printer(trial: Trial) -> None:
    """Restart the printer's side: firmware and host."""
    trial.restart_host()


def product(trial: Trial) -> None:
    """Kill printctl and run it again."""
    trial.kill_printctl()
    trial.go()


def both(trial: Trial) -> None:
    """Kill printctl, cut the connections, run it again."""
    trial.kill_printctl()
    trial.proxy.cut(2.0)
    trial.go()


def halt(trial: Trial) -> None:
    """Halt the printer, while the host is polled."""
    trial.halted = time.time()
    assert trial.client is not None
    trial.client.kill()


def stop(trial: Trial) -> None:
    """End the print in order."""
    assert trial.client is not None
    trial.proxy.awaited = CANCEL[trial.rig.kind]
    trial.cancelled = time.time()
    trial.client.stop()


def pause(trial: Trial) -> None:
    """Pause, kill printctl in the pause, run it again, resume."""
    assert trial.client is not None
    trial.client.pause()
    trial.watch(3.0)
    product(trial)
    trial.watch(1.0)
    with suppress(LinkError):
        trial.go().resume()


def lost_answer(trial: Trial) -> None:
    """Begin with a start whose answer is lost."""
    trial.proxy.drop, trial.proxy.after = START[trial.rig.kind], True


def lost_start(trial: Trial) -> None:
    """Begin with a start that doesn't reach the host, until `late_start` or after the end."""
    trial.proxy.drop, trial.proxy.after = START[trial.rig.kind], False


def late_start(trial: Trial) -> None:
    """Hand the lost start to the host in a pause: nothing may move."""
    assert trial.client is not None
    trial.client.pause()
    trial.watch(20.0, lambda: trial.says("paused"))
    before = trial.rig.last_motion()
    trial.proxy.release()
    trial.watch(2.0)
    if trial.rig.last_motion() > before:
        trial.wrong.append("a start that came late moved a paused printer")
    with suppress(LinkError):
        trial.client.resume()


def killed_start(trial: Trial) -> None:
    """Kill printctl as soon as the intention to start is on the disk."""

    def strike() -> None:
        limit = time.monotonic() + END_S
        while time.monotonic() < limit:
            if any(one.get("do") == "start" for one in records(trial.order.folder)):
                time.sleep(trial.chance.uniform(0.0, 0.05))
                os.kill(load_record(trial.order.folder).pid, signal.SIGKILL)
                return
            time.sleep(0.001)

    threading.Thread(target=strike, daemon=True).start()


BEFORE = (lost_answer, lost_start, killed_start)
FAULTS = (lost_answer, halt, host, product, cut, lost_start, stop, printer, killed_start, pause,
          both, calm)  # fmt: skip


def run(trial: Trial, fault: Callable[[Trial], None]) -> Status:
    """Print with a fault, run the command again where printctl died; return the last status."""
    if fault in BEFORE:
        fault(trial)
    trial.go()
    if fault is lost_start:
        trial.watch(END_S, lambda: trial.says("printing"))
        fault = late_start
    if fault not in BEFORE:
        trial.watch(trial.chance.uniform(0.1, 3.5))
        if not (trial.samples and trial.samples[-1][1].ended):
            fault(trial)
    trial.watch(END_S)
    while trial.client is not None and trial.client.status.state.value == "interrupted":
        trial.go()
        trial.watch(END_S)
    assert trial.client is not None
    status = trial.client.status
    trial.samples.append((time.time(), status))
    return status


def untrue(trial: Trial, status: Status) -> list[str]:
    """Return what was reported and wasn't so."""
    found, ended = [*trial.wrong], next(at for at, one in trial.samples if one == status)
    trial.proxy.release()
    time.sleep(1.5)
    made, last = trial.rig.strokes(), trial.rig.last_motion()
    whole = all(abs(made.get(k, 0.0) - 1) < 0.1 for k in range(rigs.STROKES))
    if status.state.value == "done" and not whole:
        found.append(f"done, made {made}")
    if status.ended and not status.message.startswith("unknown") and last > ended + SLACK_S:
        found.append(f"{status.state.value}, moved {last - ended:.2f} s later")
    if status.lines_done == 0 and "nothing moved" in status.message and made:
        found.append("nothing moved, and strokes were made")
    for at, one in trial.samples:
        age = _AGE.search(one.message)
        if age and any(a + SLACK_S < at - float(age[1]) < b for a, b in trial.down):
            found.append(f"a report of a dead host: {one.message}")
        if not (age or one.ended) and one.state.value in ("printing", "paused"):
            found.append(f"a state without its age: {one.state.value}: {one.message}")
    return found


def measure(
    kind: str, make: Callable[[Path], rigs.Rig], folder: Path, quick: bool
) -> Iterator[Row]:
    """Yield the rows of one host's prints."""
    count, seed = (6 if quick else 20), 65
    rig, chance = make(folder / "rig"), random.Random(seed)
    twice = true = unknown = done = 0
    halts, stops = [], []
    with ExitStack() as parting:
        parting.callback(rig.kill)
        rig.start()
        proxy = Proxy(rig.port)
        for number in range(count):
            rig.recover()
            rig.mark()
            job = folder / f"{number}.gcode"
            job.write_text(rigs.job_text(rig.frame, rig.feed_mm_min))
            port = f"{rig.kind}://127.0.0.1:{proxy.port}"
            order = Order(job, rig.profile, port, folder / f"{number}.print")
            trial, proxy.held = Trial(rig, proxy, order, chance), b""
            fault = FAULTS[number % len(FAULTS)]
            status = run(trial, fault)
            wrong = untrue(trial, status)
            made = rig.strokes()
            again = {k: round(n, 2) for k, n in made.items() if n > 1.1}
            twice, true = twice + bool(again), true + (not wrong)
            done += status.state.value == "done"
            unknown += status.message.startswith("unknown")
            if trial.halted:
                halts.append(1000 * max(rig.halted_at() - trial.halted, 0.0))
            if trial.cancelled:
                stops.append(1000 * max(proxy.passed_at - trial.cancelled, 0.0))
            note = f"{kind} {number} {fault.__name__}: {status.state.value}: {status.message}"
            print(note, again or "", wrong or "", file=sys.stderr, flush=True)
    yield row(f"{kind}: prints with a stroke written twice", twice, f"of {count}", "0", twice == 0)
    yield all_of(f"{kind}: every reported state true", true, count)
    yield row(f"{kind}: ended as done", done, f"of {count}")
    yield row(f"{kind}: ended as unknown, look at the machine", unknown, f"of {count}")
    for what, times in (("kill to the far side", halts), ("stop to the host", stops)):
        if times:
            yield limited(f"{kind}: {what}, slowest", max(times), "ms", STOP_GOAL_MS)


def rows(quick: bool) -> Iterator[Row]:
    """Yield every host's rows; a host that isn't installed is skipped by name."""
    hosts = {
        "Moonraker, Klipper": rigs.KlipperRig,
        "OctoPrint": rigs.OctoPrintRig,
        "Duet twin, standalone": rigs.DuetRig,
        "Duet twin, SBC": rigs.DuetSbcRig,
    }
    for kind, make in hosts.items():
        with scratch() as folder:
            os.environ["PRINTCTL_HOST_KEY"] = rigs.KEY if make is rigs.OctoPrintRig else ""
            try:
                yield from measure(kind, make, folder, quick)
            except SkippedError as skipped:
                yield {"measure": kind, "skipped": str(skipped)}
