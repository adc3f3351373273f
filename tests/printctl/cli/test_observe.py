"""`printctl observe` from insert to check, by painted pictures."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from typer.testing import CliRunner, Result

from benchmarks.checkers.dish_camera import photograph
from firmware_profiles import Printer, load
from printctl.calibration.patterns import Pattern, PatternSetUp, WrittenPattern, read_pattern
from printctl.cli.main import app
from printctl.errors import UsageError
from registration.devices.camera_frame import read_frame, write_insert
from registration.devices.lens import write_lens
from registration.devices.lens.lens import write_model
from registration.errors import PictureError
from sim.gcode.dry_run.run import dry_run
from tests.registration.devices.camera_frame import scene


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


@pytest.mark.parametrize("pattern", ["squares", "lines"])
def test_a_camera_is_tied_to_a_print_as_its_files_say(pattern: str, tmp_path: Path) -> None:
    x, y, z = scene.TARGET
    job = tmp_path / "job.gcode"
    words = f"--needle 22g --width 0.4 --dish petri_35mm --at {x},{y},{z} -o {job}".split()
    if pattern == "lines":
        words += ["--length", "12", "--speeds", "4", "--flow-factors", "1"]
    done = CliRunner().invoke(app, ["calibrate", "pattern", pattern, *words])
    assert done.exit_code == 0, done.output
    lines = [(a - scene.TARGET[:2], b - scene.TARGET[:2], 0.4) for a, b in _written(job)]
    seen, lens, insert, out = (tmp_path / n for n in ("s.png", "l.yaml", "i.yaml", "f.yaml"))
    inked = replace(scene.SCENE, lines=lines)
    assert cv2.imwrite(str(seen), photograph(scene.optics(), scene.made(), inked, 1))
    write_lens(lens, scene.lens())
    write_insert(insert, scene.insert())
    given = ("--lens", lens, "--insert", insert, "-o", out)
    print_of = ("--printed", job.with_suffix(".json"), "--json")
    told = json.loads(observe("frame", seen, *given, *print_of).stdout)
    assert told["tied"] == "printed"
    off = read_frame(out).to_printer(scene.optics().pixels(scene.TARGET[None]), z) - [x, y]
    assert abs(off).max() < 0.02
    low = observe("frame", seen, *given, *print_of, "--at", f"{x + 0.5},{y - 0.4},{z - 1.5}")
    doubted = any("from --at's Z" in note for note in json.loads(low.stdout)["notes"])
    assert doubted == (pattern == "squares")  # a small frame tells no height
    old = tmp_path / "old.json"
    old.write_text(WrittenPattern(*_parts(job.with_suffix(".json"))).as_text())
    with pytest.raises(UsageError, match="doesn't say where it was printed"):
        observe("frame", seen, *given, "--printed", old)


def _written(job: Path) -> list[tuple[np.ndarray, np.ndarray]]:
    """Ends of all straight lines that a job writes."""
    run = dry_run(job.read_bytes(), load(Printer, "generic_marlin"), tuple(scene.TARGET))
    ends = np.vstack([run.program.start[None, :3], run.program.target[:, :3]])
    pushed = np.diff(run.program.plunger, prepend=0) > 0
    rows = np.flatnonzero(pushed & (np.linalg.norm(np.diff(ends, axis=0), axis=1) > 0))
    return [(ends[row, :2], ends[row + 1, :2]) for row in rows]


def _parts(path: Path) -> tuple[Pattern, PatternSetUp]:
    written = read_pattern(path)
    return written.pattern, written.mounted


def test_a_tip_that_isnt_there_is_not_found(tmp_path: Path) -> None:
    seen, frame = tmp_path / "s.png", tmp_path / "f.yaml"
    assert cv2.imwrite(str(seen), scene.picture())
    write_model(frame, scene.frame())
    words = ("tip", seen, "--frame", frame, "--needle", "18g", "--reach-mm", "1")
    with pytest.raises(PictureError, match="tip is not found in any picture"):
        observe(*words, "--at", "100,90,12")
    with pytest.raises(UsageError, match="1 pictures and 2 places"):
        observe(*words, "--at", "100,90,12", "--at", "90,90,12")
