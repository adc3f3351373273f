"""Chips and bumps on a scanned face are listed where they are; noise and rounded rims aren't."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from design.geometry.surface import Surface
from registration.measuring.gauging.face_places import FacePlace, ScannedFaces
from registration.report.sections import place_rows

SIDE, STEP = 200, 0.025


def face() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A face of 5 × 5 mm with speckle of 12 µm, correlated over 60 µm: vertices, triangles, µm."""
    x, y = np.meshgrid(STEP * np.arange(SIDE), STEP * np.arange(SIDE), indexing="ij")
    corner = np.arange(SIDE * SIDE).reshape(SIDE, SIDE)
    a, b, c, d = corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]
    triangles = [np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)]
    noise = gaussian_filter(np.random.default_rng(5).normal(size=x.shape), 2.4, mode="wrap")
    vertices = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    return vertices, np.concatenate(triangles).astype(np.int32), 12 * noise.ravel() / noise.std()


def listed(off: np.ndarray, rims: np.ndarray | None = None) -> tuple[FacePlace, ...]:
    vertices, triangles, _ = face()
    none = np.zeros(len(off), dtype=bool)
    known = off[np.isfinite(off)]
    spread = 1.4826 * np.median(np.abs(known - np.median(known))) if len(known) else 0.0
    rims = none if rims is None else rims
    return ScannedFaces(Surface(vertices, triangles), off, rims, 50, float(spread)).places_off()


def away(x: float, y: float) -> np.ndarray:
    vertices = face()[0]
    return np.hypot(vertices[:, 0] - x, vertices[:, 1] - y)


def test_a_rim_rounded_by_the_blur_is_no_place_and_a_chipped_one_is() -> None:
    vertices, _, off = face()
    rim = vertices[:, 0] < 0.2
    rounded = off + 110 * (vertices[:, 0] < 0.1)
    assert listed(rounded, rim) == ()
    chipped = rounded + 250 * (away(0.0, 2.5) < 0.3)
    (chip,) = listed(chipped, rim)
    np.testing.assert_allclose(chip.at_mm, [0.1, 2.5, 0], atol=0.3)


def test_a_pit_and_a_bump_are_listed_with_sign_size_and_place() -> None:
    off = face()[2] + 300 * (away(3.0, 1.5) < 0.4) - 200 * (away(1.0, 4.0) < 0.3)
    pit, bump = listed(off)
    assert pit.deviation_um == pytest.approx(300, abs=30)
    assert bump.deviation_um == pytest.approx(-200, abs=30)
    assert pit.area_mm2 == pytest.approx(np.pi * 0.4**2, rel=0.1)
    np.testing.assert_allclose(pit.at_mm, [3.0, 1.5, 0], atol=0.4)
    np.testing.assert_allclose(bump.at_mm, [1.0, 4.0, 0], atol=0.3)
    rows = place_rows({"by_surface": {"outer_faces": {"places": [asdict(pit), asdict(bump)]}}})
    assert [float(row[1]) for row in rows] == pytest.approx([0.5, 0.28], abs=0.05)
