"""Starting observers: one whose link is dead makes room for another, with its device's program."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from gcode.motion.executed import ExecutedMotion
from printctl.errors import UsageError
from printctl.machine.errors import LinkError
from printctl.machine.process.contact import alive, hold_folder
from printctl.machine.records.record import RECORD
from printctl.observe import observer_launch
from printctl.observe.deciding import Limits
from printctl.observe.devices import DeviceError, DeviceSettings, acquire, find_picture, list_files
from printctl.observe.looks import views
from printctl.observe.looks import views as camera_holds
from printctl.observe.looks.height_maps import read_matrix
from printctl.observe.looks.look_context import Look
from printctl.observe.looks.views import EMPTY_LOOK_NUMBER, image_before, picture_before
from printctl.observe.order import ObserverOrder
from printctl.observe.process import try_device
from printctl.observe.records import (
    OBSERVER_LOCK,
    ORDER_FILE,
    READY_FILE,
    LookRecord,
    look_folder,
    save_look,
)
from printctl.processes.alive import is_alive
from registration.devices.camera_frame.frame import CameraFrame
from tests.waiting import wait_for

_OBSERVER = """
import signal, sys
from pathlib import Path
from printctl.machine.process.contact import hold_folder
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
    (folder / ORDER_FILE).touch()
    (folder / "scan.sh").write_text(f"echo $$ >{folder}/program.new\n"
                                    f"mv {folder}/program.new {folder}/program\n"
                                    "sleep 600\n")  # fmt: skip
    process = subprocess.Popen([sys.executable, "-c", _OBSERVER, str(folder)])
    (folder / READY_FILE).write_text(f"{process.pid}\n")
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
    monkeypatch.setattr(observer_launch, "has_looks", lambda _: True)
    monkeypatch.setattr(
        observer_launch,
        "start_observer",
        lambda folder, _: started.append(alive(folder, OBSERVER_LOCK)),
    )
    _begin(scanning, seconds_after_ready=-1 if link == "awaited" else 1)
    with hold_folder(scanning) if link == "alive" else nullcontext():
        observer_launch.ensure_observer(scanning)
    assert started == [True] * (link == "dead")


def test_a_left_over_observer_is_ended_with_its_devices_program(
    scanning: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = int((scanning / "program").read_text())
    free = list[bool]()

    def spawned(*_: object) -> None:
        free.append(not alive(scanning, OBSERVER_LOCK))
        raise LinkError("far enough")

    monkeypatch.setattr(observer_launch, "spawn", spawned)
    _begin(scanning, seconds_after_ready=-1)
    with pytest.raises(observer_launch.ObserverError, match="at work"):
        observer_launch.start_observer(scanning)
    os.kill(program, 0)
    _begin(scanning, seconds_after_ready=1)
    with pytest.raises(observer_launch.ObserverError, match="far enough"):
        observer_launch.start_observer(scanning)
    assert free == [True]
    assert _gone(program)


def _begin(folder: Path, seconds_after_ready: float) -> None:
    """Leave a link's record as of a print that began before or after the observer was ready."""
    ready, record = folder / READY_FILE, folder / RECORD
    record.touch()
    at = ready.stat().st_mtime + seconds_after_ready
    os.utime(record, (at, at))


def _gone(pid: int) -> bool:
    """Whether a process ends soon: it is ended behind the one that has started it."""
    return bool(wait_for(lambda: not is_alive(pid)))


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
    seen = cv2.imread(
        str(look_folder(tmp_path, EMPTY_LOOK_NUMBER) / "picture.png"), cv2.IMREAD_UNCHANGED
    )
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
        listed = list_files(path, tables)
        write("new.json", b'{"voxel_mm": [0.01, 0.01, 0.01]}')
        write("new.TIF", b"new")
        write("new.log", b"written last")
        return listed

    monkeypatch.setattr(sys.modules[acquire.__module__], "list_files", listed_then_written)
    found = acquire(DeviceSettings("folder", str(folder)), look / "picture")
    assert found == look / "picture.TIF"
    assert found.read_bytes() == b"new"
    assert sorted(one.name for one in look.iterdir()) == ["picture.TIF", "picture.json"]
    assert len(list(folder.iterdir())) == 4
    assert find_picture(look, "picture") == found


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
        wait_for(began.is_file)
    finally:
        observer.kill()
        observer.wait()
    scanner = int(began.read_text())
    try:
        wait_for(lambda: not is_alive(scanner))
    finally:
        with suppress(ProcessLookupError):
            os.kill(scanner, signal.SIGKILL)


# --- pictures that devices give, and frames that don't hold
@dataclass
class Check:
    """Stands for `FrameCheck`."""

    holds: bool
    why: tuple[str, ...] = ("marks moved by 180 µm",)


@pytest.mark.parametrize("holds", [True, False])
def test_a_moved_camera_is_refused_at_each_picture(tmp_path, monkeypatch, holds):
    path = tmp_path / "picture.png"
    cv2.imwrite(str(path), np.full((32, 32), 200, np.uint8))
    frame = CameraFrame.model_construct()
    monkeypatch.setattr(views, "camera_frame", lambda order: frame)
    monkeypatch.setattr(camera_holds, "check_frame", lambda image, frame, path: Check(holds))
    order = type("Order", (), {"oct": False, "laser": False})()
    if holds:
        assert views.open_view(path, order, 1.0, 0.1)[1] is frame
    else:
        with pytest.raises(DeviceError, match="180 µm; else fit it anew"):
            views.open_view(path, order, 1.0, 0.1)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_a_black_picture_is_told_as_that(tmp_path, dtype):
    """It was told as a frame to be fitted anew: no marks are found in the dark."""
    black = np.zeros((32, 32), dtype)
    with pytest.raises(DeviceError, match=r"now.png is black.* 0.0% of the range; is the light on"):
        camera_holds.refuse_moved(black, CameraFrame.model_construct(), tmp_path / "now.png")


def test_half_a_jpeg_is_no_picture(tmp_path):
    path = tmp_path / "IMG_1.JPG"
    noise = np.random.default_rng(1).integers(0, 255, (64, 64), np.uint8)
    whole = cv2.imencode(".jpg", noise)[1].tobytes()
    path.write_bytes(whole)
    assert views.read_picture(path).shape == (64, 64)
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DeviceError, match="is cut off"):
        views.read_picture(path)


@pytest.mark.parametrize("name", ["picture.npz", "picture.tif"])
def test_what_is_no_scan_is_told(tmp_path, monkeypatch, name):
    path = tmp_path / name
    path.write_bytes(b"PK" + bytes(100))
    monkeypatch.setattr(views, "_oct_frame", lambda path, order: np.eye(4))
    order = type("Order", (), {"oct": True, "laser": False})()
    with pytest.raises(DeviceError, match="broken archive"):
        views.open_view(path, order, 1.0, 0.1)


@pytest.mark.parametrize("text", ["", "printer_to_scan: [[1, 0], [0, 1]]", "printer_to_scan: no"])
def test_an_octs_frame_is_four_by_four(tmp_path, text):
    path = tmp_path / "frame.yaml"
    path.write_text(text)
    with pytest.raises(UsageError, match="printer_to_scan"):
        read_matrix(path, "an OCT")


# --- the picture that counts as the one before a look's layer
LOOK = Look(3, 300, 300, 200, "end of layer 2")


def record(number: int, done: int, at: float = 100.0) -> LookRecord:
    return LookRecord(number, done, done, "", at, "go_on", "", found={"seen_share": 1.0})


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for number in (1, 2, 3):
        (look_folder(tmp_path, number) / "picture.png").touch()
    save_look(tmp_path, record(1, 100))
    save_look(tmp_path, record(2, 200))
    return tmp_path


def now(folder: Path) -> Path:
    return folder / "looks" / "0003" / "picture.png"


def test_the_look_that_directly_precedes_gives_it(folder: Path) -> None:
    assert picture_before(folder, 0.0, LOOK, now(folder)) == folder / "looks/0002/picture.png"


def test_pictures_of_other_prints_of_long_ago_and_of_looks_not_judged_are_none(
    folder: Path,
) -> None:
    assert picture_before(folder, 500.0, LOOK, now(folder)) is None  # another print's
    old = folder / "looks" / "0002" / "picture.png"
    long_ago = now(folder).stat().st_mtime - 7200
    os.utime(old, (long_ago, long_ago))
    assert picture_before(folder, 0.0, LOOK, now(folder)) is None
    os.utime(old)
    (folder / "looks" / "0002" / "look.json").unlink()
    assert picture_before(folder, 0.0, LOOK, now(folder)) is None


def test_a_picture_in_a_file_of_another_format_counts(folder: Path) -> None:
    """After PNG, TIFF of the same camera told nothing of a layer over older ink."""
    other = now(folder).with_suffix(".tif")
    other.touch()
    assert picture_before(folder, 0.0, LOOK, other) == folder / "looks/0002/picture.png"


def test_the_first_look_has_the_view_of_the_empty_dish(tmp_path: Path) -> None:
    empty, first = (
        look_folder(tmp_path, number) / "picture.png" for number in (EMPTY_LOOK_NUMBER, 1)
    )
    for number, path in enumerate((empty, first)):
        path.touch()
        os.utime(path, (1000.0 + 60.0 * number,) * 2)
    look = Look(1, 40, 40, 0, "end of layer 0")
    assert picture_before(tmp_path, 1030.0, look, first) == empty
    assert picture_before(tmp_path, 990.0, look, first) is None  # taken while it was printing
    later = Look(2, 80, 80, 40, "end of layer 1")
    assert picture_before(tmp_path, 1030.0, later, first) is None


def test_mends_alone_are_judged_by_the_picture_before_the_ink_they_belong_to(folder: Path) -> None:
    about = Look(3, 220, 200, 100, "end of layer 1")
    assert picture_before(folder, 0.0, about, now(folder)) == folder / "looks/0001/picture.png"


COLOUR = np.random.default_rng(1).integers(0, 255, (20, 30, 3), dtype=np.uint8)


def before_in(folder: Path, image: np.ndarray) -> None:
    cv2.imwrite(str(folder / "looks/0002/picture.png"), image)
    now(folder).touch()


@pytest.mark.parametrize(
    ("now_is", "words"),
    [
        (COLOUR[:, :, 0], "grey with 8 bits, and the one before was in colour with 8 bits a"),
        (COLOUR.astype(np.uint16) * 257, "in colour with 16 bits a channel, and the one before"),
    ],
)
def test_a_camera_that_changes_colour_or_depth_in_mid_print_is_told(
    folder: Path, now_is: np.ndarray, words: str
) -> None:
    """Sound ink seemed to be missing then: 4.6 mm of gaps, later a clogged needle."""
    before_in(folder, COLOUR)
    with pytest.raises(DeviceError, match=words):
        image_before(folder, 0.0, LOOK, now(folder), now_is)
