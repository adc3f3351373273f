"""Starting observers: one whose link is dead makes room for another, with its device's program."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from printctl.link.find_link import alive
from printctl.link.process import hold_folder
from printctl.observe import starting
from printctl.observe.records import OBSERVER_LOCK, ORDER, READY

_OBSERVER = """
import signal, sys
from pathlib import Path
from printctl.link.process import hold_folder
from printctl.observe.__main__ import _leave
from printctl.observe.devices import DeviceSettings, acquire
from printctl.observe.records import OBSERVER_LOCK
signal.signal(signal.SIGTERM, _leave)
folder = Path(sys.argv[1])
with hold_folder(folder, OBSERVER_LOCK):
    acquire(DeviceSettings("command", f"sh {folder}/scan.sh {{out}}"), folder / "picture")
"""


@pytest.fixture
def scanning(tmp_path: Path):
    """An observer whose device's program takes long; its folder."""
    (tmp_path / ORDER).touch()
    (tmp_path / "scan.sh").write_text(f"echo $$ >{tmp_path}/program.new\n"
                                      f"mv {tmp_path}/program.new {tmp_path}/program\n"
                                      "sleep 600\n")  # fmt: skip
    process = subprocess.Popen([sys.executable, "-c", _OBSERVER, str(tmp_path)])
    (tmp_path / READY).write_text(f"{process.pid}\n")
    while not (tmp_path / "program").exists():
        assert process.poll() is None
        time.sleep(0.02)
    yield tmp_path
    process.kill()
    process.wait()


@pytest.mark.parametrize("link", ["dead", "alive"])
def test_an_observer_is_replaced_once_its_link_is_dead(scanning, monkeypatch, link):
    started = list[bool]()
    monkeypatch.setattr(starting, "has_looks", lambda _: True)
    monkeypatch.setattr(
        starting, "start_observer", lambda folder, _: started.append(alive(folder, OBSERVER_LOCK))
    )
    program = int((scanning / "program").read_text())
    if link == "alive":
        with hold_folder(scanning):
            starting.ensure_observer(scanning)
        assert not started
        os.kill(program, 0)
        os.killpg(os.getpgid(program), signal.SIGKILL)
        return
    starting.ensure_observer(scanning)
    assert started == [False]
    assert _gone(program)


def _gone(pid: int) -> bool:
    """Whether a process ends soon: it is ended behind the one that has started it."""
    limit = time.monotonic() + 10.0
    while time.monotonic() < limit:
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.02)
    return False
