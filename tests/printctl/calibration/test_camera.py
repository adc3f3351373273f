"""`printctl calibrate board` and `camera`: widths scaled by a board."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner, Result

from printctl.calibration.patterns import WrittenPattern, read_pattern
from printctl.cli.main import app
from printctl.errors import UsageError
from registration.devices.lens import Board, Lens, find_board, read_lens, write_lens
from tests.registration.devices.lens.rendered import Rig, photographed
from tests.registration.devices.microscope.rendered import Camera, Painted, paint

BOARD = ("--squares", "11,8", "--square-mm", "2")
TOO_LARGE = 1.01


def calibrate(*words: str | Path) -> Result:
    return CliRunner().invoke(app, ["calibrate", *map(str, words)], catch_exceptions=False)


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
