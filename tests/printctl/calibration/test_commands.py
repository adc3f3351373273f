"""`printctl calibrate`: printable test prints, and correct fits of their measurements."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from firmware_profiles import Ink, Needle, Printer, Syringe, load, steady_flow
from gcode.dry_run.run import DryRun, dry_run
from printctl.calibration import LagPattern
from printctl.calibration.lag import expected_width
from printctl.calibration.patterns import read_pattern
from printctl.cli.main import app
from printctl.errors import SafetyError, UsageError

PRINTER, SYRINGE = load(Printer, "generic_marlin"), load(Syringe, "hamilton_1ml")
AREA = math.pi / 4 * SYRINGE.inner_mm**2


NAMED = {
    "weigh": {"--printer": "generic_marlin", "--syringe": "hamilton_1ml"},
    "backlash": {"--printer": "generic_marlin", "--syringe": "hamilton_1ml"},
    "lag": {"--printer": "generic_marlin", "--syringe": "hamilton_1ml", "--ink": "collagen_fresh"},
    "pattern": {
        "--printer": "generic_marlin",
        "--syringe": "hamilton_1ml",
        "--ink": "collagen_fresh",
    },
}
"""What a command must know."""


def calibrate(*words: str | Path) -> Result:
    """Call the command, with what it must know where that isn't among the words."""
    usual = {key: value for key, value in NAMED.get(str(words[0]), {}).items() if key not in words}
    if "--gcode" not in words and words[0] == "backlash":
        usual = {}
    said = [*map(str, words), *(word for pair in usual.items() for word in pair)]
    return called(*said)


def called(*words: str | Path, command: str = "calibrate") -> Result:
    return CliRunner().invoke(app, [command, *map(str, words)], catch_exceptions=False)


def estimates(*words: str | Path) -> dict[str, dict[str, float]]:
    done = calibrate(*words, "--json")
    assert done.exit_code == 0, done.output
    found: dict[str, dict[str, float]] = json.loads(done.stdout)["estimates"]
    return found


def dry(path: Path, at: tuple[float, float, float]) -> DryRun:
    return dry_run(path.read_bytes(), PRINTER, at)


def filled(path: Path, column: np.ndarray) -> Path:
    """Fill in the last column of a sheet."""
    lines = path.read_text().splitlines()
    head = next(k for k, line in enumerate(lines) if not line.startswith("#"))
    rows = [f"{line}{value:.6f}" for line, value in zip(lines[head + 1 :], column, strict=True)]
    path.write_text("\n".join([*lines[: head + 1], *rows]) + "\n")
    return path


def test_weighing_from_the_test_to_the_mended_profile(tmp_path: Path) -> None:
    job = tmp_path / "weigh.gcode"
    assert calibrate("weigh", "--gcode", job, "--repeats", "3").exit_code == 0
    travel = read_readings_of(tmp_path / "weigh.csv", "travel_mm")
    run = dry(job, (100, 100, 50))
    assert run.plunger_max_mm == pytest.approx(travel.sum(), abs=1e-3)
    assert np.ptp(run.program.target[:, :2], axis=0).max() == 0  # it pushes, and moves nowhere
    mass = 0.96 * AREA * travel * 0.998 + np.random.default_rng(1).normal(0, 0.05, len(travel))
    sheet = filled(tmp_path / "weigh.csv", mass)
    found = estimates("weigh", sheet, "--density", "0.998", "--write", tmp_path / "mine.yaml")
    assert found["volume per travel"]["low"] < 0.96 * AREA < found["volume per travel"]["high"]
    mine = load(Printer, str(tmp_path / "mine.yaml"))
    assert mine.steps_per_mm.e == pytest.approx(6400 / 0.96, rel=5e-3)
    assert mine.steps_per_mm.x == PRINTER.steps_per_mm.x
    assert "measured by printctl calibrate" in mine.source
    assert (
        calibrate("weigh", sheet, "--mend", "bore", "--write", tmp_path / "s.yaml").exit_code == 0
    )
    bore = load(Syringe, str(tmp_path / "s.yaml")).inner_mm
    assert bore == pytest.approx(SYRINGE.inner_mm * math.sqrt(0.96), rel=2e-3)


def test_a_pneumatic_head_s_flow_from_the_test_to_the_profile(tmp_path: Path) -> None:
    job, head = tmp_path / "weigh.gcode", ("--printer", "pneumatic_marlin")
    short = ("--doses", "2,4,6", "--flow", "1", "--wait", "1")
    assert calibrate("weigh", *head, "--gcode", job, "--repeats", "2", *short).exit_code == 0
    open_s = read_readings_of(tmp_path / "weigh.csv", "open_s")
    printer = load(Printer, "pneumatic_marlin")
    run = dry_run(job.read_bytes(), printer, (100, 100, 50))
    assert printer.pneumatic is not None
    assert run.valve is not None
    # As long from command to command as the sheet says.
    for row, seconds in zip(np.flatnonzero(run.valve.state == 1), open_s, strict=True):
        inside = slice(run.valve.row[row], run.valve.row[row + 1])
        waits = run.program.value[inside][run.program.kind[inside] == 3]
        assert waits.sum() == pytest.approx(seconds)
    assert run.plunger_max_mm == 0
    mass = 0.31 * open_s * 1.02 + np.random.default_rng(2).normal(0, 0.002, len(open_s))
    sheet = filled(tmp_path / "weigh.csv", mass)
    fluid = ("--ink", "collagen_fresh", "--needle", "27g", "--density", "1.02")
    mine = tmp_path / "mine.yaml"
    found = estimates("weigh", sheet, *head, *fluid, "--write", mine)
    assert found["flow at 80 kPa"]["low"] < 0.31 < found["flow at 80 kPa"]["high"]
    mended = load(Printer, str(mine))
    assert mended.pneumatic is not None
    collagen = load(Ink, "collagen_fresh")
    flow = steady_flow(mended.pneumatic, collagen, load(Needle, "27g"))
    assert flow.measured
    assert flow.ul_s == pytest.approx(0.31, rel=0.01)
    # Another needle is not what was weighed.
    assert not steady_flow(mended.pneumatic, collagen, load(Needle, "30g")).measured
    assert "measured by printctl calibrate" in mended.source


@pytest.mark.parametrize("words", [("lag",), ("backlash", "--axis", "e")])
def test_a_test_of_the_plunger_is_refused_for_a_pneumatic_head(
    words: tuple[str, ...], tmp_path: Path
) -> None:
    job = tmp_path / "test.gcode"
    with pytest.raises(UsageError, match="weigh its flow instead"):
        calibrate(*words, "--printer", "pneumatic_marlin", "--gcode", job)
    assert not job.exists()
    done = calibrate("backlash", "--axis", "x", "--printer", "pneumatic_marlin", "--gcode", job)
    assert done.exit_code == 0


def read_readings_of(path: Path, column: str) -> np.ndarray:
    """A column of a sheet that isn't filled in yet."""
    lines = [line.split(",") for line in path.read_text().splitlines() if line[0] != "#"]
    return np.array([float(row[lines[0].index(column)]) for row in lines[1:]])


@pytest.mark.parametrize("axis", ["z", "e"])
def test_backlash_test_waits_where_its_sheet_says(axis: str, tmp_path: Path) -> None:
    job = tmp_path / "back.gcode"
    done = calibrate("backlash", "--axis", axis, "--gcode", job, "--wait", "4")
    assert done.exit_code == 0
    run = dry(job, (100, 100, 50))
    waits = np.flatnonzero(run.program.value == 4.0)
    along = run.program.plunger if axis == "e" else run.program.target[:, 2] - 50
    target = read_readings_of(tmp_path / "back.csv", "target_mm")
    np.testing.assert_allclose(along[waits], target, atol=2e-3)
    side = read_readings_of(tmp_path / "back.csv", "approach")
    before = along[waits - 2]  # the overshoot
    np.testing.assert_array_equal(np.sign(target - before), side)
    sheet = filled(tmp_path / "back.csv", target - side * 0.025 + 0.001 * np.cos(np.arange(10)))
    found = estimates("backlash", sheet)
    assert found["lost motion"]["low"] < 0.05 < found["lost motion"]["high"]


def test_lag_sheet_remembers_the_line_and_gives_the_ink_s_factor(tmp_path: Path) -> None:
    job = tmp_path / "lag.gcode"
    shape = ("--slow", "5", "--fast", "15", "--length", "30", "--width", "0.5")
    assert calibrate("lag", "--gcode", job, *shape).exit_code == 0
    pattern = LagPattern(5, 15, 30, 0.5, 0.2)
    x = read_readings_of(tmp_path / "lag.csv", "x_mm")
    width = expected_width(x, 0.9, 0.5, 0.5, pattern)
    width += np.random.default_rng(4).normal(0, 0.008, len(x))
    sheet = filled(tmp_path / "lag.csv", width)
    found = estimates("lag", sheet, "--write", tmp_path / "ink.yaml")
    assert found["flow factor"]["low"] < 0.9 < found["flow factor"]["high"]
    assert found["K (advance)"]["low"] < 0.5 < found["K (advance)"]["high"]
    ink = load(Ink, str(tmp_path / "ink.yaml"))
    assert ink.flow_factor == pytest.approx(0.9, abs=0.02)
    assert not ink.calibrated  # one constant of several
    # Printed again with that ink's factor, the factors multiply.
    with pytest.raises(SafetyError, match="ink that the job was made for"):
        calibrate("lag", sheet, "--ink", tmp_path / "ink.yaml")
    assert calibrate("lag", "--gcode", job, *shape, "--ink", tmp_path / "ink.yaml").exit_code == 0
    sheet = filled(tmp_path / "lag.csv", width)
    again = estimates("lag", sheet, "--ink", tmp_path / "ink.yaml")
    assert again["flow factor"]["value"] == pytest.approx(ink.flow_factor**2, rel=1e-6)


def test_level_tells_tilt_and_depth(tmp_path: Path) -> None:
    rows = ["surface,x_mm,y_mm,z_mm"]
    for x, y in ((0, 0), (60, 0), (0, 60), (60, 60), (30, 30)):
        rows += [f"bed,{x},{y},{0.1 + 0.001 * x:.4f}", f"bath,{x},{y},8.15"]
    (tmp_path / "level.csv").write_text("\n".join(rows))
    found = estimates("level", tmp_path / "level.csv")
    assert found["bed, rise along x"]["value"] == pytest.approx(0.1)
    assert found["depth of the bath (bath_depth_mm)"]["value"] == pytest.approx(8.02)


def test_offset_tells_one_needle_from_the_other(tmp_path: Path) -> None:
    rows = ["needle,x_mm,y_mm,z_mm"]
    rows += [f"old,{100 + e},50,3" for e in (-0.01, 0, 0.01)]
    rows += [f"new,{100.3 + e},49.9,3.5" for e in (-0.01, 0, 0.01)]
    (tmp_path / "offset.csv").write_text("\n".join(rows))
    found = estimates("offset", tmp_path / "offset.csv")
    assert found["new less old, x"]["value"] == pytest.approx(0.3)
    assert found["new less old, y"]["value"] == pytest.approx(-0.1)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "is empty"),
        ("travel_mm\n1\n", "line 1: no column 'mass_mg'"),
        ("travel_mm,mass_mg\n1,\n", "no reading"),
        ("travel_mm,mass_mg\n# remark\n1,x\n", "line 3: mass_mg is 'x'"),
    ],
)
def test_a_bad_sheet_is_named_with_its_line(text: str, says: str, tmp_path: Path) -> None:
    path = tmp_path / "weigh.csv"
    path.write_text(text)
    with pytest.raises(UsageError, match=says):
        calibrate("weigh", path)


def test_a_test_that_leaves_the_work_area_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SafetyError, match="x, highest"):
        calibrate("lag", "--gcode", tmp_path / "lag.gcode", "--at", "150,100,1")
    assert not (tmp_path / "lag.gcode").exists()


# --- `printctl calibrate offset --printer`: offset of a second head, with its sign
SHEET = """needle,x_mm,y_mm,z_mm
left,100.00,80.00,12.00
left,100.02,80.01,12.01
left,99.98,79.99,11.99
right,60.10,80.50,12.30
right,60.12,80.51,12.31
right,60.08,80.49,12.29
"""
"""Where the carriage stands with each tip on one mark: the right tip stands out by +39.9 in x."""


def offset(folder: Path, *words: str) -> str:
    sheet = folder / "offset.csv"
    sheet.write_text(SHEET)
    done = calibrate("offset", sheet, *words)
    assert done.exit_code == 0, done.output
    return str(done.output)


def test_the_tip_stands_as_much_farther_as_the_carriage_less_far(tmp_path: Path) -> None:
    mended = tmp_path / "mine.yaml"
    offset(tmp_path, "--printer", "two_syringe_marlin", "--write", str(mended))
    printer = load(Printer, str(mended))
    assert printer.heads[1].offset_mm.mm == pytest.approx((39.9, -0.5, -0.3), abs=1e-3)
    assert printer.heads[0].offset_mm.mm == (0, 0, 0)
    assert printer.heads[1].raises == "M280 P1 S90"
    assert "heads.1.offset_mm measured by printctl calibrate" in printer.source
    assert all(f"{axis} {value}" in printer.source for axis, value in (("x", 39.9), ("z", -0.3)))


def test_a_head_that_isn_t_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="has no head 2"):
        offset(tmp_path, "--printer", "two_syringe_marlin", "--head", "2")
    with pytest.raises(UsageError, match="has no head 1"):
        offset(tmp_path, "--printer", "generic_marlin")
    with pytest.raises(UsageError, match="give --printer"):
        offset(tmp_path, "--write", "x.yaml")


# --- `printctl calibrate pattern`: G-code, sheet and pattern file agree
BORE = math.pi / 4 * SYRINGE.inner_mm**2
AT = (100.0, 100.0, 5.0)
BATH = ("--bath", "gelatin_support", "--dish", "petri_60mm", "--bath-depth", "10")


def written(run: DryRun) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Begin, end, µL and mm/s of each move that pushes ink on its way."""
    ends = np.vstack([run.program.start[None, :3], run.program.target[:, :3]])
    pushed = np.diff(run.program.plunger, prepend=0) * BORE
    rows = (pushed > 0) & (np.linalg.norm(np.diff(ends, axis=0), axis=1) > 0)
    return ends[:-1][rows], ends[1:][rows], pushed[rows], run.program.feed[rows]


def test_lines_are_written_as_the_sheet_says(tmp_path: Path) -> None:
    job = tmp_path / "lines.gcode"
    asked = ("--speeds", "2,6", "--flow-factors", "0.8,1.2", "--steps", "1", "--width", "0.4")
    done = calibrate("pattern", "lines", "--needle", "25g", *BATH, *asked, "-o", job)
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
    assert calibrate("pattern", name, "--needle", "25g", *words, "-o", job).exit_code == 0
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
        (("--length", "50"), "dish wall"),
        (("--at", "100,100,0.5"), "floor"),
        (("--at", "3,100,5"), "x, lowest"),
    ],
)
def test_a_print_that_does_not_fit_is_refused(
    words: tuple[str, ...], says: str, tmp_path: Path
) -> None:
    job = tmp_path / "lines.gcode"
    with pytest.raises(SafetyError, match=says):
        calibrate(
            "pattern",
            "lines",
            "--needle",
            "25g",
            *BATH,
            "--dish-centre",
            "100,100",
            *words,
            "-o",
            job,
        )
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
        calibrate("pattern", "--needle", "25g", *out, *words)


def test_a_pattern_s_file_that_was_changed_is_refused(tmp_path: Path) -> None:
    job = tmp_path / "comb.gcode"
    assert calibrate("pattern", "comb", "--needle", "25g", "-o", job).exit_code == 0
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
