"""Transports: data and error behaviour."""

from __future__ import annotations

import contextlib
import json
import os
import re
import select
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from serial import Serial, SerialException
from typer.testing import CliRunner

from firmware_profiles import Printer, load
from firmware_profiles.families.marlin.state import QUESTION
from printctl.cli.machine import station as ports_command
from printctl.cli.main import app
from printctl.machine.control.board.shell import drive
from printctl.machine.control.board.steps import Record, Steps, Urgent, carried_out
from printctl.machine.control.board.wiring import Wiring
from printctl.machine.errors import (
    HandshakeError,
    PortDenied,
    PortError,
    PortInUse,
    PortLost,
    PortMissing,
)
from printctl.machine.ports import detection
from printctl.machine.ports import serial_port as transport_serial
from printctl.machine.ports.clock import RealClock, VirtualClock
from printctl.machine.ports.detection import AUTO, PortInfo, choose_port, matches, rates_to_try
from printctl.machine.ports.serial_port import SerialTransport, _refusal
from printctl.machine.ports.transport import Transport, open_port, sweep
from printctl.machine.ports.wire_log import LoggedTransport, WireLog
from printctl.machine.process.clients.starting import start_print
from printctl.machine.process.orders import Order
from printctl.machine.records.states import LinkState
from tests.printctl.machine.control.bench import MemoryJournal
from tests.printctl.machine.link.fake_families import FakeDuet, FakeKlipper
from tests.printctl.machine.link.fake_marlin import FakeMarlin, write_job

PRINTER = load(Printer, "generic_marlin")
needs_pty = pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals here")


@needs_pty
def test_serial_port_reads_writes_and_notices_the_unplugging():
    import termios

    master, slave = os.openpty()
    wire = SerialTransport(os.ttyname(slave), 115_200)
    assert not termios.tcgetattr(slave)[2] & termios.HUPCL
    wire.write(b"N1 M105*38\n")
    assert os.read(master, 100) == b"N1 M105*38\n"
    wire.write_urgent(b"\nM112\n")
    assert os.read(master, 100) == b"\nM112\n"
    os.write(master, b"ok\n")
    assert wire.read(1.0) == b"ok\n"
    assert wire.read(0.0) == b""
    os.close(slave)
    os.close(master)
    with pytest.raises(PortLost, match="went away"):
        wire.read(1.0)
    with pytest.raises(PortLost):
        wire.write(b"x")
    wire.close()
    wire.close()
    with pytest.raises(PortLost):
        wire.read(0.0)


def test_port_is_held_by_one_program_alone(pty):
    _, slave = pty
    wire = SerialTransport(os.ttyname(slave), 115_200)
    with pytest.raises(PortInUse, match="another program"):
        SerialTransport(os.ttyname(slave), 115_200)
    wire.close()


def test_tcp_port_is_held_by_one_program_alone_under_whatever_name():
    listener = socket.create_server(("127.0.0.1", 0))
    port = listener.getsockname()[1]
    wire = open_port(f"tcp:127.0.0.1:{port}", PRINTER)
    for name in (f"tcp:127.0.0.1:{port}", f"socket://localhost:{port}"):
        with pytest.raises(PortInUse, match="another printctl on this machine"):
            open_port(name, PRINTER)
    listener.accept()[0].close()
    listener.settimeout(0.05)
    with pytest.raises(TimeoutError):  # whoever was refused hasn't called
        listener.accept()
    wire.close()
    wire.close()
    open_port(f"tcp:localhost:{port}", PRINTER).close()
    listener.close()
    for _ in range(2):
        with pytest.raises(PortMissing, match="nobody answers"):
            open_port(f"tcp:127.0.0.1:{port}", PRINTER)


def test_halt_on_a_full_connection_leaves_whole():
    listener = socket.create_server(("127.0.0.1", 0))
    wire = open_port(f"tcp:127.0.0.1:{listener.getsockname()[1]}", PRINTER)
    printer = listener.accept()[0]
    filled = 0
    while select.select([], [wire._socket], [], 0.2)[1]:
        with contextlib.suppress(BlockingIOError):
            filled += wire._socket.send(bytes(65536))
    with pytest.raises(BlockingIOError):  # room for less than `select` counts
        while True:
            filled += wire._socket.send(b"\0")
    with pytest.raises(PortLost, match=r"took no byte for 0\.5 s"):
        wire.write_halt(b"\nM112\n")
    urgent = threading.Thread(target=wire.write_halt, args=(b"\nM112\n",))
    urgent.start()
    heard = b""
    while not heard.endswith(b"\nM112\n"):
        heard += printer.recv(65536)
    urgent.join()
    assert heard == bytes(filled) + b"\nM112\n"
    for one in (printer, wire, listener):
        one.close()


def test_halt_is_not_mixed_with_a_line_that_is_being_written(monkeypatch):
    class TakesTwoBytes:
        taken, full = b"", False

        def send(self, data: bytes) -> int:
            self.full = not self.full
            if not self.full:
                raise BlockingIOError
            self.taken += data[:2]
            return len(data[:2])

    listener = socket.create_server(("127.0.0.1", 0))
    wire = open_port(f"tcp:127.0.0.1:{listener.getsockname()[1]}", PRINTER)
    with monkeypatch.context() as patch:
        slow, urgent = TakesTwoBytes(), [b"\nM112\n"]

        def select_after_a_kill(read, write, other, timeout):
            if urgent:
                wire.write_halt(urgent.pop())
            return read, write, other

        patch.setattr(wire, "_socket", slow)
        patch.setattr(select, "select", select_after_a_kill)
        wire.write(b"N1 G1 X5*33\n")
        assert slow.taken == b"N1\nM112\n"
    wire.close()
    listener.close()


@needs_pty
@pytest.mark.parametrize("kind", ["serial", "tcp"])
def test_no_byte_leaves_behind_a_halt_but_another_halt(kind, tmp_path):
    """A line was on its way to the port when the halt came: its record was being written."""
    with wire_of(kind) as (wire, heard):
        log = WireLog()
        logged = LoggedTransport(wire, log)

        class Journal(MemoryJournal):
            def add(self, sort: str, **values: Any) -> None:
                logged.write_halt(b"\nM410\n")

        def steps() -> Steps[None]:
            wiring.exchange.effects.extend([Record("state", {}), b"N87 G1 X148*61\n"])
            wiring.exchange.effects.append(Urgent(b"\nM108\n"))
            yield from carried_out()

        wiring = Wiring(logged, None, RealClock(), Journal(), PRINTER)  # type: ignore[arg-type]
        drive(steps(), wiring)
        assert heard() == b"\nM410\n"
        logged.write_halt(b"\nM112\n")
        assert heard() == b"\nM112\n"
        log.keep(tmp_path / "wire.log")
        assert (tmp_path / "wire.log").read_text().count("didn't leave") == 2


@contextlib.contextmanager
def wire_of(kind: str) -> Iterator[tuple[Transport, Callable[[], bytes]]]:
    """A port with an end at which all that has come is read."""
    if kind == "serial":
        master, slave = os.openpty()
        wire = SerialTransport(os.ttyname(slave), 115_200)
        try:
            yield wire, lambda: os.read(master, 1000)
        finally:
            wire.close()
            os.close(master)
            os.close(slave)
        return
    with socket.create_server(("127.0.0.1", 0)) as listener:
        tcp = open_port(f"tcp:127.0.0.1:{listener.getsockname()[1]}", PRINTER)
        with listener.accept()[0] as printer:
            try:
                yield tcp, lambda: printer.recv(1000)
            finally:
                tcp.close()


@pytest.mark.parametrize(("dtr", "rts"), [(True, True), (False, True), (False, False)])
def test_modem_lines_are_as_the_profile_says_before_the_port_opens(monkeypatch, dtr, rts):
    lines = []

    class Spy(Serial):
        def open(self) -> None:
            lines.append((self.port, self.dtr, self.rts))
            raise SerialException(2, "no such port")

    monkeypatch.setattr(transport_serial.serial, "Serial", Spy)
    facts = PRINTER.model_copy(update={"dtr": dtr, "rts": rts})
    with pytest.raises(PortMissing):
        open_port("/dev/board", facts)
    assert lines == [("/dev/board", dtr, rts)]


def test_rate_is_changed_while_the_port_is_open(pty):
    import termios

    master, slave = pty
    wire = SerialTransport(os.ttyname(slave), 115_200)
    os.write(master, b"from another rate")
    wire.set_baud(57_600)
    assert termios.tcgetattr(slave)[5] == termios.B57600
    assert not termios.tcgetattr(slave)[2] & termios.HUPCL
    assert wire.read(0.0) == b""
    wire.close()


def test_kill_while_the_port_is_closed_writes_to_the_port_or_nowhere(pty, monkeypatch):
    master, slave = pty
    wire = SerialTransport(os.ttyname(slave), 115_200)
    drop = wire._serial.reset_output_buffer
    closing = threading.Thread(target=wire.close)

    def dropping() -> None:
        drop()
        closing.start()
        closing.join(0.2)  # what is closed now could be another file's when it is written to

    monkeypatch.setattr(wire._serial, "reset_output_buffer", dropping)
    wire.write_halt(b"\nM112\n")
    assert os.read(master, 100) == b"\nM112\n"
    closing.join(5)
    monkeypatch.setattr(wire._serial, "reset_output_buffer", drop)
    with pytest.raises(PortLost):
        wire.write_halt(b"\nM112\n")


def test_refusals_name_the_remedy():
    assert "usermod -aG dialout" in str(_refusal("/dev/x", SerialException(13, "denied")))
    assert isinstance(_refusal("/dev/x", SerialException(13, "denied")), PortDenied)
    with pytest.raises(PortMissing, match="ports found"):
        open_port("/dev/does-not-exist", PRINTER)
    with pytest.raises(PortError, match="isn't tcp:HOST:PORT"):
        open_port("tcp:nowhere", PRINTER)


@pytest.mark.parametrize("form", ["tcp:127.0.0.1:{}", "socket://127.0.0.1:{}"])
def test_tcp_reads_writes_and_notices_the_end(form):
    with socket.create_server(("127.0.0.1", 0)) as server:
        wire = open_port(form.format(server.getsockname()[1]), PRINTER)
        far, _ = server.accept()
        big = b"x" * 3_000_000
        received = bytearray()

        def receive() -> None:
            while len(received) < len(big):
                received.extend(far.recv(65536))

        thread = threading.Thread(target=receive)
        thread.start()
        wire.write(big)
        thread.join(10)
        assert bytes(received) == big
        far.sendall(b"ok\n")
        assert wire.read(5.0) == b"ok\n"
        assert wire.read(0.0) == b""
        assert not wire.reset()
        far.close()
        with pytest.raises(PortLost):
            wire.read(5.0)
        wire.close()


@pytest.mark.skipif(
    sys.platform != "linux" or os.geteuid() != 0, reason="needs another user's program, on Linux"
)
def test_other_users_programs_are_kept_out_until_the_port_is_closed(pty):
    _, slave = pty
    name = os.ttyname(slave)
    os.chmod(name, 0o666)

    def opens() -> bool:
        command = ["/bin/sh", "-c", f": 3<>{name}"]
        return subprocess.run(command, user=65534, stderr=subprocess.DEVNULL).returncode == 0

    assert opens()
    wire = SerialTransport(name, 115_200)
    assert not opens()
    wire.close()
    assert opens()


HOLDER = """
import os, signal, sys
from printctl.machine.ports.serial_port import SerialTransport
if os.geteuid() == 0:
    os.setuid(65534)
wire = SerialTransport(sys.argv[1], 115_200)
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="a pseudo-terminal of Linux")
def test_host_that_is_killed_locks_nobody_out_of_a_pseudo_terminal():
    master, slave = os.openpty()
    name = os.ttyname(slave)
    os.chmod(name, 0o666)
    os.close(slave)
    for _ in range(2):
        command = [sys.executable, "-c", HOLDER, name]
        done = subprocess.run(command, capture_output=True, text=True)
        assert done.returncode == -signal.SIGKILL, done.stderr
    os.close(master)


def test_file_that_is_no_port_is_refused(tmp_path):
    path = tmp_path / "file"
    path.write_text("x")
    with pytest.raises(PortError, match="serial port"):
        open_port(str(path), PRINTER)


# --- port and baud rate detection; nothing that moves is sent
MEGA = PortInfo("/dev/ttyACM0", "Arduino Mega", "2341:0042", "7583")
TWIN = PortInfo("/dev/ttyACM1", "Arduino Mega", "2341:0042", "9911")
OTHER = PortInfo("/dev/ttyS0", "ttyS0", "", "")


def with_ids(*ids: str) -> Printer:
    return PRINTER.model_copy(update={"usb_ids": ids})


# --- the port
def test_two_alike_are_refused_with_both_named_unless_the_serial_number_tells_them_apart():
    with pytest.raises(PortError, match=r"several ports.*ttyACM0 .*7583.*ttyACM1 .*9911.*--port"):
        choose_port(with_ids("2341:0042"), [MEGA, TWIN, OTHER])
    assert choose_port(with_ids("2341:0042:9911"), [MEGA, TWIN]) == "/dev/ttyACM1"


def test_none_is_refused_with_what_there_is():
    with pytest.raises(PortMissing, match=r"no port has a USB id .*27b1:0001.*ttyACM0.*ttyS0"):
        choose_port(with_ids("27b1:0001"), [MEGA, OTHER])
    with pytest.raises(PortMissing, match=r"has no USB id.*ttyACM0"):
        choose_port(with_ids(), [MEGA])
    assert not matches(with_ids(), OTHER)


# --- the rate
class Line:
    """A wire that reads well at one rate; at others both sides hear noise."""

    def __init__(self, printer, rate: int, clock: VirtualClock, boots_until: float = -1.0) -> None:
        self.printer, self.rate, self.clock = printer, rate, clock
        self.rng, self.at, self.opened = np.random.default_rng(0), 0, 0
        self.boots_until, self.tried, self.waiting = boots_until, [], b""

    def set_baud(self, baud: int) -> None:
        self.at, self.waiting = baud, b""
        self.tried.append(baud)

    def write(self, data: bytes) -> None:
        if self.clock.now() < self.boots_until:
            return
        if self.at != self.rate:
            data = self.rng.bytes(len(data))
        said = self.printer.receive(data)
        self.waiting += said if self.at == self.rate else self.rng.bytes(30)

    def read(self, timeout: float) -> bytes:
        if not self.waiting and 0 < self.boots_until - self.clock.now() <= timeout:
            self.waiting = b"start\n"
            timeout = self.boots_until - self.clock.now()
        data, self.waiting = self.waiting, b""
        self.clock.sleep(0.001 if data and self.boots_until < 0 else timeout)
        return data


@pytest.mark.parametrize("make", [FakeMarlin, FakeDuet, FakeKlipper])
@pytest.mark.parametrize("rate", [250_000, 115_200, 57_600])
def test_rate_is_found_by_a_valid_answer_of_any_family(make, rate):
    printer, clock = make(), VirtualClock()
    line = Line(printer, rate, clock)
    assert sweep(line, rates_to_try(PRINTER), clock, resets=False) == rate
    assert line.tried[0] == PRINTER.baud  # the profile's own comes first
    assert len(set(line.tried)) == len(line.tried)
    assert not [line for line in printer.executed if re.match(r"[GT]\d|M(?!105)\d", line)]


def test_board_that_resets_is_given_time_to_start():
    clock = VirtualClock()
    line = Line(FakeMarlin(), 115_200, clock, boots_until=1.7)
    assert sweep(line, (115_200, 250_000), clock, resets=True) == 115_200
    assert line.tried == [115_200]


def test_silence_at_all_rates_is_told_with_the_rates():
    clock = VirtualClock()
    line = Line(FakeMarlin(), 9_600, clock)
    with pytest.raises(HandshakeError, match=r"115200, 250000, 500000, 1000000, 57600 Bd .*heard"):
        sweep(line, rates_to_try(PRINTER), clock, resets=True)
    assert clock.now() < 20


def sampled(data: bytes, sent_at: int, read_at: int) -> bytes:
    """What a UART at one rate reads of bytes sent at another: start, eight bits, stop."""
    levels = [1] * 20
    for byte in data:
        levels += [0, *(byte >> k & 1 for k in range(8)), 1]
    levels += [1] * 400
    ratio, out, at = sent_at / read_at, bytearray(), 0.0
    while (begin := next((k for k in range(int(at), len(levels)) if not levels[k]), -1)) >= 0:
        start = max(at, float(begin))
        bits = [levels[min(int(start + (k + 0.5) * ratio), len(levels) - 1)] for k in range(10)]
        if not bits[0]:
            out.append(sum(bit << k for k, bit in enumerate(bits[1:9])))
        at = start + 9.5 * ratio
    return bytes(out)


def test_question_at_a_wrong_rate_reads_as_no_command():
    rates = [9600, 19200, 38400, 57600, 115200, 230400, 250000, 500000, 921600, 1000000, 2000000]
    assert sampled(QUESTION, 115_200, 115_200) == QUESTION
    for sent_at in rates:
        for read_at in rates:
            if sent_at != read_at:
                heard = sampled(QUESTION, sent_at, read_at)
                assert not re.search(rb"[GMTgmt]\s*\d", heard), (sent_at, read_at, heard)


# --- through a real port
@pytest.mark.skipif(sys.platform != "linux", reason="a terminal's rate is looked up as on Linux")
def test_auto_port_and_rate_start_a_print(tmp_path, monkeypatch, profile):
    import termios

    master, slave = os.openpty()
    printer, over, seen = FakeMarlin(), threading.Event(), []

    def serve() -> None:
        while not over.is_set():
            if select.select([master], [], [], 0.02)[0]:
                data = os.read(master, 4096)
                seen.append(termios.tcgetattr(slave)[5])
                right = seen[-1] == termios.B57600
                os.write(master, printer.receive(data) if right else b"\x80\xff\x00\x91")

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    port = PortInfo(os.ttyname(slave), "board", "2341:0042", "1")
    monkeypatch.setattr(detection, "list_ports", lambda: [OTHER, port])
    write_job(tmp_path / "job.gcode", 20)
    try:
        client = start_print(
            Order(tmp_path / "job.gcode", profile, AUTO, tmp_path / "run", baud=AUTO)
        )
        assert client.wait(300).state is LinkState.DONE
        assert (client.record.port, client.record.baud) == (port.device, 57_600)
    finally:
        over.set()
        thread.join(2.0)
        os.close(slave)
        os.close(master)
    assert len(set(seen)) > 1


def test_command_lists_ports_with_ids_and_the_profiles_they_match(monkeypatch):
    monkeypatch.setattr(ports_command, "list_ports", lambda: [MEGA, OTHER])
    run = CliRunner().invoke
    first, second = run(app, ["ports"]).stdout.splitlines()
    told = first.split("\t")
    assert told[:4] == ["/dev/ttyACM0", "2341:0042", "7583", "Arduino Mega"]
    assert "generic_marlin" in told[4]
    assert second.split("\t")[1:] == ["-", "-", "ttyS0", "no profile's"]
    found = json.loads(run(app, ["ports", "--json"]).stdout)["ports"]
    assert found[0]["usb_id"] == "2341:0042"
    assert "marlin_avr" in found[0]["profiles"]
    assert run(app, ["ports", "--find"]).exit_code == 2
