"""Camera process, reading a video file by OpenCV."""

from __future__ import annotations

import os
import shutil
import signal
from pathlib import Path

import pytest

from printctl.web.job.camera.camera import CameraProcess, CameraState
from tests.printctl.web.job.camera.pictures import BLUE, RED, seen_colour, sequence, until
from tests.printctl.web.serving import served


@pytest.fixture
def told() -> list[CameraState]:
    return []


@pytest.fixture
def camera(tmp_path: Path, told: list[CameraState]):
    made = CameraProcess(sequence(tmp_path / "seen"), told.append, apart_s=0.05)
    yield made
    made.close()


def test_pictures_come_one_after_another(camera):
    first = until(lambda: camera.seen.still)
    red, green, blue = seen_colour(first.jpeg)
    assert (blue, green, red) == pytest.approx(BLUE, abs=6)
    until(lambda: camera.seen.still.number > 10)  # the sequence of four begins anew
    assert camera.seen.state == "there"


def test_a_lost_camera_is_told_of_and_found_again(camera, told, tmp_path):
    until(lambda: [one for one in told if one.state == "there"])
    shutil.rmtree(tmp_path / "seen")
    lost = until(lambda: [one for one in told if one.state == "lost"])[0]
    assert "can't be opened" in lost.message or "gives no pictures" in lost.message
    assert "since" in lost.message
    sequence(tmp_path / "seen", colour=RED)
    until(lambda: told[-1].state == "there")
    until(lambda: seen_colour(camera.seen.still.jpeg)[0] > 150)


def test_a_process_at_the_camera_that_dies_is_replaced(camera, told):
    until(lambda: camera.seen.still)
    os.kill(camera._process.pid, signal.SIGKILL)
    until(lambda: [one for one in told if "process at the camera ended" in one.message])
    until(lambda: told[-1].state == "there")


def test_a_password_in_an_address_is_not_told(told):
    camera = CameraProcess("rtsp://ada:secret@127.0.0.1:1/x?key=secret", told.append, apart_s=0.05)
    try:
        until(lambda: camera.seen.state == "lost")
        assert "127.0.0.1:1/x" in camera.seen.message
        assert "secret" not in camera.seen.message
    finally:
        camera.close()


def test_the_still_is_served_fresh_and_only_where_there_is_a_camera(tmp_path):
    with served(tmp_path / "without").client() as client:
        client.get("/printer")
        assert client.get("/api/v1/camera/still").status_code == 404
    source = sequence(tmp_path / "seen")
    with served(tmp_path / "with", camera=source).client() as client:
        client.get("/printer")
        until(lambda: client.get("/api/v1/camera").json()["state"] == "there")
        answer = client.get("/api/v1/camera/still")
        assert answer.headers["content-type"] == "image/jpeg"
        assert answer.headers["cache-control"] == "no-store"
        assert seen_colour(answer.content)[2] > 150
        shutil.rmtree(tmp_path / "seen")
        until(lambda: client.get("/api/v1/camera").json()["state"] == "lost")
        refused = client.get("/api/v1/camera/still")
        assert refused.status_code == 409
        assert "no picture from" in refused.json()["message"]
