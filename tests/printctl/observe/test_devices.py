"""Devices by files and commands, and their time limits."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress

import pytest

from printctl.machine.link.find_link import has_ended
from printctl.observe.devices import DeviceError, DeviceSettings, acquire, files_in, picture_of

HANGS = f"{sys.executable} -c 'import time; time.sleep(60)'"


@pytest.mark.parametrize("ahead_s", [0.0, 3600.0, -3600.0])
def test_a_new_file_of_a_folder_is_kept_with_the_look(tmp_path, monkeypatch, ahead_s):
    folder, look = tmp_path / "scans", tmp_path / "0001"
    folder.mkdir()
    look.mkdir()

    def write(name, data):
        (folder / name).write_bytes(data)
        dated = time.time() + ahead_s  # by the clock of the device's computer
        os.utime(folder / name, (dated, dated))

    write("old.png", b"old")

    def listed_then_written(path, tables):
        listed = files_in(path, tables)
        write("new.json", b'{"voxel_mm": [0.01, 0.01, 0.01]}')
        write("new.TIF", b"new")
        write("new.log", b"written last")
        return listed

    monkeypatch.setattr(sys.modules[acquire.__module__], "files_in", listed_then_written)
    found = acquire(DeviceSettings("folder", str(folder)), look / "picture")
    assert found == look / "picture.TIF"
    assert found.read_bytes() == b"new"
    assert sorted(one.name for one in look.iterdir()) == ["picture.TIF", "picture.json"]
    assert len(list(folder.iterdir())) == 4
    assert picture_of(look, "picture") == found


def test_a_profilers_table_is_its_file(tmp_path, monkeypatch):
    folder, look = tmp_path / "scans", tmp_path / "0001"
    folder.mkdir()
    look.mkdir()

    def listed_then_written(path, tables):
        listed = files_in(path, tables)
        (folder / "scan.CSV").write_text("1,2,3\n")
        (folder / "scan.log").write_text("done")
        return listed

    monkeypatch.setattr(sys.modules[acquire.__module__], "files_in", listed_then_written)
    found = acquire(DeviceSettings("folder", str(folder), tables=True), look / "picture")
    assert found == look / "picture.CSV"
    assert picture_of(look, "picture") == found
    (look / "picture.tif").write_bytes(b"heights")
    assert picture_of(look, "picture") == look / "picture.tif"


def test_a_command_writes_the_file(tmp_path):
    words = f"{sys.executable} -c \"open('{{out}}.png', 'w').write('x')\""
    found = acquire(DeviceSettings("command", words), tmp_path / "picture")
    assert found == tmp_path / "picture.png"


def test_what_a_command_writes_beside_its_file_isnt_taken(tmp_path):
    program = tmp_path / "scan.py"
    program.write_text(
        "import sys\nfor end in ('.json', '.raw'): open(sys.argv[1] + end, 'w').write('x')\n"
    )
    words = f"{sys.executable} {program} {{out}}"
    found = acquire(DeviceSettings("command", words), tmp_path / "picture")
    assert found == tmp_path / "picture.raw"


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        (DeviceSettings("folder", "/nowhere"), "isn't there"),
        (DeviceSettings("command", "true {out}"), "wrote no file"),
        (DeviceSettings("command", "false {out}"), "failed"),
        (DeviceSettings("command", f"{HANGS} {{out}}", limit_s=2.0), "within 2 s"),
    ],
)
def test_a_device_that_fails_or_hangs_is_told(tmp_path, settings, said):
    with pytest.raises(DeviceError, match=said):
        acquire(settings, tmp_path / "picture")


@pytest.mark.skipif(not hasattr(os, "killpg"), reason="a process isn't told of its parent's end")
def test_a_devices_program_ends_with_a_killed_observer(tmp_path):
    """It was left behind: two scans at once, once another observer looked."""
    program, began = tmp_path / "scan.py", tmp_path / "pid"
    program.write_text(
        "import os, sys, time\n"
        "open(sys.argv[1], 'w').write(str(os.getpid()))\n"
        "os.rename(sys.argv[1], sys.argv[2])\ntime.sleep(120)\n"
    )
    words = f"{sys.executable} {program} {tmp_path / 'draft'} {began} {{out}}"
    observing = (
        "from pathlib import Path; from printctl.observe.devices import *; "
        f"acquire(DeviceSettings('command', {words!r}), Path({str(tmp_path / 'picture')!r}))"
    )
    observer = subprocess.Popen([sys.executable, "-c", observing])
    try:
        await_true(began.is_file)
    finally:
        observer.kill()
        observer.wait()
    scanner = int(began.read_text())
    try:
        await_true(lambda: has_ended(scanner))
    finally:
        with suppress(ProcessLookupError):
            os.kill(scanner, signal.SIGKILL)


def await_true(tells):
    limit = time.monotonic() + 30
    while not tells():
        assert time.monotonic() < limit
        time.sleep(0.05)
