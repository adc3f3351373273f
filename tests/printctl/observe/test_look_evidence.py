"""Evidence of a look: readings of the flow, however short it is."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_profiles import Ink, load
from printctl.inspection import Stations, Stretch
from printctl.inspection.values import Gap
from printctl.observe.deciding import (
    FlowBlocks,
    FlowControl,
    GapTest,
    SupplyState,
    confirmed_gaps,
    judge_supply,
)
from printctl.observe.deciding.evidence import ThinStretch, confirm_thin
from printctl.observe.looks.expected_ink import ExpectedInk
from printctl.observe.looks.look_evidence import (
    _flow_blocks,
    thin_lines,
)

HEIGHT, WIDTH = 0.1, 0.25


def seen(lines, ratio, stations=40, noise=0.04, u_ratio=0.01, style="layered"):
    """Stations of lines of 7 mm at 20 mm/s, and the ink that was asked for."""
    rng = np.random.default_rng(3)
    section = load(Ink, "collagen_fresh").bead_section
    m, none = lines * stations, np.zeros((lines, 3))
    wanted = float(section.area(WIDTH, HEIGHT))
    full_width = section.width(wanted * np.broadcast_to(ratio, m), HEIGHT)
    if style == "embedded":
        wanted = np.pi / 4 * WIDTH**2
        full_width = WIDTH * np.sqrt(np.broadcast_to(ratio, m))
    width = full_width * (1 + noise * rng.standard_normal(m))
    full, row = np.ones(m), np.repeat(np.arange(lines), stations)
    along = np.tile(np.arange(stations), lines) * 0.17
    found = Stations(
        np.zeros((m, 2)), full, np.zeros((m, 2)), row, row, along,
        full * 0.17, full * WIDTH, width, full * noise * WIDTH, full * 0, full, full > 0, row * 0,
    )  # fmt: skip
    each = np.ones(lines)
    ink = ExpectedInk(
        (), none, none, each * WIDTH, each * HEIGHT, each * wanted, np.arange(lines),
        np.arange(lines), 0.35 * (np.arange(lines) + 0.5), each, style, each < 0,
    )  # fmt: skip
    return _flow_blocks(found, ink, row, u_ratio, section)


@pytest.mark.parametrize("lines", [1, 3, 40])
@pytest.mark.parametrize("ratio", [0.7, 1.3])
def test_a_step_of_the_flow_is_told_by_one_look_of_any_length(lines, ratio):
    control = FlowControl()
    control.learn(seen(12, 1.0))
    control.learn(seen(lines, ratio))
    assert control.flow == pytest.approx(ratio, rel=0.05)


def test_filaments_in_a_bath_correct_the_flow_only_where_several_looks_agree():
    """One picture of a sound print showed a vessel 13 % narrower than it was."""
    control, factors = FlowControl(), []
    control.learn(seen(3, 0.76, style="embedded"))
    assert control.proposal() is None
    for _ in range(6):
        control.learn(seen(3, 0.7, style="embedded"))
        factors.append(control.proposal())
    assert factors[-1] == pytest.approx(1 / 0.7, abs=0.12)


# --- gaps are believed at a stated rate, and only where both pictures show them
TEST = GapTest()


def gap_of(stroke, from_mm, to_mm, p_value):
    return Gap(stroke, from_mm, to_mm, (from_mm, 0.0), (to_mm, 0.0), 0.01, p_value)


def test_a_second_picture_must_show_it_too():
    gap = gap_of(3, 1.0, 2.0, 1e-9)
    elsewhere = [gap_of(4, 1.0, 2.0, 1e-9), gap_of(3, 1.8, 3.0, 1e-9)]
    assert confirmed_gaps([gap], 500, [], TEST) == ()
    assert confirmed_gaps([gap], 500, elsewhere, TEST) == ()


def test_sound_layers_are_mended_at_the_stated_rate():
    rng = np.random.default_rng(7)
    false = 0
    for _ in range(5000):  # every place is tested, each p-value even between 0 and 1
        p = rng.random(300)
        seen = [gap_of(k, 0.0, 0.5, float(p[k])) for k in np.flatnonzero(p < 1e-3)]
        false += bool(confirmed_gaps(seen, 300, None, TEST))
    assert false <= 14  # 5 expected; more than 14 once in 10,000 such tests


# --- clog, empty syringe, bubble and lost line are told apart
STROKE = np.repeat(np.arange(10), 20)


def judge(missing, left_ul=None, seen=None):
    present = np.ones(200)
    for part in missing:
        present[part] = 0.0
    seen = np.ones(200, bool) if seen is None else seen
    return judge_supply(np.full(200, 0.01), present, seen, STROKE, least_ul=0.02, left_ul=left_ul)


def test_bare_places_alone_in_sight_are_no_clog():
    present, seen = np.zeros(200), np.zeros(200, dtype=bool)
    seen[40:70] = True  # over older ink a picture may show bare places and no full ones
    state = judge_supply(np.full(200, 0.01), present, seen, STROKE, least_ul=0.02).state
    assert state is not SupplyState.CLOGGED
    seen[70:150] = True
    state = judge_supply(np.full(200, 0.01), present, seen, STROKE, least_ul=0.02).state
    assert state is SupplyState.CLOGGED


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


# --- thin stretches: how far they go, how much ink they lack, and what two pictures show
STEP = 0.15


def stations(strokes=2, each=60):
    m = strokes * each
    none, full = np.zeros(m), np.ones(m)
    row = np.repeat(np.arange(strokes), each)
    along = np.tile((np.arange(each) + 0.5) * STEP, strokes)
    return Stations(
        np.zeros((m, 2)), none, np.zeros((m, 2)), row, row, along, full * STEP,
        full * 0.25, full * 0.25, full * 0.01, none, full, full > 0, row * 0,
    )  # fmt: skip


# --- flow control: steps found, noise let be, bounds kept, no wind-up
def blocks(begin_s, ratios, u=0.03, factor=1.0):
    count = len(ratios)
    time = begin_s + np.arange(count, dtype=float)
    return FlowBlocks(time, np.asarray(ratios), np.full(count, u), np.full(count, factor))


def noisy(rng, mean, count, u=0.03):
    return mean * (1 + u * rng.standard_normal(count))


def closed_loop(flow, seconds, rng, control, begin_s=0.0):
    """Look every 5 s at what was written, of a needle that delivers ``flow`` of what is asked."""
    for k in range(seconds // 5):
        seen = noisy(rng, flow * control.factor, 5)
        control.learn(blocks(begin_s + 5.0 * k, seen, factor=control.factor))
        factor = control.proposal()
        if factor is not None:
            control.put_in_force(factor)


@pytest.mark.parametrize("flow", [0.7, 1.3])
def test_a_step_is_within_5_percent_after_10_seconds(flow):
    rng = np.random.default_rng(3)
    wrong = 0
    for _ in range(50):
        control = FlowControl()
        closed_loop(1.0, 60, rng, control)
        closed_loop(flow, 10, rng, control, 60.0)
        wrong += abs(flow * control.factor - 1) > 0.05
    assert wrong <= 2


def test_noise_alone_changes_little():
    rng = np.random.default_rng(4)
    control = FlowControl()
    closed_loop(1.0, 600, rng, control)
    assert abs(control.factor - 1) <= 0.03


def test_a_bound_is_kept_and_left_at_once():
    control = FlowControl()
    control.learn(blocks(0.0, np.full(200, 0.2)))
    assert control.out_of_bounds
    assert control.proposal() == control.limits.high
    control.put_in_force(control.limits.high)
    control.learn(blocks(200.0, np.full(10, 1.7), factor=1.7))  # the needle is free again
    assert control.proposal() == pytest.approx(1.0, abs=0.02)


def picture(rng, mean, begin_s, factor, bias):
    """Readings of one picture: they share what it may be off by."""
    seen = noisy(rng, mean * factor * bias, 4, 0.02)
    return FlowBlocks(begin_s + np.arange(4.0), seen, np.full(4, 0.032), np.full(4, factor), 0.025)


def test_widths_that_pictures_misread_a_little_are_not_corrected():
    wrong = 0
    for seed in range(300):
        rng, control = np.random.default_rng(seed), FlowControl()
        for k in range(16):
            control.learn(picture(rng, 1.0, 20.0 * k, 1.0, 1 + 0.025 * rng.standard_normal()))
            wrong += control.proposal() is not None
    assert wrong <= 4  # of 4,800 looks


def test_a_step_within_a_look_is_known_though_widths_are_unsure():
    """Before and behind it a picture misreads widths alike: it took another look, 5 s more."""
    control = FlowControl()
    for k in range(3):
        seen = np.ones(4) if k < 2 else np.array([0.81, 0.7, 0.7, 0.71])
        u = np.hypot(0.01, 0.07) * seen
        control.learn(FlowBlocks(4.0 * k + np.arange(4.0), seen, u, np.ones(4), 0.07))
    assert control.proposal() == pytest.approx(1 / 0.7, abs=0.06)


def test_a_picture_that_is_less_sure_than_the_last_is_no_step():
    """Widths by the change alone looked 17 % narrow; the flow was corrected by that."""
    control = FlowControl(factor=1.41)
    for common, seen in ((0.05, 0.985), (0.05, 0.985), (0.1, 0.82)):
        full = np.full(4, seen)
        control.learn(FlowBlocks(np.arange(4.0), full, common * full, np.full(4, 1.41), common))
    assert abs((control.proposal() or 1.41) - 1.41) < 0.1


def thin(kind="thin", low=3.0, high=3.6, stroke=1):
    return Stretch(kind, stroke, low, high, 0.7, 0.02, 1e-9)


def test_a_thin_stretch_goes_as_far_as_the_line_is_thin():
    given, rng = stations(), np.random.default_rng(0)
    ratio = 1 + 0.04 * rng.standard_normal(120)
    ratio[70:100] -= 0.3  # 1.5 to 6 mm of stroke 1
    (found,), seem = thin_lines((thin(),), given, np.ones(120, bool), ratio, 0.85)
    assert [one.stroke for one in seem] == [1]
    assert found.stroke == 1
    assert (found.from_mm, found.to_mm) == pytest.approx((1.5, 6.0), abs=0.3)
    assert found.missing == pytest.approx(0.3, abs=0.03)


def test_what_one_picture_alone_shows_isnt_filled_up():
    one, other = ThinStretch(1, 2.0, 4.0, 0.3), ThinStretch(1, 6.0, 8.0, 0.3)
    assert confirm_thin(
        (one, other), (ThinStretch(1, 3.0, 5.0, 0.3), ThinStretch(2, 6.0, 8.0, 0.3))
    ) == (one,)
