"""Clog, empty syringe, bubble and lost line are told apart."""

import numpy as np
import pytest

from printctl.observe.deciding import SupplyState, judge_supply

STROKE = np.repeat(np.arange(10), 20)


def judge(missing, left_ul=None, seen=None):
    present = np.ones(200)
    for part in missing:
        present[part] = 0.0
    seen = np.ones(200, bool) if seen is None else seen
    return judge_supply(np.full(200, 0.01), present, seen, STROKE, least_ul=0.02, left_ul=left_ul)


@pytest.mark.parametrize(
    ("missing", "left_ul", "state"),
    [
        ([], None, SupplyState.FLOWING),
        ([slice(50, 51)], None, SupplyState.FLOWING),
        ([slice(150, 200)], None, SupplyState.CLOGGED),
        ([slice(150, 200)], 500.0, SupplyState.CLOGGED),
        ([slice(150, 200)], 0.0, SupplyState.EMPTY),
        ([slice(195, 200)], None, SupplyState.BUBBLE),
        ([slice(70, 90)], None, SupplyState.BUBBLE),
        ([slice(60, 80)], None, SupplyState.LOST_LINE),
        ([slice(60, 80), slice(120, 140)], None, SupplyState.LOST_LINE),
        ([slice(180, 200)], None, SupplyState.LOST_LINE),  # the next look tells
        ([slice(180, 200)], 0.0, SupplyState.EMPTY),
        ([slice(160, 200)], None, SupplyState.CLOGGED),
        ([slice(3, 9), slice(45, 55), slice(101, 110)], None, SupplyState.INTERMITTENT),
    ],
)
def test_state(missing, left_ul, state):
    assert judge(missing, left_ul).state is state


def test_what_isnt_seen_tells_nothing():
    seen = np.ones(200, bool)
    seen[150:] = False
    assert judge([slice(150, 200)], seen=seen).state is SupplyState.FLOWING
    assert judge([], seen=np.zeros(200, bool)).state is SupplyState.UNKNOWN
