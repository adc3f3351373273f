"""Chips and bumps on a scanned face are listed where they are; noise and rounded rims aren't."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from registration.gauging.face_places import places_off
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


def away(vertices: np.ndarray, x: float, y: float) -> np.ndarray:
    return np.hypot(vertices[:, 0] - x, vertices[:, 1] - y)


def test_speckle_and_a_rounded_rim_are_no_places() -> None:
    vertices, triangles, off = face()
    rim = vertices[:, 0] < 0.1
    assert places_off(vertices, triangles, off + 50 * rim) == []
    assert places_off(vertices, triangles, np.full(len(off), np.nan)) == []


def test_a_pit_and_a_bump_are_listed_with_sign_size_and_place() -> None:
    vertices, triangles, off = face()
    off = off + 300 * (away(vertices, 3.0, 1.5) < 0.4) - 200 * (away(vertices, 1.0, 4.0) < 0.3)
    pit, bump = places_off(vertices, triangles, off)
    assert pit["deviation_um"] == pytest.approx(300, abs=30)
    assert bump["deviation_um"] == pytest.approx(-200, abs=30)
    assert pit["area_mm2"] == pytest.approx(np.pi * 0.4**2, rel=0.1)
    np.testing.assert_allclose(pit["at_mm"], [3.0, 1.5, 0], atol=0.4)
    np.testing.assert_allclose(bump["at_mm"], [1.0, 4.0, 0], atol=0.3)
    rows = place_rows({"by_surface": {"outer_faces": {"places": [pit, bump]}}})
    assert [float(row[1]) for row in rows] == pytest.approx([0.5, 0.28], abs=0.05)


def test_lumens_cut_a_place_in_two_and_stay_out_of_it() -> None:
    vertices, triangles, off = face()
    off = off + 300 * (away(vertices, 2.5, 2.5) < 0.6)
    lumen = np.abs(vertices[:, 0] - 2.5) < 0.1
    assert len(places_off(vertices, triangles, np.where(lumen, np.nan, off))) == 2
