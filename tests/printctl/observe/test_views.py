"""Pictures that devices give, and frames that don't hold."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import pytest

from printctl.errors import UsageError
from printctl.observe import views
from printctl.observe.devices import DeviceError
from registration.camera_frame.frame import CameraFrame


@dataclass
class Check:
    """Stands for `FrameCheck`."""

    holds: bool
    why: tuple[str, ...] = ("marks moved by 180 µm",)


@pytest.mark.parametrize("holds", [True, False])
def test_a_moved_camera_is_refused_at_each_picture(tmp_path, monkeypatch, holds):
    path = tmp_path / "picture.png"
    cv2.imwrite(str(path), np.zeros((32, 32), np.uint8))
    frame = CameraFrame.model_construct()
    monkeypatch.setattr(views, "camera_frame", lambda order: frame)
    monkeypatch.setattr(views, "check_frame", lambda image, frame, path: Check(holds))
    order = type("Order", (), {"oct": False})()
    if holds:
        assert views.open_view(path, order, 1.0, 0.1)[1] is frame
    else:
        with pytest.raises(DeviceError, match="180 µm; fit it anew"):
            views.open_view(path, order, 1.0, 0.1)


def test_what_is_no_picture_is_told(tmp_path):
    path = tmp_path / "picture.png"
    path.write_bytes(b"no picture")
    with pytest.raises(DeviceError, match="isn't a picture"):
        views.read_picture(path)


@pytest.mark.parametrize("text", ["", "printer_to_scan: [[1, 0], [0, 1]]", "printer_to_scan: no"])
def test_an_octs_frame_is_four_by_four(tmp_path, text):
    path = tmp_path / "frame.yaml"
    path.write_text(text)
    with pytest.raises(UsageError, match="printer_to_scan"):
        views.read_oct_frame(path)
