"""Another program that has the printer's serial port open, over a real pseudo-terminal."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from printctl.machine.link import LinkState, start_print
from printctl.machine.link.journalled_print import read_journal
from tests.printctl.machine.link.fake_marlin import FakeMarlin, pty_printer, write_job

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="programs are looked for on Linux")
THIEF = """
import os, sys
port = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
print("open", flush=True)
sys.stdin.readline()
taken = 0
os.write(port, b"".join(line.encode() + b"\\n" for line in sys.argv[2:]))
while taken < 3:
    taken += bool(os.read(port, 4096))
sys.stdin.readline()
"""


@contextmanager
def thief(port: str, *writes: str) -> Iterator[subprocess.Popen[str]]:
    """Open the port in another process; it takes three answers once told to."""
    command = [sys.executable, "-c", THIEF, port, *writes]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "open\n"
        yield process
        process.kill()


def tell(process: subprocess.Popen[str]) -> None:
    assert process.stdin is not None
    process.stdin.write("\n")
    process.stdin.flush()


@pytest.mark.parametrize("writes", [(), ("M105",)])
def test_program_that_reads_the_port_is_named_and_the_print_paused_once(tmp_path, profile, writes):
    write_job(tmp_path / "job.gcode", 400)
    with pty_printer(FakeMarlin(), pace_s=0.02) as served, thief(served.name, *writes) as process:
        run = tmp_path / "run"
        client = start_print(tmp_path / "job.gcode", profile, served.name, run)
        pauses: list[str] = []
        told = False
        for status in client.events():
            if status.lines_done > 50 and not told:
                told = True
                tell(process)
            if status.state is LinkState.PAUSED:
                pauses.append(status.message)
                client.resume()
        outcome = client.wait(300)
    name = f"pid {process.pid}) has this port open"
    assert outcome.state is LinkState.DONE
    assert len(pauses) == 1
    assert name in pauses[0]
    assert any(name in text for text in read_journal(run / "journal.log").alarms)
