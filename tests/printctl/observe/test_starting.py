"""Starting observers: one whose link is dead makes room for another, with its device's program."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import nullcontext, suppress
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from printctl.machine.link.errors import LinkError
from printctl.machine.link.find_link import alive, has_ended
from printctl.machine.link.process import hold_folder
from printctl.machine.link.record import RECORD
from printctl.observe import starting
from printctl.observe.deciding import Limits
from printctl.observe.devices import DeviceError, DeviceSettings, acquire, files_in, picture_of
from printctl.observe.order import ObserverOrder
from printctl.observe.process import try_device
from printctl.observe.records import OBSERVER_LOCK, ORDER, READY, look_folder
from printctl.observe.view_before import EMPTY
from sim.gcode.motion.executed import ExecutedMotion

_OBSERVER = """
import signal, sys
from pathlib import Path
from printctl.machine.link.process import hold_folder
from printctl.observe.__main__ import _leave
from printctl.observe.devices import DeviceSettings, acquire
from printctl.observe.records import OBSERVER_LOCK
signal.signal(signal.SIGTERM, _leave)
folder = Path(sys.argv[1])
with hold_folder(folder, OBSERVER_LOCK):
    acquire(DeviceSettings("command", f"sh {folder}/scan.sh {{out}}"), folder / "picture")
"""


@pytest.fixture(scope="module")
def scanning(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Folder of an observer whose device's program takes long, until the last test ends it."""
    folder = tmp_path_factory.mktemp("scanning")
    (folder / ORDER).touch()
    (folder / "scan.sh").write_text(f"echo $$ >{folder}/program.new\n"
                                    f"mv {folder}/program.new {folder}/program\n"
                                    "sleep 600\n")  # fmt: skip
    process = subprocess.Popen([sys.executable, "-c", _OBSERVER, str(folder)])
    (folder / READY).write_text(f"{process.pid}\n")
    while not (folder / "program").exists():
        assert process.poll() is None
        time.sleep(0.02)
    yield folder
    process.terminate()  # its device's program with it
    process.wait()


@pytest.mark.parametrize("link", ["awaited", "alive", "dead"])
def test_an_observer_is_replaced_once_its_link_is_dead(
    scanning: Path, monkeypatch: pytest.MonkeyPatch, link: str
) -> None:
    started = list[bool]()
    monkeypatch.setattr(starting, "has_looks", lambda _: True)
    monkeypatch.setattr(
        starting, "start_observer", lambda folder, _: started.append(alive(folder, OBSERVER_LOCK))
    )
    _begin(scanning, seconds_after_ready=-1 if link == "awaited" else 1)
    with hold_folder(scanning) if link == "alive" else nullcontext():
        starting.ensure_observer(scanning)
    assert started == [True] * (link == "dead")


def test_a_left_over_observer_is_ended_with_its_devices_program(
    scanning: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = int((scanning / "program").read_text())
    free = list[bool]()

    def spawned(*_: object) -> None:
        free.append(not alive(scanning, OBSERVER_LOCK))
        raise LinkError("far enough")

    monkeypatch.setattr(starting, "spawn", spawned)
    _begin(scanning, seconds_after_ready=-1)
    with pytest.raises(starting.ObserverError, match="at work"):
        starting.start_observer(scanning)
    os.kill(program, 0)
    _begin(scanning, seconds_after_ready=1)
    with pytest.raises(starting.ObserverError, match="far enough"):
        starting.start_observer(scanning)
    assert free == [True]
    assert _gone(program)


def _begin(folder: Path, seconds_after_ready: float) -> None:
    """Leave a link's record as of a print that began before or after the observer was ready."""
    ready, record = folder / READY, folder / RECORD
    record.touch()
    at = ready.stat().st_mtime + seconds_after_ready
    os.utime(record, (at, at))


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


# --- a print's device is tried before anything moves, and the empty dish is kept
CAMERA = {
    "camera": {"size_px": [60, 40], "um_per_px": 100, "target_mm": [50, 40, 1]},
    "scene": {
        "bath": {"texture": 0, "colour": [100, 100, 100]},
        "ink": {"colour": [220, 220, 220]},
        "sensor": {"mono": True},
    },
    "laid": {"printer": "generic_marlin", "syringe": "hamilton_1ml", "layer_mm": 0.1},
}


def print_before(path: Path) -> None:
    """Record of an earlier print in the same folder: one line of 5 mm."""
    places = np.array([[47.5, 40.0, 1.0], [52.5, 40.0, 1.0]])
    ends = np.array([0.0, 0.5])
    ExecutedMotion(
        places[:1], places[1:], ends[:1], ends[1:], ends[:1], ends[1:], np.zeros(1, np.int64)
    ).save(path)


def test_a_simulated_camera_shows_no_ink_of_the_print_before(tmp_path: Path) -> None:
    record, camera = tmp_path / "executed.npz", tmp_path / "camera.yaml"
    camera.write_text(yaml.safe_dump(CAMERA))
    print_before(record)
    extra = {"camera": str(camera), "record": str(record)}
    order = ObserverOrder(
        job="", profile="generic_marlin", syringe="hamilton_1ml", ink="collagen_fresh",
        needle="fresh_150um", embedded=False, oct=False, frame="",
        device=DeviceSettings("simulated", extra=extra), limits=Limits(),
    )  # fmt: skip
    try_device(order, tmp_path)
    seen = cv2.imread(str(look_folder(tmp_path, EMPTY) / "picture.png"), cv2.IMREAD_UNCHANGED)
    assert np.ptp(cv2.GaussianBlur(seen, (0, 0), 3)) < 40


# --- devices by files and commands, and their time limits
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


def test_a_command_writes_the_file(tmp_path):
    words = f"{sys.executable} -c \"open('{{out}}.png', 'w').write('x')\""
    found = acquire(DeviceSettings("command", words), tmp_path / "picture")
    assert found == tmp_path / "picture.png"


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
