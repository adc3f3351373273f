"""Ctrl-C during a print on a real terminal: asks to detach, stop or kill."""

import os
import pty
import re
import select
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from printctl.machine.link.client import attach
from tests.sim_process import printer_process
from tests.system.cli import ROOT


@pytest.fixture
def port(tmp_path: Path) -> Iterator[str]:
    with printer_process(tmp_path, speed=3) as name:
        yield name


@pytest.fixture
def job(tmp_path: Path) -> Path:
    lines = ["G21", "G90", "M82", "M302 P1", "G92 X0 Y0 Z0 E0"]
    lines += [f"G1 X{5 * (k % 2)} E{0.001 * k:.4f} F3000" for k in range(1, 5001)]
    path = tmp_path / "job.gcode"
    path.write_text("\n".join([*lines, "M400"]) + "\n")
    return path


class Terminal:
    """``printctl print`` as a person sees it."""

    def __init__(self, job: Path, port: str) -> None:
        self.pid, self.handle = pty.fork()
        if self.pid == 0:
            os.chdir(ROOT)
            command = [sys.executable, "-m", "printctl", "print", str(job), "--yes"]
            os.execv(sys.executable, [*command, "--printer", "generic_marlin", "--port", port])
        self.seen = ""

    def expect(self, pattern: str, within_s: float = 60) -> None:
        """Read until ``pattern`` is on the screen; then forget what came before it."""
        limit = time.monotonic() + within_s
        while not (found := re.search(pattern, self.seen)):
            assert time.monotonic() < limit, f"{pattern!r} not in {self.seen[-2000:]!r}"
            if select.select([self.handle], [], [], 0.5)[0]:
                try:
                    self.seen += os.read(self.handle, 65536).decode(errors="replace")
                except OSError:
                    raise AssertionError(
                        f"ended without {pattern!r}: {self.seen[-2000:]!r}"
                    ) from None
        self.seen = self.seen[found.end() :]

    def type(self, keys: str) -> None:
        os.write(self.handle, keys.encode())

    def exit_code(self) -> int:
        while True:
            try:
                if not os.read(self.handle, 65536):
                    break
            except OSError:
                break
        return os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])


def test_detach_leaves_it_printing_and_stop_ends_it_in_order(job: Path, port: str) -> None:
    first = Terminal(job, port)
    first.expect(r"[1-9]\d* of 5006 lines")
    first.type("\x03")
    first.expect("detach")
    first.type("d\n")
    first.expect("detached; the print goes on")
    assert first.exit_code() == 1

    again = Terminal(job, port)
    again.expect(r"[1-9]\d* of 5006 lines")
    again.type("\x03")
    again.expect("stop")
    again.type("s\n")
    again.expect("ended as stopped")
    assert again.exit_code() == 4
    left = attach(job.with_name("job.gcode.print")).status
    assert left.position_known
    assert 0 < left.lines_done < 5006


def test_kill_halts_the_printer(job: Path, port: str) -> None:
    terminal = Terminal(job, port)
    terminal.expect(r"[1-9]\d* of 5006 lines")
    terminal.type("\x03")
    terminal.expect("kill")
    terminal.type("k\n")
    terminal.expect("ended as killed")
    assert terminal.exit_code() == 4
    assert not attach(job.with_name("job.gcode.print")).status.position_known
