"""Devices by files and commands, and their time limits."""

from __future__ import annotations

import sys
import time

import pytest

from printctl.observe.devices import DeviceError, DeviceSettings, acquire

HANGS = f"{sys.executable} -c 'import time; time.sleep(60)'"


def test_a_new_file_of_a_folder_is_taken(tmp_path):
    (tmp_path / "old.png").write_bytes(b"old")
    since = time.time() + 0.01
    time.sleep(0.02)
    (tmp_path / "new.png").write_bytes(b"new")
    found = acquire(DeviceSettings("folder", str(tmp_path)), tmp_path / "picture", since)
    assert found.name == "new.png"


def test_a_command_writes_the_file(tmp_path):
    words = f"{sys.executable} -c \"open('{{out}}.png', 'w').write('x')\""
    found = acquire(DeviceSettings("command", words), tmp_path / "picture", 0.0)
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
        acquire(settings, tmp_path / "picture", 0.0)
