"""A laser line with a camera, as an observer sees it: a folder of pictures becomes a layer."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from printctl.observe.devices import DeviceError, DeviceSettings, acquire, files_in, picture_of
from printctl.observe.records import emptied_look_folder
from printctl.observe.views import open_view, try_laser_frame
from registration.devices.lens.lens import write_model as write_frame
from registration.devices.lens.lens import write_model as write_laser
from registration.errors import PictureError
from registration.inspection import ExpectedLines
from tests.printctl.cli.test_observe import observe
from tests.registration.devices.camera_frame import scene
from tests.registration.devices.laser_sweep import sweeps


def lines_on_blocks() -> ExpectedLines:
    """A line along each block's top, written as 0.9 mm high ones."""
    at = [(sweeps.LOW[0] + (left + right) / 2, high) for left, right, high in sweeps.BLOCKS]
    start, end = (
        np.array([(x, sweeps.LOW[1] + y, sweeps.FLOOR_Z + high) for x, high in at])
        for y in (1.5, 5.5)
    )
    number = np.arange(2)
    return ExpectedLines(start, end, np.full(2, 1.2), number, number, np.array([False, True]))


def test_pictures_of_a_look_become_heights_of_its_layer(tmp_path: Path) -> None:
    file = tmp_path / "laser.yaml"
    write_laser(file, sweeps.fitted(tmp_path / "flat").laser)
    try_laser_frame(file)
    order = cast(Any, SimpleNamespace(oct=False, laser=True, frame=str(file)))
    look = sweeps.written(sweeps.over_blocks(), tmp_path / "picture")
    view = open_view(look, order, sweeps.FLOOR_Z + 0.45, 0.9, lines_on_blocks())
    assert view.size is not None
    assert "-" in view.size.words or "+" in view.size.words  # µm over the layer's top
    assert view.hidden is not None
    assert view.hidden.mean() < 0.5
    bumped = [np.roll(one, 4, axis=1) for one in sweeps.over_blocks()]
    moved = sweeps.written(bumped, tmp_path / "moved")
    with pytest.raises(DeviceError, match="frame doesn't hold any more"):
        open_view(moved, order, sweeps.FLOOR_Z + 0.45, 0.9, lines_on_blocks())
    dark = sweeps.written([scene.picture()] * 3, tmp_path / "dark")
    with pytest.raises(DeviceError, match="in 0 of 3 pictures"):
        open_view(dark, order, sweeps.FLOOR_Z + 0.45, 0.9, lines_on_blocks())
    file.write_text("printctl_laser: 1\n")
    with pytest.raises(PictureError, match="observe sweep"):
        try_laser_frame(file)


def test_the_command_fits_a_laser(tmp_path: Path) -> None:
    write_frame(tmp_path / "frame.yaml", scene.frame())
    flat = sweeps.written(sweeps.flat(), tmp_path / "flat")
    out = tmp_path / "laser.yaml"
    done = observe("sweep", flat, "--frame", tmp_path / "frame.yaml", "--floor-z", "1", "-o", out)
    assert "of 24 used" in done.stdout
    assert "heights             ±" in done.stdout
    try_laser_frame(out)


def test_a_new_folder_of_pictures_is_kept_with_the_look(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = tmp_path / "sweeps"
    (source / "old").mkdir(parents=True)
    (source / "old" / "0.png").write_bytes(b"old")
    look = emptied_look_folder(tmp_path, 1)

    def listed_then_written(path: Path, tables: bool) -> object:
        listed = files_in(path, tables)
        (source / "new").mkdir()
        (source / "new" / "0.png").write_bytes(b"new")
        return listed

    monkeypatch.setattr(sys.modules[acquire.__module__], "files_in", listed_then_written)
    found = acquire(DeviceSettings("folder", str(source), tables=True), look / "picture")
    assert found == look / "picture"
    assert (found / "0.png").read_bytes() == b"new"
    assert picture_of(look, "picture") == found
    assert not list(emptied_look_folder(tmp_path, 1).iterdir())


def test_a_command_may_write_a_folder(tmp_path: Path) -> None:
    words = f'{sys.executable} -c \'import os; os.mkdir(r"{{out}}"); open(r"{{out}}/0.png", "w")\''
    found = acquire(DeviceSettings("command", words, tables=True), tmp_path / "picture")
    assert [one.name for one in found.iterdir()] == ["0.png"]
