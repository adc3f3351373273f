"""Camera views from marks: tilted cameras, lenses, ambiguous and broken marks."""

import dataclasses
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from design.network import VesselNetwork
from design.network_files.csv_format import write_network_csv
from design.vasculature.named import planar_four_vessel
from kernels.arrays import FloatArray
from registration.devices.lens import Lens
from registration.dye import DyeOptions, DyeReport, Marks, measure_dye, read_marks
from registration.dye.view import find_view
from registration.errors import DyeError
from tests.design.networks import network as network_of
from tests.printctl.cli.shell import Shell
from tests.registration.devices.lens.rendered import Rig
from tests.registration.dye.films import PLANAR_CAMERA, PLANAR_FLOW, PLANAR_MARKS, filmed, marks_of
from tests.registration.dye.simulated_film import (
    Disturbance,
    Dye,
    DyeCamera,
    DyeFilm,
    Transport,
    dye_flow,
    film_frames,
)

NETWORK = planar_four_vessel()
CORNERS = (4, 7, 8, 11)
TILTED = dataclasses.replace(PLANAR_CAMERA, tilt_deg=20.0, distance_mm=80.0, turn_deg=10.0)


def seen_by(
    camera: DyeCamera, nodes: tuple[int, ...], network: VesselNetwork = NETWORK, **more: Any
) -> Marks:
    return Marks.model_validate(marks_of(network, camera, nodes, **more))


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("distance", [np.inf, 60.0])
def test_a_tilted_camera_is_found_from_four_marks(mirrored: bool, distance: float) -> None:
    camera = dataclasses.replace(TILTED, mirrored=mirrored, distance_mm=distance)
    view = find_view(seen_by(camera, CORNERS), NETWORK)
    assert view.perspective
    assert view.tilt_deg == pytest.approx(20.0, abs=0.5)
    assert view.residual_mm == 0.0
    elsewhere = np.array([[0.0, 4.1, 1.5], [16.0, 4.1, 1.5], [7.0, 2.0, 1.5]])
    assert view.pixels(elsewhere) == pytest.approx(camera.pixels(elsewhere), abs=2e-5)
    assert view.scales(elsewhere) == pytest.approx(camera.scales(elsewhere), rel=0.01)


@pytest.mark.parametrize(
    ("nodes", "words"),
    [
        ((4, 5, 6, 7), "three of every four lie in line; mark four"),
        ((4, 5, 6, 7, 11), "three of every four lie in line"),
        ((4, 8, 11), "mark four points or more, no three in line"),
    ],
)
def test_marks_that_cant_tell_of_a_tilt_are_refused(nodes: tuple[int, ...], words: str) -> None:
    camera = dataclasses.replace(TILTED, tilt_deg=45.0, distance_mm=12.0)
    with pytest.raises(DyeError, match=words):
        find_view(seen_by(camera, nodes), NETWORK)


def test_vessels_out_of_the_marks_plane_need_a_straight_camera() -> None:
    nodes = NETWORK.nodes.copy()
    nodes[0, 2] += 2.5
    deep = network_of(nodes, NETWORK.vessel_nodes, [r[0] for _, r in NETWORK.polylines()])
    assert not find_view(seen_by(PLANAR_CAMERA, CORNERS, deep), deep).perspective
    with pytest.raises(DyeError, match=r"tilted by 20°.* 2\.5 mm off one plane.*film straight"):
        find_view(seen_by(TILTED, CORNERS, deep), deep)


def _filmed(folder: Path, camera: DyeCamera) -> DyeReport:
    film = DyeFilm(6.0, 20.0, 1.5, camera, Dye(), Disturbance())
    path = filmed(folder, NETWORK, PLANAR_FLOW, (*CORNERS, 0), film)
    return measure_dye(path, read_marks(folder / "marks.yaml"), NETWORK)


@pytest.mark.slow
def test_notes_say_what_three_and_four_marks_leave_open(tmp_path: Path) -> None:
    film = DyeFilm(5.0, 6.0, 1.0, dataclasses.replace(TILTED, tilt_deg=30.0), Dye(), Disturbance())
    path = filmed(tmp_path, NETWORK, PLANAR_FLOW, CORNERS, film)
    marks = read_marks(tmp_path / "marks.yaml")
    notes = measure_dye(path, marks, NETWORK).notes
    assert any("tilted by 30°, and four always fit one: a fifth" in note for note in notes)
    three = marks.model_copy(update={"marks": marks.marks[:3]})
    notes = measure_dye(path, three, NETWORK).notes
    assert any("if the camera was tilted, mark four points" in note for note in notes)


def _carried(report: DyeReport, fps: float = 6.0, seconds: float = 20.0) -> FloatArray:
    """Half of the end's level at each station by the simulator's own cells; no picture."""
    transport = Transport(dye_flow(NETWORK, PLANAR_FLOW), 1.0 / fps)
    times = np.arange(round(fps * seconds)) / fps
    seen = np.array([dye.mean(axis=1) for dye in transport.frames(times, 1.5)])
    stations, found = report.stations, []
    for vessel, share in zip(stations.vessel, stations.share, strict=True):
        first, last = transport.first[vessel], transport.first[vessel + 1]
        middles = first + share * (last - first) - 0.5
        low = int(np.clip(np.floor(middles), first, last - 1))
        high = min(low + 1, int(last) - 1)
        curve = seen[:, low] + (middles - low) * (seen[:, high] - seen[:, low])
        half = 0.5 * np.median(curve[-len(times) // 10 :])
        at = max(int(np.argmax(curve >= half)), 1)
        part = (half - curve[at - 1]) / max(curve[at] - curve[at - 1], 1e-9)
        found.append(times[at - 1] + part / fps)
    return np.array(found)


@pytest.mark.slow
def test_a_tilted_camera_sees_dye_arrive_at_the_same_time(tmp_path: Path) -> None:
    straight, tilted = _filmed(tmp_path / "a", PLANAR_CAMERA), _filmed(tmp_path / "b", TILTED)
    assert tilted.view.perspective
    assert not straight.view.perspective
    assert [v.patency for v in tilted.vessels] == ["open"] * 14
    for report in (straight, tilted):
        off = np.abs(report.arrivals.time_s - _carried(report))
        assert np.isfinite(off).mean() > 0.8
        assert np.nanmedian(off) < 0.5 / 6.0
        assert np.nanpercentile(off, 90) < 1.0 / 6.0


# Dye video through a distorting lens, with and without the camera's calibration.

RIG = Rig((PLANAR_CAMERA.width, PLANAR_CAMERA.height), 256.0, (-0.5, 0.0))
LENS = Lens(
    size_px=RIG.size_px, focal_px=RIG.focal_px, centre_px=(127.5, 71.5),
    distortion=RIG.distortion, um_per_px=69.0, um_per_px_95=(68.9, 69.1), off_px=0.05,
)  # fmt: skip


def distorted(pixels: np.ndarray) -> np.ndarray:
    """Where the lens shows what an ideal one would show at pixels (n, 2)."""
    flat = (pixels - RIG.middle_px) / RIG.focal_px
    return flat * (1 + RIG.distortion[0] * (flat**2).sum(1)[:, None]) * 256 + RIG.middle_px


def film_through(path: Path) -> Marks:
    """Write the film; return marks as a user reads them in it."""
    network, film = planar_four_vessel(), DyeFilm(6.0, 20.0, 1.5, PLANAR_CAMERA)
    u, v = np.meshgrid(*(np.arange(side, dtype=float) for side in RIG.size_px))
    at = RIG.ideal(np.column_stack([u.ravel(), v.ravel()])).astype(np.float32)
    at = at.T.reshape(2, *u.shape)
    code = cv2.VideoWriter.fourcc(*"MJPG")
    writer = cv2.VideoWriter(str(path), code, film.fps, RIG.size_px)
    for frame in film_frames(dye_flow(network, PLANAR_FLOW), film, np.random.default_rng(1)):
        writer.write(cv2.remap(frame, *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))
    writer.release()
    pixels = distorted(PLANAR_CAMERA.pixels(network.nodes[list(PLANAR_MARKS)])).tolist()
    return Marks.model_validate(
        {"marks": [{"node": n, "pixel": p} for n, p in zip(PLANAR_MARKS, pixels, strict=True)]}
    )


@pytest.mark.slow
def test_a_lens_s_distortion_is_taken_out_of_frames_and_marks(tmp_path: Path) -> None:
    network, film = planar_four_vessel(), tmp_path / "film.avi"
    marks = film_through(film)
    true = PLANAR_CAMERA.pixels(network.nodes)
    try:
        blind = np.abs(measure_dye(film, marks, network).view.pixels(network.nodes) - true).max()
    except DyeError:
        blind = np.inf
    assert blind > 2
    report = measure_dye(film, marks, network, DyeOptions(lens=LENS))
    assert np.abs(report.view.pixels(network.nodes) - true).max() < 0.05
    assert {one.patency for one in report.vessels} == {"open"}
    assert np.nanmedian(np.abs(report.late_s())) == pytest.approx(0.0, abs=0.3)


# Marks and files: errors reported.


def test_a_wrong_mark_is_told_in_mm() -> None:
    said = marks_of(NETWORK, PLANAR_CAMERA, PLANAR_MARKS)
    said["marks"][2]["pixel"][0] += 170.0
    with pytest.raises(DyeError, match=r"off by .* mm\), nor one tilted by less than 60"):
        find_view(Marks.model_validate(said), NETWORK)
    del said["marks"][3]
    with pytest.raises(DyeError, match=r"off by .* mm, above .* four points or more"):
        find_view(Marks.model_validate(said), NETWORK)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "marks: is missing"),
        ("marks: [", "not YAML"),
        ("marks: [{node: 0, pixel: [1, 2]}]", "at least 2"),
        ("marks: [{node: 0, pixel: [1, .nan]}, {node: 1, pixel: [3, 4]}]", "finite"),
        ("marks: []\nscale: 3", "at least 2"),
    ],
)
def test_a_broken_marks_file_is_one_message(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "marks.yaml").write_text(text)
    with pytest.raises(DyeError, match=words) as caught:
        read_marks(tmp_path / "marks.yaml")
    assert "\n" not in str(caught.value).split(": not YAML")[0]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"inlet": 5}, "inlet: node 5 isn't an open end of the network; its ends are 0, 3"),
        ({"inlet": 99}, "inlet: node 99 isn't one of the network's 0 to 11"),
        ({"marks": [{"node": 0, "pixel": [1, 2]}, {"node": 77, "pixel": [3, 4]}]}, "node 77"),
        ({"marks": [{"pixel": [1, 2]}, {"node": 1, "pixel": [3, 4]}]}, "either node or at_mm"),
        ({"marks": [{"node": 0, "pixel": [1, 2]}] * 2}, "on one point"),
    ],
)
def test_marks_of_another_design_are_told(tmp_path, change, words):
    said = {**marks_of(NETWORK, PLANAR_CAMERA, PLANAR_MARKS), **change}
    with pytest.raises(DyeError, match=words):
        measure_dye(tmp_path / "film.avi", Marks.model_validate(said), NETWORK)


def test_the_command_writes_numbers_and_page(tmp_path, monkeypatch, capsys):
    shell = Shell(monkeypatch, capsys, "dye")
    film = filmed(
        tmp_path, NETWORK, 4.0, PLANAR_MARKS, DyeFilm(fps=5.0, seconds=26.0, camera=PLANAR_CAMERA)
    )
    write_network_csv(tmp_path / "network.csv", NETWORK)
    marks = str(tmp_path / "marks.yaml")
    out = ("--model", str(tmp_path), "--marks", marks, "--out", str(tmp_path / "out"))
    code, told, err = shell(str(film), *out)
    assert (code, err) == (0, "")
    assert told.startswith("pass\n")
    page = (tmp_path / "out" / "dye.html").read_text(encoding="utf-8")
    assert "Pass" in page
    assert "http://" not in page.replace("http://www.w3.org", "")
    rows = (tmp_path / "out" / "dye.csv").read_text().splitlines()
    assert rows[0].startswith("vessel,share,x_mm")
    assert len(rows) > 100
    for broken, words in ((b"", "no frame can be read"), (b"not a film" * 99, "no frame")):
        (tmp_path / "broken.mp4").write_bytes(broken)
        code, _, err = shell(str(tmp_path / "broken.mp4"), *out)
        assert code == 1
        assert words in err
        assert "Traceback" not in err
    code, _, err = shell(str(tmp_path / "none.mp4"), *out)
    assert code == 1
    assert "none.mp4 doesn't exist" in err
    code, _, err = shell(str(film), "--model", str(tmp_path / "no"), *out[2:])
    assert code == 2
    assert "no network at" in err
    (tmp_path / "marks.yaml").write_text("marks: []")
    assert shell(str(film), *out)[0] == 1
