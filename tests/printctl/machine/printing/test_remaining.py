"""Remaining time of a print, and its journal's time at work."""

from __future__ import annotations

import numpy as np
import pytest

from printctl.machine.job.syringes import Filling
from printctl.machine.prints.progress import remaining_time
from printctl.machine.records.replay import replay


def test_the_error_told_covers_19_of_20_prints():
    rng, inside = np.random.default_rng(5), 0
    for _ in range(300):
        real = np.concatenate([[0.0], np.cumsum(10.0 * rng.normal(1.1, 0.2, 100))])
        told = remaining_time(1000.0, [(10.0 * k, float(real[k]), 1) for k in range(31)], 300.0)
        assert told.error_s is not None
        inside += abs(real[100] - real[30] - told.remaining_s) <= told.error_s
    assert 0.90 <= inside / 300 <= 0.99


def test_pauses_are_left_out_of_the_time_at_work():
    state = {"t": "state"}
    records = [
        {"t": "job", "sha256": "a", "started": 100.0, "at": 100.0},
        {**state, "state": "printing", "at": 110.0},
        {**state, "state": "pausing", "at": 150.0},
        {**state, "state": "paused", "at": 155.0},
        {"t": "syringe", "done": 42, "plunger_mm": 1.5, "at": 300.0},
        {**state, "state": "resuming", "at": 400.0},
        {**state, "state": "printing", "at": 410.0},
    ]
    found = replay(records)
    assert found.started == 100.0
    # While it is pausing, moves that were sent are made.
    assert found.active_until(425.0) == pytest.approx(60.0)
    assert found.filled == {None: Filling(42, 1.5, 0.0)}
    ended = replay([*records, {"t": "end", "state": "done", "at": 420.0}])
    assert ended.active_until(999.0) == pytest.approx(55.0)
    heard = {"t": "checkpoint", "done": 60, "at": 430.0}  # then its process died
    assert replay([*records, heard, {**records[0], "at": 500.0}]).active_s == pytest.approx(65.0)
