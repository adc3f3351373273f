"""Dye marks and files: errors reported."""

from pathlib import Path

import pytest

from design.network_files.csv_format import write_network_csv
from design.vasculature.named import planar_four_vessel
from registration.dye import Marks, measure_dye, read_marks
from registration.dye.view import find_view
from registration.errors import DyeError
from sim.devices.dye import DyeFilm
from tests.printctl.cli.shell import Shell
from tests.registration.dye.films import PLANAR_CAMERA, PLANAR_MARKS, filmed, marks_of

NETWORK = planar_four_vessel()


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
