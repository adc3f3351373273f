"""`printctl kill` where the print's link process is gone and the motors may run on."""

from __future__ import annotations

import os

import pytest

from printctl.machine.link.find_link import read_outcome
from printctl.machine.link.journalled_print import read_journal
from printctl.machine.link.record import JOURNAL
from printctl.machine.link.states import LinkState
from tests.printctl.cli.shell import Shell
from tests.printctl.machine.link.fake_marlin import FakeMarlin, pty_printer
from tests.printctl.machine.link.test_host_killed import killed

pytestmark = pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals here")


def test_kill_opens_the_port_and_halts(tmp_path, monkeypatch, capsys):
    shell = Shell(monkeypatch, capsys)
    with pty_printer(FakeMarlin()) as served:
        killed(tmp_path, "generic_marlin", LinkState.PRINTING, port=served.name)
        code, _, err = shell("stop", str(tmp_path))
        assert (code, served.printer.halted) == (1, False)
        assert "printctl kill" in err
        code, out, _ = shell("kill", str(tmp_path))
        assert (code, served.printer.halted) == (0, True)
    assert out.startswith("killed: ")
    assert read_outcome(tmp_path).state is LinkState.KILLED
    assert read_journal(tmp_path / JOURNAL).state is LinkState.KILLED


@pytest.mark.parametrize("mute", [False, True])
def test_kill_that_halts_nothing_says_so(tmp_path, monkeypatch, capsys, mute):
    printer = FakeMarlin()
    printer.mute = mute
    with pty_printer(printer) as served:
        port = served.name if mute else "/dev/nowhere"
        killed(tmp_path, "generic_marlin", LinkState.PRINTING, port=port)
        code, _, err = Shell(monkeypatch, capsys)("kill", str(tmp_path))
    assert code != 0
    assert "cut" in err
    assert "power" in err
    assert read_outcome(tmp_path).state is LinkState.INTERRUPTED  # it may be killed again
