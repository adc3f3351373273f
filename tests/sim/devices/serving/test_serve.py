"""Simulated printer as a separate process, driven by pyserial through real pipes."""

import contextlib
import os
import select
import signal
import subprocess
import sys
import termios
import time
from pathlib import Path

import pytest
import serial

from gcode.motion.executed import ExecutedMotion
from gcode.program.gcode import checksum
from sim.__main__ import main

REPO = Path(__file__).parents[6]
PATIENCE_S = 60
LAST_OF_BANNER = b"//action:prompt_end"


class Served:
    """A printer process, its address and a port opened to it."""

    def __init__(self, *arguments):
        self.process = subprocess.Popen(
            [sys.executable, "-m", "sim", "--printer", "marlin_avr", *arguments],
            cwd=REPO,
            stdout=subprocess.PIPE,
            text=True,
        )
        self.address = self.process.stdout.readline().strip()
        self.port = None
        self.number = 0

    def open(self, *, banner=True):
        self.port = serial.serial_for_url(self.address, 115200, timeout=PATIENCE_S)
        if banner:
            self.until(LAST_OF_BANNER)
        return self

    def until(self, start):
        """Lines up to the first that begins so."""
        lines = []
        while not lines or not lines[-1].startswith(start):
            line = self.port.readline()
            assert line.endswith(b"\n"), (lines, line)
            lines.append(line.rstrip())
        return lines

    def ask(self, text):
        self.port.write(text.encode() + b"\n")
        return self.until(b"ok")

    def send(self, text):
        self.number += 1
        body = f"N{self.number} {text}".encode()
        self.port.write(b"%s*%d\n" % (body, checksum(body)))
        return self.until(b"ok")

    def end(self):
        self.process.send_signal(signal.SIGTERM)
        return self.process.wait(PATIENCE_S)


@pytest.fixture
def serve(request):
    with contextlib.ExitStack() as stack:

        def start(*arguments):
            served = Served(*arguments)
            stack.callback(served.process.stdout.close)
            stack.callback(served.process.wait, PATIENCE_S)
            stack.callback(served.process.kill)
            stack.callback(lambda: served.port and served.port.close())
            return served

        yield start


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals here")
def test_a_print_through_a_pseudo_terminal_leaves_its_record(serve, tmp_path):
    link, record = tmp_path / "printer", tmp_path / "moved.npz"
    served = serve("--link", str(link), "--record", str(record), "--start", "50,50,0").open()
    assert served.address == str(link)
    served.ask("M302 P1")
    served.ask("M110 N0")
    for k in range(1, 41):
        served.send(f"G1 X{50 + k % 2 * 10} E{k / 10} F1200")
    served.send("M400")
    executed = ExecutedMotion.load(record)
    assert executed.line.tolist() == list(range(40))
    assert executed.start[0].tolist() == [50, 50, 0]
    assert executed.plunger_end[-1] == 4
    served.send("G1 X55")
    assert served.end() == 0
    assert len(ExecutedMotion.load(record)) == 41
    assert not link.is_symlink()


@pytest.mark.skipif(sys.platform != "linux", reason="the ready line is seen on Linux only")
def test_a_reopened_port_resets_the_board_unless_the_hang_up_flag_is_off(serve, tmp_path):
    served = serve("--link", str(tmp_path / "printer")).open()
    served.ask("G92 X7")
    modes = termios.tcgetattr(served.port.fd)
    modes[2] &= ~termios.HUPCL
    termios.tcsetattr(served.port.fd, termios.TCSANOW, modes)
    served.port.close()
    time.sleep(0.1)
    served.open(banner=False)
    assert served.ask("M114")[0].startswith(b"X:7.00")
    modes[2] |= termios.HUPCL
    termios.tcsetattr(served.port.fd, termios.TCSANOW, modes)
    served.port.close()
    time.sleep(0.1)
    served.open()
    assert served.ask("M114")[0].startswith(b"X:0.00")


def test_a_print_over_tcp_at_a_pace_is_halted_by_m112(serve, tmp_path):
    record = tmp_path / "moved.npz"
    served = serve("--tcp", "0", "--speed", "5", "--record", str(record)).open()
    assert served.address.startswith("socket://127.0.0.1:")
    served.send("G1 X100 F600")
    served.port.write(b"M112\n")
    served.until(b"//action:poweroff")
    assert served.end() == 0
    executed = ExecutedMotion.load(record)
    assert 4 < executed.end[-1, 0] < 50  # its motors go on for 0.64 s, as a real Marlin's


def test_an_unplugged_printer_ends_what_it_has_and_keeps_the_record(serve, tmp_path):
    record = tmp_path / "moved.npz"
    served = serve("--record", str(record), "--fault", "unplug@3", "--exit-on-hangup").open()
    served.ask("M110 N0")
    served.send("G1 X5 F600")
    served.send("G1 X10")
    with pytest.raises((OSError, AssertionError)):
        served.send("G1 X15")  # its ok may still get out before the cable does
        served.send("G1 X20")
    assert served.process.wait(PATIENCE_S) == 0
    assert ExecutedMotion.load(record).end[-1, 0] == 15


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks into /proc")
@pytest.mark.parametrize("sign", [signal.SIGTERM, signal.SIGKILL])
@pytest.mark.parametrize("host_comes", [False, True])
def test_a_printer_of_the_command_line_leaves_no_process_behind(sign, host_comes):
    command = [sys.executable, "-m", "printctl", "sim-printer", "--speed", "0"]
    starter = subprocess.Popen(command, cwd=REPO, stdout=subprocess.PIPE, text=True)
    address = starter.stdout.readline().strip()
    children = Path(f"/proc/{starter.pid}/task/{starter.pid}/children").read_text().split()
    port = serial.serial_for_url(address, 115200, timeout=PATIENCE_S) if host_comes else None
    starter.send_signal(sign)
    starter.wait(PATIENCE_S)
    assert children
    assert select.select([starter.stdout], [], [], PATIENCE_S)[0]  # closed by the last one's end
    assert starter.stdout.read() == ""
    starter.stdout.close()
    if port:
        port.close()


@pytest.mark.skipif(sys.platform != "linux", reason="a host's absence is seen on Linux only")
@pytest.mark.parametrize("host_comes", [False, True])
def test_a_printer_lives_as_long_as_its_starter_until_a_host_comes(tmp_path, host_comes):
    record = tmp_path / "moved.npz"
    start = f"""import os, subprocess, sys
words = "--printer marlin_avr --exit-on-hangup --record {record} --parent-pid"
subprocess.Popen([sys.executable, "-m", "sim", *words.split(), str(os.getpid())])
sys.stdin.read()"""
    starter = subprocess.Popen(
        [sys.executable, "-c", start],
        cwd=REPO,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    address = starter.stdout.readline().strip()
    port = serial.serial_for_url(address, 115200, timeout=PATIENCE_S) if host_comes else None
    starter.stdin.close()
    assert starter.wait(PATIENCE_S) == 0
    if port:
        time.sleep(1.0)  # in which it would notice
        port.write(b"M400\n")
        while not port.readline().startswith(b"ok"):
            pass
        port.close()
    assert select.select([starter.stdout], [], [], PATIENCE_S)[0]  # closed by its end
    assert starter.stdout.read() == ""
    starter.stdout.close()
    assert record.is_file()


def test_a_cable_that_is_plugged_in_again_has_its_name_back(serve, tmp_path):
    faults, link = tmp_path / "faults.yaml", tmp_path / "printer"
    faults.write_text("at: [{fault: unplug, line: 2, back_after_s: 0.2}]")
    served = serve("--link", str(link), "--faults", str(faults)).open()
    served.ask("M110 N0")
    served.send("G1 X5 F600")
    with pytest.raises((OSError, AssertionError)):
        served.send("G1 X10")
        served.send("G1 X15")
    served.port.close()
    limit = time.monotonic() + PATIENCE_S
    while not link.exists() and time.monotonic() < limit:
        time.sleep(0.02)
    served.open()  # the ready line rises: this board starts anew
    assert served.ask("M114")[0].startswith(b"X:0.00")
    assert served.end() == 0


def test_a_record_that_can_not_be_written_is_told(serve, tmp_path):
    served = serve("--tcp", "0", "--record", str(tmp_path / "nowhere" / "moved.npz")).open()
    served.port.write(b"M400\n")
    assert served.process.wait(PATIENCE_S) == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--printer", "nonesuch"], "no printer profile 'nonesuch'"),
        (["--printer", "marlin_avr", "--fault", "melt@3"], "fault 'melt@3' isn't one of"),
    ],
)
def test_wrong_use_is_told_and_ends_with_two(capsys, arguments, message):
    told = used_wrongly(capsys, *arguments)
    assert message in told.err
    assert told.out == ""


def used_wrongly(capsys, *arguments):
    """What a printer that doesn't start says."""
    assert main(list(arguments)) == 2
    return capsys.readouterr()
