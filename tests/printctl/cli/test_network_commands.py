"""`printctl view`, `convert` and `measure`, in an empty directory."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest

from tests.printctl.cli.shell import Shell

HEADER = "vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind,tree\n"
FORK = (
    "0,0,1,7,7,0,7,7,3,0.5,0.5,artery,0\n"
    "1,1,2,7,7,3,10,7,7,0.4,0.4,artery,0\n"
    "2,1,3,7,7,3,4,7,7,0.39,0.39,artery,0\n"
)


@pytest.fixture
def shell(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Shell:
    monkeypatch.chdir(tmp_path)
    return Shell(monkeypatch, capsys)


def test_a_network_goes_round_the_formats(tmp_path: Path, shell: Shell) -> None:
    (tmp_path / "a.csv").write_text(HEADER + FORK)
    way = ["a.csv", "b.vtp", "c.json", "d.swc", "e.npz", "f.csv"]
    for source, target in pairwise(way):
        unit = ("--unit", "mm") if source[-3:] in ("csv", "vtp") else ()
        code, out, _ = shell("convert", source, target, *unit)
        assert code == 0
        assert out == f"{target}: 3 vessels, 6 points\n"
    rows = [line.split(",") for line in (tmp_path / "f.csv").read_text().splitlines()[1:]]
    assert sorted(float(row[9]) for row in rows) == pytest.approx([0.39, 0.4, 0.5])
    _, _, err = shell("convert", "a.csv", "paths", "--unit", "mm")
    assert len(list((tmp_path / "paths").glob("*.pth"))) == 2
    assert "no radii" in err


def test_x_cavates_networks_are_read_joined_and_told_of(tmp_path: Path, shell: Shell) -> None:
    trunk = "Vessel: 0, Number of Points: 2\n\n0, 0, 0, 0.1\n4, 0, 0, 0.1\n"
    branch = "Vessel: 1, Number of Points: 2\n1, 0.05, 0, 0.04\n1, 2, 0, 0.04"
    (tmp_path / "a.txt").write_text(trunk + branch)
    (tmp_path / "ends.txt").write_text("inlet\n4, 0, 0\noutlet\n0, 0, 0")
    code, out, err = shell("convert", "a.txt", "b.csv", "--inlet-outlet", "ends.txt")
    assert (code, out) == (0, "b.csv: 3 vessels, 6 points\n")
    assert "0.500 mm at most" in " ".join(err.split())
    rows = [line.split(",") for line in (tmp_path / "b.csv").read_text().splitlines()[1:]]
    assert [float(word) for word in rows[0][3:9]] == [40, 0, 0, 10, 0, 0]
    code, _, err = shell("solid", "a.txt", "--out", "a.stl")
    assert code == 0
    assert "lie: 1, by 0.500" in " ".join(err.split())


CASES: tuple[tuple[int, tuple[str, ...], str], ...] = (
    (2, ("--unit",), "convert a.csv a.vtp"),
    (2, ("a.csv", "another name"), "convert a.csv a.csv --unit mm"),
    (2, (".obj",), "convert a.csv a.obj --unit mm"),
    (2, ("none.csv",), "convert none.csv a.json --unit mm"),
    (1, ("b.csv", "line 3", "NaN"), "convert b.csv b.json --unit mm"),
    (1, ("c.csv", "UTF-8"), "view c.csv --unit mm"),
    (1, ("d.vtp", "not XML"), "measure d.vtp --unit mm --tissue ."),
    (1, ("e.txt", "line 1", "announces 2 points and has 1"), "view e.txt"),
    (2, ("e.txt", "in cm", "--unit"), "view e.txt --unit mm"),
    (2, (".txt", "a.csv"), "convert a.csv a.json --unit mm --inlet-outlet e.txt"),
    (2, ("none.txt",), "convert e.txt a.json --inlet-outlet none.txt"),
    (2, ("run folder",), "view ."),
    (2, ("deviation", "registered scan", "radius"), "view a.csv --unit mm --colour deviation"),
    (2, ("--colour", "colourful"), "view a.csv --unit mm --colour colourful"),
    (2, (".png",), "view a.csv --unit mm --png picture.jpg"),
    (2, ("--tissue",), "measure a.csv --unit mm"),
    (2, ("--tissue-unit",), "measure a.csv --unit mm --tissue t.stl"),
    (1, ("t.stl",), "measure a.csv --unit mm --tissue t.stl --tissue-unit mm"),
    (2, ("t.stl",), "view a.csv --unit mm --tissue t.stl --tissue-unit mm --no-open"),
)


@pytest.mark.parametrize(("code", "words", "command"), CASES, ids=[case[2] for case in CASES])
def test_wrong_input_is_told_in_one_message_and_leaves_nothing(
    code: int, words: tuple[str, ...], command: str, tmp_path: Path, shell: Shell
) -> None:
    (tmp_path / "a.csv").write_text(HEADER + FORK)
    (tmp_path / "b.csv").write_text(HEADER + FORK.replace("0.4,0.4", "nan,0.4"))
    (tmp_path / "c.csv").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "d.vtp").write_text("no xml at all")
    (tmp_path / "e.txt").write_text("Vessel: 0, Number of Points: 2\n0, 0, 0, 0.1")
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    ended, out, err = shell(*command.split())
    assert ended == code
    assert out == ""
    for word in words:
        assert word in err
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_page_isnt_opened_where_nobody_sees_it(
    tmp_path: Path, shell: Shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    (tmp_path / "a.csv").write_text(HEADER + FORK)
    assert shell("view", "a.csv", "--unit", "mm")[0] == 0
    assert shell("view", "a.csv", "--unit", "mm", "--no-open")[0] == 0
    assert opened == []
    code, out, err = shell("view", "a.csv", "--unit", "mm", "--open")
    assert code == 0
    assert opened == [(tmp_path / "a.view.html").as_uri()]
    assert out.startswith("a.view.html (")
    assert "0.25 mL/min" in err
