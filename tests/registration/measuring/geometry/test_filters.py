"""Gaussian profile filters against ISO 16610-21's transmission."""

from __future__ import annotations

import numpy as np
import pytest

from registration.measuring.geometry.lumen import closed_filtered, open_filter


def test_a_wave_of_the_cut_offs_length_keeps_half() -> None:
    angle = 2 * np.pi * np.arange(48) / 48
    wave = closed_filtered(np.cos(7 * angle), 7.0)
    assert np.ptp(wave) / 2 == pytest.approx(0.5, abs=0.01)
    along = np.linspace(0, 20, 801)
    kept = open_filter(along, 1.0) @ np.cos(2 * np.pi * along)
    assert np.ptp(kept[200:600]) / 2 == pytest.approx(0.5, abs=0.01)


def test_a_slope_passes_whole_to_its_ends() -> None:
    along = np.sort(np.random.default_rng(0).uniform(0, 5, 40))
    assert open_filter(along, 0.5) @ (3 + 2 * along) == pytest.approx(3 + 2 * along, abs=1e-6)


def test_weights_sum_to_one_where_sections_stand_alone() -> None:
    along = np.array([0.0, 0.1, 5.0])
    weights = open_filter(along, 0.3)
    assert weights.sum(axis=1) == pytest.approx(1.0)
    assert weights[2, 2] == pytest.approx(1.0)
