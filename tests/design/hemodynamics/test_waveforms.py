"""Waveforms, and refusal of invalid ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from design.errors import FlowError
from design.hemodynamics.waveforms import SHAPES, Tabulated, read_waveform, shape

NAN = float("nan")


def test_a_table_repeats_and_is_joined_by_lines() -> None:
    wave = Tabulated(np.array([0.0, 1.0, 3.0]), np.array([0.0, 2.0, 0.0]))
    assert wave.period_s == 3.0
    assert wave.at(np.array([0.5, 2.0, 3.5, -1.0])) == pytest.approx([1.0, 1.0, 1.0, 1.0])
    open_end = Tabulated(np.array([0.0, 1.0]), np.array([0.0, 2.0]), period_s=2.0)
    assert open_end.at(np.array([1.5])) == pytest.approx([1.0])


def test_a_spline_follows_a_sine_through_few_samples() -> None:
    time = np.arange(24) / 12
    wave = Tabulated(time, np.sin(np.pi * time), 2.0, "spline")
    between = np.linspace(-1, 3, 97)
    assert wave.at(between) == pytest.approx(np.sin(np.pi * between), abs=2e-4)


def test_shapes_have_the_mean_they_are_asked_for() -> None:
    for name in SHAPES:
        wave = shape(name, 3.0, 0.8)
        assert wave.at(np.arange(4000) * 0.8 / 4000).mean() == pytest.approx(3.0, rel=1e-4)
    coronary = shape("kassab", 1.0, 0.7).at(np.arange(700) / 1000)
    # The trunk's 23.9 and 42.3 of a mean of 32.0 mL/min (Huo & Kassab 2006).
    assert (coronary.min(), coronary.max()) == pytest.approx((0.746, 1.322), abs=0.02)
    # Half a sine over 0.4 of the cycle has a mean of 0.4 · 2/π of its peak.
    peak = shape("ejection", 1.0, 1.0).at(np.array([0.2]))[0]
    assert peak == pytest.approx(np.pi / 0.8, rel=1e-3)


@pytest.mark.parametrize(
    ("time", "value", "period", "words"),
    [
        ([0, 1, 2], [1, NAN, 1], None, r"sample 2 of the waveform is missing \(1 of 3"),
        ([0, 1, 1], [1, 2, 1], None, "times don't rise: 1 s follows 1 s"),
        ([0, 1, 2], [1, 2, 1], -2.0, "period is -2 s"),
        ([0, 1, 2], [1, 2, 1], 1.5, "span 2 s, more than its period 1.5 s"),
        ([0, 1, 2], [1, 2, 2], None, "ends at 2 and began at 1"),
        ([0, 1], [1, 2, 1], None, "2 times and 3 values"),
        ([0], [1], None, "1 samples"),
    ],
)
def test_what_is_no_waveform_is_refused(time, value, period, words):
    with pytest.raises(FlowError, match=words):
        Tabulated(np.array(time, float), np.array(value, float), period)


def test_files_say_which_line_is_wrong(tmp_path: Path) -> None:
    path = tmp_path / "wave.csv"
    path.write_text("time_s,flow_ml_min\n0,1\n0.5,3\n1,1\n")
    wave = read_waveform(path, "flow_ml_min", 10.0)
    assert wave.at(np.array([0.25])) == pytest.approx([20.0])
    path.write_text("time_s,flow_ml_min\n0,1\n0.5,\n1,1\n")
    with pytest.raises(FlowError, match=r"wave.csv, line 3: '' is no number"):
        read_waveform(path, "flow_ml_min")
    path.write_text("t,q\n0,1\n")
    with pytest.raises(FlowError, match="no column time_s"):
        read_waveform(path, "flow_ml_min")
