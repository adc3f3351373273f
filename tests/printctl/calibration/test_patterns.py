"""`printctl calibrate pattern`: G-code, sheet and pattern file agree."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from firmware_profiles import Printer, Syringe, load
from printctl.calibration.patterns import read_pattern
from printctl.cli.main import app
from printctl.errors import SafetyError, UsageError
from sim.gcode.dry_run.run import DryRun, dry_run

PRINTER, SYRINGE = load(Printer, "generic_marlin"), load(Syringe, "hamilton_1ml")
BORE = math.pi / 4 * SYRINGE.inner_mm**2
AT = (100.0, 100.0, 5.0)
BATH = ("--bath", "gelatin_support", "--dish", "petri_60mm", "--bath-depth", "10")


def pattern(*words: str | Path) -> Result:
    return CliRunner().invoke(
        app, ["calibrate", "pattern", *map(str, words)], catch_exceptions=False
    )


def written(run: DryRun) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Begin, end, µL and mm/s of each move that pushes ink on its way."""
    ends = np.vstack([run.program.start[None, :3], run.program.target[:, :3]])
    pushed = np.diff(run.program.plunger, prepend=0) * BORE
    rows = (pushed > 0) & (np.linalg.norm(np.diff(ends, axis=0), axis=1) > 0)
    return ends[:-1][rows], ends[1:][rows], pushed[rows], run.program.feed[rows]


def test_lines_are_written_as_the_sheet_says(tmp_path: Path) -> None:
    job = tmp_path / "lines.gcode"
    asked = ("--speeds", "2,6", "--flow-factors", "0.8,1.2", "--steps", "1", "--width", "0.4")
    done = pattern("lines", "--needle", "25g", *BATH, *asked, "-o", job)
    assert done.exit_code == 0, done.output
    begin, end, volume, speed = written(dry_run(job.read_bytes(), PRINTER, AT))
    way = np.linalg.norm(end - begin, axis=1)
    flow = volume / (way * math.pi / 4 * 0.4**2)
    inside = way < 25  # the frame's sides are longer or its halves; lines are 24 or 8 mm
    lines = {
        (round(float(v), 3), round(float(m), 2))
        for v, m, length in zip(speed, flow, way, strict=True)
        if abs(length - 24) < 1e-6
    }
    assert lines == {(2, 0.8), (2, 1.2), (6, 0.8), (6, 1.2)}
    steps = speed[inside & (np.abs(way - 8) < 1e-6)]
    np.testing.assert_allclose(steps, [2, 6, 2])
    # The sheet's rows are these lines, at the same heights.
    found = read_pattern(job.with_suffix(".json")).pattern
    corner = np.array(AT)[:2] - np.array(found.size_mm) / 2
    for stroke in found.of_role("line"):
        row = int(np.abs(begin[:, :2] - corner - stroke.points[0, :2]).sum(axis=1).argmin())
        np.testing.assert_allclose(begin[row, :2] - corner, stroke.points[0, :2], atol=2e-3)
        assert speed[row] == pytest.approx(float(stroke.speed_mm_s[0]))
        assert flow[row] == pytest.approx(stroke.flow, rel=1e-3)
    sheet = job.with_suffix(".csv").read_text()
    assert "line,x_mm,speed_mm_s,flow,expected_mm,width_mm" in sheet
    assert f"{0.4 * math.sqrt(1.2):.4f}" in sheet
    drawing = job.with_suffix(".svg").read_text()
    assert "slow, fast, slow" in drawing
    assert f"{found.size_mm[0]:.3f} mm along x" in drawing


@pytest.mark.parametrize("name", ["spiral", "joint", "comb", "bridge"])
def test_other_patterns_stay_in_their_frame_and_write_what_they_say(
    name: str, tmp_path: Path
) -> None:
    job = tmp_path / "job.gcode"
    short = {"bridge": ("--height", "0.5", "--spans", "1,2"), "spiral": ("--turns", "2")}
    words = (*BATH, *short.get(name, ()))
    assert pattern(name, "--needle", "25g", *words, "-o", job).exit_code == 0
    run = dry_run(job.read_bytes(), PRINTER, AT)
    begin, end, volume, _ = written(run)
    found = read_pattern(job.with_suffix(".json")).pattern
    length = sum(stroke.length_mm for stroke in found.strokes)
    assert volume.sum() == pytest.approx(length * math.pi / 4 * 0.26**2, rel=2e-3)
    corner = np.array(AT)[:2] - np.array(found.size_mm) / 2
    places = np.vstack([begin, end])[:, :2] - corner
    assert places.min() > -1e-3
    assert (places <= np.array(found.size_mm) + 1e-3).all()
    assert end[:, 2].max() == pytest.approx(5 + found.top_mm, abs=1e-3)
    assert found.top_mm > 0.5 - 1e-9 if name == "bridge" else found.top_mm == 0


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--length", "50"), "dish's wall"),
        (("--at", "100,100,0.5"), "floor"),
        (("--at", "3,100,5"), "x, lowest"),
    ],
)
def test_a_print_that_does_not_fit_is_refused(
    words: tuple[str, ...], says: str, tmp_path: Path
) -> None:
    job = tmp_path / "lines.gcode"
    with pytest.raises(SafetyError, match=says):
        pattern("lines", "--needle", "25g", *BATH, "--dish-centre", "100,100", *words, "-o", job)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("lines", "--speeds", "2,fast"), "--speeds"),
        (("lines", "--speeds", "0,2"), "above 0"),
        (("lines", "--flow-factors", "80,100"), "0.2 to 3"),
        (("lines", "--repeats", "9"), "a sheet holds 60"),
        (("lines", "--length", "3"), "short for a width"),
        (("spiral", "--pitch", "0.3"), "no room"),
        (("comb", "--gaps", "0.2"), "2 to 24 different"),
        (("comb", "--gaps", "-0.1,0.2"), "above 0"),
        (("joint", "--overlaps", "0,9"), "-4 to 2 radii"),
        (("bridge", "--height", "90"), "1 to 200"),
        (("squares", "--across", "12"), "give 16 mm or more"),
        (("lines", "--width", "0"), "--width"),
        (("lines", "-o", "lines.csv"), "end it in .gcode"),
        (("lines", "--printer", "pneumatic_marlin"), "weigh its flow"),
    ],
)
def test_what_cannot_be_printed_is_named(words: tuple[str, ...], says: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=says):
        out = () if "-o" in words else ("-o", tmp_path / "job.gcode")
        pattern("--needle", "25g", *out, *words)


def test_a_pattern_s_file_that_was_changed_is_refused(tmp_path: Path) -> None:
    job = tmp_path / "comb.gcode"
    assert pattern("comb", "--needle", "25g", "-o", job).exit_code == 0
    path = job.with_suffix(".json")
    said = json.loads(path.read_text())
    said["bead"]["width_mm"] = 0.3
    path.write_text(json.dumps(said))
    with pytest.raises(UsageError, match="was changed"):
        read_pattern(path)
    for text, says in (("{", "isn't a pattern"), ("[]", "isn't a pattern"), ("", "isn't a")):
        path.write_text(text)
        with pytest.raises(UsageError, match=says):
            read_pattern(path)
    path.write_text(json.dumps(said | {"at_mm": [1, 2]}))
    with pytest.raises(UsageError, match="isn't whole"):
        read_pattern(path)
    del said["strokes"]
    path.write_text(json.dumps(said))
    with pytest.raises(UsageError, match="isn't whole"):
        read_pattern(path)
