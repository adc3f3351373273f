"""Transports: data and error behaviour."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading

import pytest
from serial import Serial, SerialException

from firmware_profiles import Printer, load
from printctl.machine.link import transport_serial
from printctl.machine.link.errors import PortDenied, PortError, PortInUse, PortLost, PortMissing
from printctl.machine.link.transport import open_port
from printctl.machine.link.transport_serial import SerialTransport, _refusal

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
from printctl.machine.link.transport_serial import SerialTransport
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
