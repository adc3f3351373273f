"""Pictures that devices give, and frames that don't hold."""

from __future__ import annotations

import os
from dataclasses import dataclass
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from printctl.errors import UsageError
from printctl.observe import views
from printctl.observe import views as camera_holds
from printctl.observe.devices import DeviceError
from registration.devices.camera_frame.frame import CameraFrame
from registration.inspection import ExpectedLines
from sim.devices.camera.optics import Camera
from sim.devices.camera.scene import Bath


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


def test_a_frame_that_was_fitted_anew_counts_at_the_next_picture(tmp_path, monkeypatch):
    path = tmp_path / "frame.yaml"
    monkeypatch.setattr(views, "read_frame", lambda file: file.read_text())
    order = SimpleNamespace(frame=str(path), device=SimpleNamespace(extra={}))
    for moment, text in enumerate(["as it was", "fitted anew"], 1):
        path.write_text(text)
        os.utime(path, ns=(moment, moment))
        assert views.camera_frame(order) == text


def test_what_is_no_picture_is_told(tmp_path):
    path = tmp_path / "picture.png"
    path.write_bytes(b"no picture")
    with pytest.raises(DeviceError, match="isn't a picture"):
        views.read_picture(path)


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
        views.read_oct_frame(path)


def test_a_simulated_frame_looks_through_the_baths_surface():
    camera = Camera(size_px=(400, 300), um_per_px=20, target_mm=(50, 40, 4), tilt_deg=20)
    place = np.array([[50.5, 40.5, 1.0]])
    straight = views.SimulatedFrame(camera, Bath()).to_pixels(place)
    assert straight == pytest.approx(camera.pixels(place))
    bent = views.SimulatedFrame(camera, Bath(surface_z_mm=4.0)).to_pixels(place)
    entry = np.append(camera.on_plane(bent, 4.0)[0][:2], 4.0)
    sine = [
        np.linalg.norm((one - other)[:2]) / np.linalg.norm(one - other)
        for one, other in ((camera.eye_mm, entry), (entry, place[0]))
    ]
    assert sine[0] / sine[1] == pytest.approx(1.33, rel=1e-4)


def _scanned(tmp_path):
    """A folder with a volume of noise and its frame; both files."""
    bright = np.linspace(100, 3000, 120)[:, None, None]
    volume = (np.random.default_rng(2).exponential(1, (120, 30, 40)) * bright).astype(np.uint16)
    path, frame = tmp_path / "picture.npz", tmp_path / "frame.yaml"
    np.savez(
        path, volume=volume, voxel_mm=np.array([0.01, 0.02, 0.02]), refractive_index=1.0,
        optical_depth=False, scale="linear", modality="oct", depth_down=True,
    )  # fmt: skip
    frame.write_text("printer_to_scan: [[1,0,0,0], [0,-1,0,0.6], [0,0,-1,1.2], [0,0,0,1]]")
    return path, frame


def test_a_volume_taken_twice_is_known_at_another_layer(tmp_path):
    """A hanging scanner's volume looks another way in each layer's height map."""
    path, frame = _scanned(tmp_path)
    order = type("Order", (), {"oct": True, "laser": False, "frame": str(frame)})()
    low, high = (views.open_view(path, order, z, 0.06) for z in (0.5, 0.7))
    assert not np.array_equal(low.image, high.image)
    np.testing.assert_array_equal(low.taken, high.taken)
    assert len(low.taken) < 20


@pytest.mark.parametrize("embedded", [True, False])
def test_a_volume_of_a_bath_has_a_picture_at_the_filaments_depths(tmp_path, embedded):
    path, frame = _scanned(tmp_path)
    facts = {"oct": True, "laser": False, "embedded": embedded, "frame": str(frame)}
    once = np.zeros(1, dtype=np.int64)
    lines = ExpectedLines(
        np.array([[0.1, 0.3, 0.4]]), np.array([[0.7, 0.3, 0.8]]), np.full(1, 0.15),
        once, once, np.ones(1, dtype=np.bool_),
    )  # fmt: skip
    view = views.open_view(path, type("Order", (), facts)(), 0.6, 0.5, lines)
    assert (view.filaments is not None) == embedded
    assert view.hidden is None
    if embedded:
        assert view.filaments.shape[:2] == view.image.shape[:2]
