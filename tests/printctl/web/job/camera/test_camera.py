"""Camera process, reading a video file by OpenCV."""

from __future__ import annotations

import os
import shutil
import signal
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from printctl.machine.records.folders import film_file, frames_folder
from printctl.machine.records.states import LinkState
from printctl.web.core import Core
from printctl.web.job.camera import timelapse
from printctl.web.job.camera.camera import CameraProcess, CameraState
from printctl.web.job.camera.film import MOST_FRAMES, write_film
from printctl.web.job.camera.timelapse import LEAVE_FREE_BYTES, limit_reached
from printctl.web.job.service import JobService
from tests.printctl.web.job.camera.pictures import BLUE, RED, seen_colour, sequence
from tests.printctl.web.job.conftest import OPERATOR, WORDS, add, ready
from tests.printctl.web.serving import served, server_process
from tests.printctl.web.shell.browsers import WIDE, serious, shown
from tests.waiting import wait_for as until


@pytest.fixture
def told() -> list[CameraState]:
    return []


@pytest.fixture
def camera(tmp_path: Path, told: list[CameraState]):
    made = CameraProcess(sequence(tmp_path / "seen"), told.append, apart_s=0.05)
    yield made
    made.close()


def test_pictures_come_one_after_another(camera):
    red, green, blue = seen_colour(until(lambda: camera.seen.jpeg))
    assert (blue, green, red) == pytest.approx(BLUE, abs=6)
    until(lambda: camera.seen.number > 10)  # the sequence of four begins anew
    assert camera.seen.state == "there"


def test_a_lost_camera_is_told_of_and_found_again(camera, told, tmp_path):
    until(lambda: [one for one in told if one.state == "there"])
    shutil.rmtree(tmp_path / "seen")
    lost = until(lambda: [one for one in told if one.state == "lost"])[0]
    assert "can't be opened" in lost.message or "gives no pictures" in lost.message
    assert "since" in lost.message
    sequence(tmp_path / "seen", colour=RED)
    until(lambda: told[-1].state == "there")
    until(lambda: seen_colour(camera.seen.jpeg)[0] > 150)


def test_a_process_at_the_camera_that_dies_is_replaced(camera, told):
    until(lambda: camera.seen.jpeg)
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


# --- time-lapse of a print on the simulated printer, with a video file as camera
@pytest.fixture
def core(core: Core, tmp_path: Path) -> Core:
    source = sequence(tmp_path / "seen")
    return replace(core, settings=replace(core.settings, camera=source))


def ended(service: JobService, job: str):
    heard = service.prints.heard(job)
    return heard if heard is not None and heard.status.state is LinkState.DONE else None


@pytest.mark.slow
def test_a_print_leaves_a_picture_a_layer_and_a_film(core, service, station):
    job = add(service, layers=6)
    until(lambda: service.watching.seen().state == "there")
    service.start(OPERATOR, job, ready(service, job), WORDS)
    heard = until(lambda: ended(service, job), 60.0)
    folder = frames_folder(heard.folder, heard.journal.started)
    kept = until(lambda: sorted(path.name for path in folder.glob("*.jpg")))
    film = film_file(heard.folder, heard.journal.started)
    until(film.is_file)
    kept = sorted(path.name for path in folder.glob("*.jpg"))
    assert kept[0] == "000001.jpg"
    assert 4 <= len(kept) <= 7  # six layers and the end; the first may end before it is followed
    told = service.watching.timelapse(job)
    assert (told.frames, told.film, told.message) == (len(kept), True, "")
    assert service.watching.film(job).path == film
    with Image.open(film) as seen:
        assert seen.format == "WEBP"
        assert seen.size == (320, 240)
    again = JobService(replace(core, settings=replace(core.settings, camera=None)))
    try:
        assert again.watching.timelapse(job).film
    finally:
        again.close()


def pictures(folder: Path, count: int, size: tuple[int, int] = (64, 48)) -> Path:
    folder.mkdir()
    for k in range(count):
        shade = Image.new("RGB", size, (k * 37 % 256, k * 91 % 256, 200))
        shade.save(folder / f"{k + 1:06d}.jpg")
    return folder


def test_a_long_film_takes_pictures_evenly_from_first_to_last(tmp_path):
    folder = pictures(tmp_path / "frames", MOST_FRAMES + 50, (8, 8))
    assert write_film(folder, tmp_path / "film.webp") == MOST_FRAMES
    with Image.open(tmp_path / "film.webp") as film:
        film.seek(film.n_frames - 1)
        last = MOST_FRAMES + 49
        shade = film.convert("RGB").getpixel((4, 4))
        assert shade == pytest.approx((last * 37 % 256, last * 91 % 256, 200), abs=12)


def test_the_pictures_have_a_limit_of_number_size_and_disk(tmp_path, monkeypatch):
    kept = sorted(pictures(tmp_path / "frames", 3).glob("*.jpg"))
    size = sum(path.stat().st_size for path in kept)
    much = 10 * LEAVE_FREE_BYTES
    assert limit_reached(kept, 100, much) == ""
    assert "MB are free" in limit_reached(kept, 100, LEAVE_FREE_BYTES + 99)
    monkeypatch.setattr(timelapse, "MOST_FRAMES", 3)
    assert "3 are there, the most" in limit_reached(kept, 100, much)
    monkeypatch.setattr(timelapse, "MOST_FRAMES", 4)
    monkeypatch.setattr(timelapse, "MOST_BYTES", size + 99)
    assert "the most" in limit_reached(kept, 100, much)
    assert limit_reached(kept, 99, much) == ""


# --- the camera beside a running print, in a real browser
@pytest.mark.browser
@pytest.mark.slow
def test_the_camera_is_seen_beside_the_drawing_lost_and_found(
    core: Core, service: JobService, station: Any, browser: Any, tmp_path: Path
) -> None:
    source = sequence(tmp_path / "seen")
    job = add(service, layers=20, moves=800)
    service.start(OPERATOR, job, ready(service, job), WORDS)
    with server_process(core.workspace.root, "--camera", source) as server:
        page = shown(browser, f"{server.url}/job?job={job}", viewport=WIDE, color_scheme="dark")
        picture = page.get_by_alt_text("The print, seen by the camera")
        wide = "one => one.decode().then(() => one.naturalWidth)"
        assert picture.evaluate(wide) == 320
        first = picture.get_attribute("src")
        until(lambda: picture.get_attribute("src") != first)
        assert serious(page) == []
        for width, height in ((1280, 800), (1024, 768), (400, 800)):
            page.set_viewport_size({"width": width, "height": height})
            page.wait_for_timeout(300)
            box = picture.bounding_box()
            assert box["height"] >= 90
            assert page.evaluate("document.documentElement.scrollHeight") <= height
        shutil.rmtree(tmp_path / "seen")
        page.get_by_text("no picture from").wait_for()
        assert picture.count() == 0
        sequence(tmp_path / "seen")
        picture.wait_for()
        service.hands.cancel(job)
        page.get_by_role("heading", name="Cancelled ·").wait_for()
        page.close()
