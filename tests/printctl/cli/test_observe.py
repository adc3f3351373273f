"""`printctl observe` from insert to check, by painted pictures."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import pytest
import yaml
from typer.testing import CliRunner, Result

from printctl.cli.main import app
from printctl.errors import UsageError
from registration.camera_frame import read_frame, write_frame, write_insert
from registration.errors import PictureError
from registration.lens import write_lens
from tests.registration.camera_frame import scene


def observe(*words: str | Path) -> Result:
    return CliRunner().invoke(app, ["observe", *map(str, words)], catch_exceptions=False)


def test_an_insert_is_written_with_drawings_and_bodies(tmp_path: Path) -> None:
    out = tmp_path / "insert"
    done = observe("insert", "--dish", "petri_35mm", "--out", out, "--json")
    assert json.loads(done.stdout)["marks"] == 12
    assert sorted(path.name for path in out.iterdir()) == [
        "insert.pdf", "insert.png", "insert.svg", "insert.yaml", "insert_black.stl",
        "insert_white.stl",
    ]  # fmt: skip
    assert yaml.safe_load((out / "insert.yaml").read_text())["process"] == "fdm"
    with pytest.raises(UsageError, match="isn't one of fdm, resin, paper, engraved"):
        observe("insert", "--dish", "petri_35mm", "--made", "clay", "--out", out)


def test_a_frame_is_fitted_and_checked(tmp_path: Path) -> None:
    seen, lens, insert, out = (tmp_path / n for n in ("s.png", "l.yaml", "i.yaml", "f.yaml"))
    assert cv2.imwrite(str(seen), scene.picture())
    write_lens(lens, scene.lens())
    write_insert(insert, scene.insert())
    drawn = {cross.name: (cross.x_mm, cross.y_mm) for cross in scene.insert().crosses}
    x, y, z = scene.TARGET
    touched = [
        word
        for name in ("left", "right", "back")
        for word in ("--touched", f"{name}={drawn[name][0] + x},{drawn[name][1] + y},{z}")
    ]
    words = ("frame", seen, "--lens", lens, "--insert", insert, "-o", out)
    told = json.loads(observe(*words, *touched, "--json").stdout)
    assert told["tied"] == "touched"
    assert told["u_um"] < 60
    off = read_frame(out).to_printer(scene.optics().pixels(scene.TARGET[None]), z) - [x, y]
    assert abs(off).max() < 0.05
    assert observe("check", seen, "--frame", out).exit_code == 0
    half = tmp_path / "half.png"
    assert cv2.imwrite(str(half), scene.picture()[::2, ::2])
    done = observe("check", half, "--frame", out, "--json")
    assert done.exit_code == 3
    assert not json.loads(done.stdout)["holds"]
    with pytest.raises(UsageError, match="isn't CROSS=X,Y or CROSS=X,Y,Z"):
        observe(*words, "--touched", "left")


def test_a_tip_that_isnt_there_is_not_found(tmp_path: Path) -> None:
    seen, frame = tmp_path / "s.png", tmp_path / "f.yaml"
    assert cv2.imwrite(str(seen), scene.picture())
    write_frame(frame, scene.frame())
    words = ("tip", seen, "--frame", frame, "--needle", "18g", "--reach-mm", "1")
    with pytest.raises(PictureError, match="tip is not found in any picture"):
        observe(*words, "--at", "100,90,12")
    with pytest.raises(UsageError, match="1 pictures and 2 places"):
        observe(*words, "--at", "100,90,12", "--at", "90,90,12")
