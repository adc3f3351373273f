"""Cross-check of a pose by another program."""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from design.solids import block_solid
from registration.alignment import Fit, cross_check
from registration.alignment.distance import ModelSurface
from registration.measuring.gauging import surface_points

SIZE = np.array([8.0, 5.0, 3.0])
PLACE = Fit(np.eye(3), np.array([1.0, -2.0, 3.0]), np.array([1.02, 1.0, 0.99]), SIZE / 2)


@cache
def spread():
    return surface_points(model_surface())


@cache
def model_surface():
    return ModelSurface.of(block_solid(SIZE.tolist()))


def scanned() -> np.ndarray:
    rng = np.random.default_rng(0)
    chosen = spread()[rng.choice(len(spread()), 20_000, replace=False)]
    return PLACE.invert(chosen + rng.normal(0, 0.003, chosen.shape))


def test_it_comes_back_to_a_pose_that_is_right() -> None:
    pytest.importorskip("small_gicp")
    assert cross_check(model_surface(), spread(), scanned(), PLACE) < 2.0


def test_it_says_how_far_off_a_wrong_one_is() -> None:
    pytest.importorskip("small_gicp")
    wrong = replace(PLACE, shift=PLACE.shift + np.array([0.0, 0.05, 0.0]))
    assert cross_check(model_surface(), spread(), scanned(), wrong) == pytest.approx(50.0, abs=3.0)


def test_without_the_program_nothing_is_said(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "small_gicp", None)
    assert cross_check(model_surface(), spread(), scanned(), PLACE) is None
