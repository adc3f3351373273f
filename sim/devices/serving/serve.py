"""Serve the simulated printer on a port: pass bytes both ways, pace its clock, save its motion.

The loop: what the host sends goes to the firmware (`sim.devices.board`), what that says goes back.
At speed 0 the firmware's virtual clock runs as fast as its own waits let it; at speed K it is held
to K times real time; the idle time-out of a board that waits for its host isn't. A board that its
faults make slow, or stall, is so at speed K; at speed 0 a stall isn't felt.

The record of what moved is written before the answer to each M400 leaves, when the firmware is
halted, when the host goes away (its accepted moves are run first, as a printer does) and at the
end.
"""

from __future__ import annotations

import math
import os
import select
import signal
import socket
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Final, NamedTuple

from sim.devices.board.printer import SimulatedPrinter
from sim.devices.serving.port import Port
from sim.errors import ServeError


class Event(NamedTuple):
    """What the port is ready for."""

    readable: bool = False
    hung_up: bool = False


class Waiter:
    """Waits for a file descriptor to be readable (and, where wanted, writable), or for the alarm's.

    Parameters
    ----------
    alarm : int
        A descriptor that ends every wait when it becomes readable.
    """

    def __init__(self, alarm: int) -> None:
        self._alarm = alarm
        self._watched = -1
        self._poll = None if sys.platform == "win32" else select.poll()
        if self._poll is not None:
            self._poll.register(alarm, select.POLLIN)

    def wait(self, port: int, writes: bool, timeout_s: float) -> Event:
        """Wait for ``port`` (negative: for the alarm only); at most ``timeout_s``."""
        if self._poll is None:
            return self._select(port, writes, timeout_s)
        if 0 < timeout_s < TIMES.poll_s:
            self._select(port, writes, timeout_s)
            timeout_s = 0.0  # it tells no hang-up; poll does
        if port != self._watched:
            if self._watched >= 0:
                self._poll.unregister(self._watched)
            if port >= 0:
                self._poll.register(port, select.POLLIN)
            self._watched = port
        if writes and port >= 0:
            self._poll.modify(port, select.POLLIN | select.POLLOUT)
        event = Event()
        for at, flags in self._poll.poll(timeout_s * 1e3):
            if at == port:
                event = Event(bool(flags & select.POLLIN), bool(flags & select.POLLHUP))
        if writes and port >= 0:
            self._poll.modify(port, select.POLLIN)
        return event

    def _select(self, port: int, writes: bool, timeout_s: float) -> Event:
        ports = [port] if port >= 0 else []
        ready, _, _ = select.select([*ports, self._alarm], ports if writes else [], [], timeout_s)
        return Event(port in ready)

    def forget(self) -> None:
        """The port was closed."""
        if self._watched >= 0 and self._poll is not None:
            self._poll.unregister(self._watched)
        self._watched = -1


class ServeTimes(NamedTuple):
    """Waits of the serving process, s."""

    # Real time between a reset by the port's opening and the first word, so that a host that
    # empties its buffers after opening doesn't miss it.
    boot_s: float = 0.05
    absent_s: float = 0.01
    watch_s: float = 0.5
    tick_s: float = 0.002
    poll_s: float = 2e-3  # `poll` rounds shorter times up to whole milliseconds.


TIMES: Final = ServeTimes()


@dataclass(frozen=True)
class Serving:
    """Options of serving a simulated printer.

    Attributes
    ----------
    speed : float
        Times real time; 0 for as fast as possible.
    record : Path or None
        Where the executed motion goes.
    exit_on_hangup : bool
        Whether to end when the host goes away.
    parent_pid : int or None
        Process that started this one; its end is this one's, too. With ``exit_on_hangup`` that
        holds until a host has come.
    linger_s : float
        With ``exit_on_hangup``: how long to wait, once, for another host, as a printer does whose
        cable was pulled. A host that closes in order deletes the file that stdout goes to.
    """

    speed: float = 0.0
    record: Path | None = None
    exit_on_hangup: bool = False
    parent_pid: int | None = None
    linger_s: float = 0.0


class Server:
    """Loop between a port and the firmware."""

    def __init__(self, printer: SimulatedPrinter, port: Port, serving: Serving) -> None:
        self._printer = printer
        self._port = port
        self._serving = serving
        printer.machine.host_pace = serving.speed or 1.0
        self._outbox = b""
        self._host_there = self._host_came = False
        self._port_there = True
        self._boots_at: float | None = None
        self._plugs_in_at = math.inf
        self._synced = 0
        self._was_halted = False
        self._stop = False
        self._alone_since: float | None = None
        self._lingers = serving.linger_s > 0
        self._zero = time.monotonic()

    def run(self) -> None:
        """Serve until stopped by a signal; the record is written whatever happens.

        Raises
        ------
        ServeError
            When the record can't be written.
        """
        try:
            with _stopped_by_signals(self._ask_to_stop) as wake:
                self._loop(wake)
        finally:
            if self._port_there:
                self._port.close()
            self._let_go()

    def _ask_to_stop(self) -> None:
        self._stop = True

    def _loop(self, alarm: int) -> None:
        waiter = Waiter(alarm)
        watched = time.monotonic()
        while not self._stop:
            port = self._port.fileno() if self._port_there else -1
            event = waiter.wait(port, bool(self._outbox), self._patience_s())
            if self._port_there and not self._turn(event):
                waiter.forget()
                self._unplug()
            now = time.monotonic()
            if now >= self._plugs_in_at:
                self._plug_in()
            if now - watched > TIMES.watch_s:
                watched = now
                self._stop |= self._orphaned() or not self._waits()

    def _patience_s(self) -> float:
        paced = self._serving.speed > 0 and not self._printer.halted
        if self._boots_at is not None or not math.isinf(self._plugs_in_at):
            return TIMES.tick_s
        if paced:
            wakes_s = self._printer.pace.host_time(self._printer.wakes_s) - self._host_s()
            return min(max(wakes_s / self._serving.speed, 0.0), TIMES.tick_s)
        return min(TIMES.watch_s, max(self._printer.bad_line.next_s - time.monotonic(), 0.0))

    def _turn(self, event: Event) -> bool:
        """One round: who is there, what came, what goes. False when the port was pulled out."""
        there = self._port.connected(event.hung_up)
        if there != self._host_there:
            self._host_there = there
            self._on_change(there)
        if not there:
            self._pace(b"")
            self._outbox = b""
            if event.hung_up:
                time.sleep(TIMES.absent_s)
            return True
        if self._boots_at is not None:
            if time.monotonic() < self._boots_at:
                return True
            self._boots_at = None
            self._printer.reset()
        line = self._printer.bad_line
        self._pace(line.down(self._port.read()) if event.readable else b"")
        while data := line.due(time.monotonic()):
            self._outbox += data
        if self._outbox:
            self._outbox = self._outbox[self._port.write(self._outbox) :]
        return not self._printer.unplugged

    def _on_change(self, there: bool) -> None:
        if there:
            self._host_came = True
            if self._alone_since is not None:
                self._lingers, self._alone_since = False, None
            wants = self._printer.machine.printer.resets_on_connect
            if self._port.resets_board() and wants:
                self._boots_at = time.monotonic() + TIMES.boot_s
            return
        self._let_go()
        if self._serving.exit_on_hangup:
            self._stop = not self._lingers
            self._alone_since = time.monotonic()

    def _waits(self) -> bool:
        """Whether to wait on for a host, where one has gone."""
        if self._alone_since is None:
            return True
        alone_s = time.monotonic() - self._alone_since
        return os.fstat(1).st_nlink > 0 and alone_s < self._serving.linger_s

    def _pace(self, data: bytes) -> None:
        """Give the firmware its bytes and its time; keep the record."""
        printer = self._printer
        if self._serving.speed > 0:
            printer.receive(data)
            until = printer.pace.board_time(self._host_s())
            printer.run_to(until)
            if printer.now > until and not printer.halted:
                return  # what it says, it says later
        elif data:
            printer.bad_line.up(printer.exchange(data), time.monotonic())
            if printer.dead:
                printer.finish()
        printer.bad_line.up(printer.take_output(), time.monotonic())
        if printer.synced != self._synced or printer.halted != self._was_halted:
            self._synced = printer.synced
            self._was_halted = printer.halted
            self._save()

    def _host_s(self) -> float:
        """The host's clock as often as the board's is sped up, s."""
        return (time.monotonic() - self._zero) * self._serving.speed

    def _unplug(self) -> None:
        """The line to the host is gone; the printer goes on with what it has."""
        self._port.close()
        self._port_there = False
        self._host_there = False
        self._outbox = b""
        self._printer.bad_line.clear()
        self._let_go()
        after_s, self._printer.back_after_s = self._printer.back_after_s, None
        if after_s is not None:
            self._plugs_in_at = time.monotonic() + after_s
        elif self._serving.exit_on_hangup:
            self._stop = True

    def _plug_in(self) -> None:
        """The cable is back, under the same name; a board may reset at that (its profile says)."""
        self._port = self._port.again()
        self._port_there, self._printer.unplugged = True, False
        self._plugs_in_at = math.inf

    def _let_go(self) -> None:
        """The host has gone: run what was accepted, keep the record."""
        self._printer.finish()
        self._printer.take_output()
        self._save()

    def _save(self) -> None:
        record = self._serving.record
        if record is None:
            return
        try:
            self._printer.executed().save(record)
        except OSError as exc:
            raise ServeError(
                f"can't write the record {record}: {exc.strerror}; free space there or give "
                "another --record path"
            ) from exc

    def _orphaned(self) -> bool:
        """Whether the process that started this one ended, and no host keeps it."""
        pid, kept = self._serving.parent_pid, self._serving.exit_on_hangup and self._host_came
        return pid is not None and not kept and os.getppid() != pid


@contextmanager
def _stopped_by_signals(stop: Callable[[], None]) -> Iterator[int]:
    """Call ``stop`` on SIGTERM and SIGINT; yields a file descriptor that ends a wait."""
    reader, writer = socket.socketpair()
    writer.setblocking(False)

    def on_signal(number: int, frame: FrameType | None) -> None:
        stop()

    before = signal.set_wakeup_fd(writer.fileno(), warn_on_full_buffer=False)
    handlers = {sig: signal.signal(sig, on_signal) for sig in (signal.SIGTERM, signal.SIGINT)}
    try:
        yield reader.fileno()
    finally:
        for sig, handler in handlers.items():
            signal.signal(sig, handler)
        signal.set_wakeup_fd(before)
        reader.close()
        writer.close()
