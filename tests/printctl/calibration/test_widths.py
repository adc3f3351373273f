"""`printctl calibrate widths`: constants recovered from synthetic widths."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image

from firmware_profiles import Ink, Needle, Printer, Syringe, load
from gcode.dry_run.run import dry_run
from printctl.calibration.lag import LagPattern, expected_width
from printctl.calibration.patterns import WrittenPattern, read_pattern
from printctl.checks.bead import predict_job
from printctl.checks.set_up import HeadLoading
from printctl.errors import UsageError
from registration.devices.lens import Board, Lens, find_board, read_lens, write_lens
from tests.printctl.calibration.test_commands import calibrate
from tests.registration.devices.lens.rendered import Rig, photographed
from tests.registration.devices.microscope.rendered import Camera, Painted, paint

NEEDLE = ("--needle", "25g")
FEW = ("--speeds", "2,8", "--flow-factors", "0.9,1.2", "--round", "--width", "0.3")


def printed(folder: Path, *words: str) -> WrittenPattern:
    assert calibrate("pattern", *words, *NEEDLE, "-o", folder / "p.gcode").exit_code == 0
    return read_pattern(folder / "p.json")


def answer(*words: str | Path) -> tuple[dict[str, dict[str, float]], str]:
    done = calibrate("widths", *words, "--json")
    assert done.exit_code == 0, done.output
    said = json.loads(done.stdout)
    return said["estimates"], "\n".join(said["notes"])


def rows_of(path: Path) -> list[str]:
    """Rows below the sheet's head."""
    return [line for line in path.read_text().splitlines() if line[0] != "#"][1:]


def head_of(path: Path) -> list[str]:
    lines = path.read_text().splitlines()
    return lines[: len(lines) - len(rows_of(path))]


def sheet(folder: Path, last: list[str]) -> Path:
    """Fill in the last column."""
    path = folder / "p.csv"
    rows = [line + value for line, value in zip(rows_of(path), last, strict=True)]
    path.write_text("\n".join([*head_of(path), *rows]) + "\n")
    return path


def typed_lines(
    folder: Path, written: WrittenPattern, area: float, lag: float, power: float = 0.0
) -> Path:
    """Widths of lines whose cross-section is ``area`` times the commanded one, read to 1 µm."""
    rng = np.random.default_rng(5)
    strokes = {stroke.number: stroke for stroke in written.pattern.strokes if stroke.number}
    values = []
    for row in rows_of(folder / "p.csv"):
        number, x = row.split(",")[:2]
        stroke = strokes[int(number)]
        if stroke.role == "step":
            shape = LagPattern(2, 8, stroke.length_mm / 3, 0.3, 0.1, "round")
            width = expected_width(np.array([float(x)]), area, lag, lag, shape)[0]
        else:
            late = 1 - math.exp(-float(x) / (float(stroke.speed_mm_s[0]) * lag))
            share = area * late * float(stroke.speed_mm_s[0]) ** power
            width = 0.3 * math.sqrt(share * stroke.flow)
        values.append(f"{width + rng.normal(0, 0.002):.3f}")
    return sheet(folder, values)


def test_typed_widths_give_flow_factor_and_lag(tmp_path: Path) -> None:
    written = printed(tmp_path, "lines", *FEW, "--repeats", "2")
    path = typed_lines(tmp_path, written, 0.85, 0.25)
    found, notes = answer(path, "--write", tmp_path / "ink.yaml")
    factor = found["flow factor"]
    assert factor["low"] < 0.85 < factor["high"]
    assert factor["high"] - factor["low"] < 0.06
    lag = found["τ, flow going up"]
    assert lag["low"] < 0.25 < lag["high"]
    assert lag["value"] == pytest.approx(0.25, rel=0.15)
    assert "follows the speed" in notes
    assert "can't tell the flow factor from swelling" in notes
    assert "nothing of the ink's viscosity" in notes
    ink = load(Ink, str(tmp_path / "ink.yaml"))
    assert ink.flow_factor == pytest.approx(0.85, abs=0.02)
    assert ink.lag is not None
    assert ink.lag.needle == load(Needle, "25g").name
    assert ink.write_speed_mm_s is None  # nobody said that the lines are whole
    # With the flow factor weighed, what is left is swelling: s = √(0.85/0.8).
    found, _ = answer(path, "--flow-factor", "0.8", "--write", tmp_path / "swell.yaml")
    swelling = found["swelling (diameter over that written)"]
    assert swelling["low"] < math.sqrt(0.85 / 0.8) < swelling["high"]
    assert load(Ink, str(tmp_path / "swell.yaml")).flow_factor == 0.8


def test_lines_on_a_plate_of_a_known_flow_give_the_ink_s_bead(tmp_path: Path) -> None:
    """Lines 0.3 mm wide and 0.1 high, of 0.9 times the ink, found 25 µm wider than area/height."""
    flat = ["--flat" if word == "--round" else word for word in FEW]
    written = printed(tmp_path, "lines", *flat, "--layer", "0.1", "--steps", "0")
    assert not written.pattern.bead.round_bead
    mean = 0.3 - 0.1 * (1 - math.pi / 4)
    strokes = {stroke.number: stroke for stroke in written.pattern.strokes if stroke.number}
    rng, values = np.random.default_rng(4), []
    for row in rows_of(tmp_path / "p.csv"):
        flow = strokes[int(row.split(",")[0])].flow
        values.append(f"{0.9 * flow * mean + 0.025 + rng.normal(0, 0.001):.4f}")
    path = sheet(tmp_path, values)
    found, _ = answer(path, "--flow-factor", "0.9", "--write", tmp_path / "ink.yaml")
    bead = found["width over area / height (bead)"]
    assert bead["low"] < 25 < bead["high"]
    assert bead["high"] - bead["low"] < 8
    ink = load(Ink, str(tmp_path / "ink.yaml"))
    assert ink.bead == pytest.approx(25, abs=4)
    assert ink.flow_factor == 0.9


def test_from_a_simulated_print_to_the_ink_s_profile(tmp_path: Path) -> None:
    """Flow factor 0.9 and a lag of 0.3 s, laid by `gcode.bead`, swollen, painted, measured."""
    printer, syringe = load(Printer, "generic_marlin"), load(Syringe, "hamilton_1ml")
    written = printed(tmp_path, "lines", *FEW, "--steps", "2", "--length", "20")
    gcode = (tmp_path / "p.gcode").read_bytes()
    run = dry_run(gcode, printer, (100, 100, 5))
    ink = load(Ink, "collagen_fresh").model_copy(update={"flow_factor": 0.9})
    mounted = HeadLoading(syringe, ink, load(Needle, "25g"))
    bead = predict_job(run, gcode, printer, [mounted], lag_s=0.3)[0].bead
    corner = np.array([100, 100]) - np.array(written.pattern.size_mm) / 2
    lines = [
        Painted(
            np.array([bead.pieces.start[k, :2], bead.pieces.end[k, :2]]) - corner,
            np.full(2, 1.05 * bead.width_mm[k]),
            round_ends=False,
        )
        for k in np.flatnonzero(bead.lays & bead.writes)
    ]
    camera = Camera(um_per_px=22, turn_deg=12, tilt=0.02, noise=0.03, per_mm=8.0)
    picture = tmp_path / "seen.png"
    cv2.imwrite(str(picture), paint(lines, camera, written.pattern.size_mm, seed=2))
    words = (picture, "--pattern", tmp_path / "p.json")
    found, notes = answer(*words, "--write", tmp_path / "ink.yaml")
    assert found["flow factor"]["value"] == pytest.approx(0.9 * 1.05**2, rel=0.03)
    for name in ("τ, flow going up", "τ, flow going down"):
        assert found[name]["value"] == pytest.approx(0.3, rel=0.1)
    assert "lets light through" in notes
    mended = load(Ink, str(tmp_path / "ink.yaml"))
    assert mended.write_speed_mm_s is not None
    assert (mended.write_speed_mm_s.low, mended.write_speed_mm_s.high) == (2, 8)
    assert (tmp_path / "seen.measured.png").stat().st_size > 10_000
    # The widths that were measured are a sheet like any other.
    again, _ = answer(tmp_path / "seen.widths.csv", "--pattern", tmp_path / "p.json")
    value = found["flow factor"]["value"]
    assert again["flow factor"]["value"] == pytest.approx(value, rel=1e-3)
    with pytest.raises(UsageError, match="--um-per-px 30"):
        calibrate("widths", *words, "--um-per-px", "30")


def test_a_spiral_tells_factor_drift_and_the_lag_of_its_begin(tmp_path: Path) -> None:
    written = printed(tmp_path, "spiral", "--round", "--width", "0.3", "--speed", "4")
    (stroke,) = written.pattern.of_role("spiral")
    rng = np.random.default_rng(1)
    rows = []
    for x in np.arange(0.5, stroke.length_mm, 0.7):
        t = x / 4
        share = 0.95 * (1 + 0.002 * (t - stroke.length_mm / 8)) * (1 - 0.7 * math.exp(-t / 0.8))
        width = 0.3 * math.sqrt(share) + rng.normal(0, 1e-3)
        rows.append(f"1,{x:.3f},4,1,0.3,{width:.5f}")
    path = tmp_path / "p.csv"
    path.write_text("\n".join([*head_of(path), *rows]))
    found, notes = answer(path)
    assert found["flow factor"]["value"] == pytest.approx(0.95, rel=0.01)
    drift = found["drift"]
    assert drift["low"] < 12.0 < drift["high"]  # 0.2 % a second
    assert drift["low"] > 5
    assert found["τ, from its begin"]["value"] == pytest.approx(0.8, rel=0.1)
    assert "the flow drifts" in notes


@pytest.mark.parametrize(
    ("row", "says"),
    [
        ("1,12,2,1,0.3,wide", "'wide', not a number"),
        ("1,12,2,1,0.3,-0.3", "isn't above 0"),
        ("1,12,2,1,0.3,310", "looks like µm: write 0.31"),
        ("1,12,2,1,0.3,4", "more than 5 times off"),
        ("99,12,2,1,0.3,0.3", "no such line"),
        ("1,77,2,1,0.3,0.3", "it is 24 mm long"),
        ("1,12,2,1,0.3,", "no reading"),
        ("1,20,2,1,0.3286,0.3", "1 of 4 lines"),
    ],
)
def test_what_cannot_be_a_width_is_questioned(row: str, says: str, tmp_path: Path) -> None:
    printed(tmp_path, "lines", *FEW)
    path = tmp_path / "p.csv"
    path.write_text("\n".join([*head_of(path), row]) + "\n")
    with pytest.raises(UsageError, match=says):
        calibrate("widths", path)


def test_another_print_s_sheet_and_answers_that_are_none_are_refused(tmp_path: Path) -> None:
    printed(tmp_path, "bridge", "--spans", "1,2", "--height", "0.5")
    path = sheet(tmp_path, ["1", "2"])
    with pytest.raises(UsageError, match="write 1 where it held"):
        calibrate("widths", path)
    path.write_text(path.read_text().replace("pattern=", "pattern=1"))
    with pytest.raises(UsageError, match="is the sheet of pattern no"):
        calibrate("widths", path)
    printed(tmp_path, "comb", "--gaps", "0.1,0.2")
    with pytest.raises(UsageError, match="looks like µm"):
        calibrate("widths", sheet(tmp_path, ["0", "190"]))
    with pytest.raises(UsageError, match="doesn't exist"):
        calibrate("widths", tmp_path / "nothing.csv")
    with pytest.raises(UsageError, match="--pattern"):
        (tmp_path / "q.csv").write_text("gap,gap_mm\n1,0\n")
        calibrate("widths", tmp_path / "q.csv")


def test_comb_and_joints_are_read_from_their_pictures(tmp_path: Path) -> None:
    """Lines 60 µm wider than commanded close gaps up to 60 µm, and reach 30 µm farther."""
    asked = {"comb": ("--gaps", "0.04,0.15,0.25,0.4"), "joint": ("--overlaps", "-4,-3,-1,1")}
    found: dict[str, Any] = {}
    for name, words in asked.items():
        written = printed(tmp_path, name, *words, "--round", "--width", "0.3")
        lines = [
            Painted(stroke.points[:, :2], np.full(len(stroke.points), 0.36))
            for stroke in written.pattern.strokes
        ]
        camera = Camera(um_per_px=25, turn_deg=-20, mirrored=name == "joint", blur_px=1.0)
        cv2.imwrite(str(tmp_path / "p.png"), paint(lines, camera, written.pattern.size_mm))
        found[name], notes = answer(tmp_path / "p.png")
        assert ("mirrored" in notes) == (name == "joint")
        rows = rows_of(tmp_path / "p.widths.csv")
        found[name]["gaps"] = [float(row.split(",")[-1]) for row in rows]
    gap = found["comb"]["smallest gap that stays open"]
    assert (gap["low"], gap["value"]) == (0.04, 0.15)
    assert found["comb"]["gaps"] == pytest.approx([0, 0.09, 0.19, 0.34], abs=0.012)
    assert found["comb"]["teeth wider than commanded by"]["value"] == pytest.approx(0.06, abs=0.01)
    # At -4 radii 4 · 0.15 mm from the trunk's surface; both are thicker, and ends are round.
    ends = [4 * 0.15 - 0.03 - 0.18, 3 * 0.15 - 0.03 - 0.18, 0, 0]
    assert found["joint"]["gaps"] == pytest.approx(ends, abs=0.015)
    assert found["joint"]["least overlap that joins"]["value"] == -1


# --- `printctl calibrate board` and `camera`: widths scaled by a board
BOARD = ("--squares", "11,8", "--square-mm", "2")
TOO_LARGE = 1.01


def flow_factor(*words: str | Path) -> tuple[float, str]:
    done = calibrate("widths", *words, "--json")
    assert done.exit_code == 0, done.output
    said = json.loads(done.stdout)
    return said["estimates"]["flow factor"]["value"], "\n".join(said["notes"])


def test_a_board_is_written_at_its_size_and_found(tmp_path: Path) -> None:
    path = tmp_path / "board.png"
    assert calibrate("board", path, *BOARD, "--dpi", "600").exit_code == 0
    with Image.open(path) as written:
        assert written.size[0] == pytest.approx(13 * 2 / 25.4 * 600, abs=13)
        size_mm = np.array(written.size) / written.info["dpi"] * 25.4
        assert size_mm == pytest.approx([13 * 2, 10 * 2], rel=1e-4)
    assert len(find_board(path, Board(11, 8, 2.0, 1.5)).pixels) == 70
    with pytest.raises(UsageError, match="raise --dpi"):
        calibrate("board", path, "--square-mm", "0.5", "--dpi", "300")
    with pytest.raises(UsageError, match="write it like 11,8"):
        calibrate("board", path, "--square-mm", "2", "--squares", "11")


def test_a_camera_is_calibrated_by_one_picture(tmp_path: Path) -> None:
    rig, seen, kept = Rig(distortion=(-0.3, 0.0)), tmp_path / "seen.png", tmp_path / "camera.yaml"
    assert cv2.imwrite(str(seen), photographed(Board(11, 8, 2.0, 1.5), rig))
    done = calibrate("camera", seen, *BOARD, "--write", kept, "--json")
    (scale,) = json.loads(done.stdout)["estimates"].values()
    assert scale["low"] < rig.true_um_per_px < scale["high"]
    assert read_lens(kept).um_per_px == pytest.approx(rig.true_um_per_px, rel=2e-4)


def seen_through(rig: Rig, image: np.ndarray) -> np.ndarray:
    """The same picture by a lens that distorts."""
    u, v = np.meshgrid(*(np.arange(side, dtype=float) for side in rig.size_px))
    at = rig.ideal(np.column_stack([u.ravel(), v.ravel()])).astype(np.float32)
    mapped = at.T.reshape(2, *u.shape)
    return cv2.remap(image, mapped[0], mapped[1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)


def painted(written: WrittenPattern) -> list[Painted]:
    """As designed, but for a printer whose axes go too far; lines as wide as they should be."""
    bead = written.pattern.bead
    return [
        Painted(TOO_LARGE * s.points[:, :2], np.full(len(s.points), bead.width_at(s.flow)))
        for s in written.pattern.strokes
    ]


@pytest.mark.slow
def test_widths_are_those_of_the_board_where_axes_and_lens_are_wrong(tmp_path: Path) -> None:
    words = ("--speeds", "2,8", "--flow-factors", "0.9,1.2", "--round", "--width", "0.3")
    assert calibrate("pattern", "lines", *words, "--needle", "25g",
                     "-o", tmp_path / "p.gcode").exit_code == 0  # fmt: skip
    written = read_pattern(tmp_path / "p.json")
    seen = Camera(um_per_px=30, noise=0.02, per_mm=8.0)
    image = paint(painted(written), seen, written.pattern.size_mm, 3)
    side = image.shape[0]
    rig = Rig((side, side), 3.0 * side, (0.4, 0.0), 30.0)
    picture, camera = tmp_path / "p.png", tmp_path / "camera.yaml"
    assert cv2.imwrite(str(picture), seen_through(rig, image))
    u, v = rig.middle_px.tolist()
    write_lens(
        camera,
        Lens(size_px=(side, side), focal_px=rig.focal_px, centre_px=(u, v),
             distortion=rig.distortion, um_per_px=30.0, um_per_px_95=(29.99, 30.01), off_px=0.05),
    )  # fmt: skip
    plain, _ = flow_factor(picture)
    found, notes = flow_factor(picture, "--camera", camera)
    assert plain < 0.985
    assert found == pytest.approx(1.0, abs=0.008)
    assert "the frame is printed +1.0" in notes
    with pytest.raises(UsageError, match="leave --um-per-px out, or --camera"):
        calibrate("widths", picture, "--camera", camera, "--um-per-px", "30")
