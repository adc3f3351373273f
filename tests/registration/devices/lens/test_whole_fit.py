"""Lens with optical axis, tangential terms and covariance, from tilted boards."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.checkers.dish_camera import Optics, aimed
from registration.devices.lens import BoardView, fit_lens, read_lens, write_lens

CAMERA = Optics((1600, 1200), 2400.0, (815.0, 590.0), (-0.25, 0.1), (1e-3, -7e-4), np.eye(3),
                np.zeros(3))  # fmt: skip


def boards(count: int, tilted: bool) -> list[BoardView]:
    """Corners with 0.06 px of noise."""
    rng = np.random.default_rng(2)
    x, y = np.meshgrid((np.arange(10) - 4.5) * 9.0, (np.arange(7) - 3.0) * 9.0)
    flat = np.column_stack([x.ravel(), y.ravel()])
    views = []
    for n in range(count):
        tilt = np.radians(30 if tilted and n else 0)
        rotation, centre = aimed(np.zeros(3), 175.0 + 5 * n, tilt, 2.4 * n, 1.1 * n)
        camera = replace(CAMERA, rotation=rotation, centre=centre)
        pixels = camera.pixels(np.column_stack([flat, 0 * flat[:, 0]]))
        views.append(BoardView(flat, pixels + rng.normal(0, 0.06, pixels.shape), CAMERA.size))
    return views


def test_all_numbers_are_found_within_their_covariance(tmp_path: Path) -> None:
    lens = fit_lens(boards(8, tilted=True))
    true = np.array([CAMERA.focal, *CAMERA.axis, *CAMERA.k, *CAMERA.p])
    off = lens.numbers[:7] - true
    known = np.array(lens.covariance)[:7, :7]
    assert off @ np.linalg.solve(known, off) < 24.3  # 0.1 % of seven degrees of freedom
    assert np.sqrt(known[0, 0]) < 0.005 * CAMERA.focal
    write_lens(tmp_path / "lens.yaml", lens)
    assert read_lens(tmp_path / "lens.yaml") == lens


def test_boards_that_lie_square_to_the_camera_tell_less() -> None:
    lens = fit_lens(boards(6, tilted=False))
    assert lens.covariance is None
    assert len(lens.distortion) == 2
