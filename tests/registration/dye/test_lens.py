"""Dye video through a distorting lens, with and without the camera's calibration."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from design.vasculature.named import planar_four_vessel
from registration.devices.lens import Lens
from registration.dye import DyeOptions, Marks, measure_dye
from registration.errors import DyeError
from sim.devices.dye import DyeFilm, dye_flow
from sim.devices.dye.film import film_frames
from tests.registration.devices.lens.rendered import Rig
from tests.registration.dye.films import PLANAR_CAMERA, PLANAR_FLOW, PLANAR_MARKS

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
