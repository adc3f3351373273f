"""Dye front: analytic results for one tube, two in series and a bifurcation."""

import numpy as np
import pytest

from design.hemodynamics import FlowConditions, solve_flow
from design.hemodynamics.dye import (
    CarryingFlow,
    check_frames,
    dye_curves,
    dye_front,
    front_table,
    mean_age,
    steady_transit,
)
from design.network import VesselNetwork
from kernels.arrays import FloatArray
from tests.design.hemodynamics.networks import network_of

TUBE = network_of([[0, 0, 0], [10, 0, 0]], [(0, 1)], 0.2)
SERIES = network_of([[0, 0, 0], [10, 0, 0], [14, 0, 0]], [(0, 1), (1, 2)], [0.2, 0.4])
SPLIT = network_of(
    [[0, 0, 0], [4, 0, 0], [8, 3, 0], [8, -1, 0], [12, 0, 0]],
    [(0, 1), (1, 2), (1, 3), (2, 4), (3, 4)],
    [0.3, 0.2, 0.15, 0.2, 0.15],
)


def carried(network: VesselNetwork) -> CarryingFlow:
    given = FlowConditions(1e-3, inlet_flow_ul_s=1.0)
    return steady_transit(network, solve_flow(network, given), tuple(network.inlets().tolist()))


def step_out(t: FloatArray, mean_transit: float) -> FloatArray:
    """∫ E dt with E = T²/2t³ from T/2 on."""
    return np.where(t > mean_transit / 2, 1 - (mean_transit / (2 * np.maximum(t, 1e-12))) ** 2, 0.0)


def test_one_tube_s_outflow_is_the_parabola_s() -> None:
    flow, end = carried(TUBE), np.ones(1)
    mean = np.pi * 0.2**2 * 10.0
    times, out = dye_curves(TUBE, flow, np.zeros(1, int), end, 6 * mean, "flux")
    np.testing.assert_allclose(out[0], step_out(times, mean), atol=0.02)
    _, seen = dye_curves(TUBE, flow, np.zeros(1, int), end, 6 * mean)
    clear = np.abs(times - mean / 2) > 0.05 * mean
    expected = np.where(times > mean / 2, 1 - mean / (2 * np.maximum(times, 1e-9)), 0.0)
    np.testing.assert_allclose(seen[0][clear], expected[clear], atol=0.005)


def test_two_tubes_in_series_are_the_convolution() -> None:
    """By a sum over the first one's exit-time distribution, mixed where they meet."""
    flow = carried(SERIES)
    first, second = flow.transit_s
    until = 5 * (first + second)
    times, out = dye_curves(SERIES, flow, np.array([1]), np.ones(1), until, "flux")
    share = (np.arange(20_000) + 0.5) / 20_000
    exit_times = first / (2 * np.sqrt(1 - share))
    expected = [step_out(t - exit_times, second).mean() for t in times[::32]]
    np.testing.assert_allclose(out[0][::32], expected, atol=0.004)


def test_a_split_mixes_by_flow_where_it_meets_again() -> None:
    flow = carried(SPLIT)
    q, t = np.abs(flow.solution.flow), flow.transit_s
    age = mean_age(SPLIT, flow)
    ways = [t[0] + t[1] + t[3], t[0] + t[2] + t[4]]
    assert age[4] == pytest.approx(q[3] * ways[0] + q[4] * ways[1], rel=1e-12)
    # Of all that flows through, the mean age is the volume over the flow.
    assert age[4] == pytest.approx(flow.volume.sum(), rel=1e-9)
    front = dye_front(SPLIT, flow, 2.0)
    assert front.tip_leaves_s[3] == pytest.approx(ways[0] / 4.0)
    assert front.tip_leaves_s[4] == pytest.approx(ways[1] / 4.0)
    assert front.mean_leaves_s[3] == pytest.approx(ways[0] / 2.0)


def test_the_tip_runs_at_twice_the_mean_and_the_camera_s_half_at_the_mean_of_one_tube() -> None:
    front = dye_front(TUBE, carried(TUBE), 0.25 / 0.06)
    speed = 0.25 / 0.06 / (np.pi * 0.2**2)
    assert front.transit_s[0] == pytest.approx(10 / speed)
    assert front.tip_leaves_s[0] == pytest.approx(5 / speed)
    # 1 - T/2t is one half at T.
    assert front.half_leaves_s[0] == pytest.approx(10 / speed, rel=0.01)


def test_diffusion_is_judged_by_how_far_it_comes_across_the_vessel() -> None:
    flow = carried(TUBE)
    mean = np.pi * 0.2**2 * 10.0
    for fourier, word in ((0.005, "carried"), (0.1, "between"), (2.0, "dispersed")):
        rate = mean * 4e-4 / (0.2**2 * fourier)
        front = dye_front(TUBE, flow, rate)
        assert front.fourier[0] == pytest.approx(fourier)
        assert front_table(TUBE, front)["regime"].tolist() == [word]
    assert front.peclet[0] == pytest.approx(0.4 * rate / (np.pi * 0.2**2) / 4e-4)


def test_frames_too_far_apart_are_warned_of() -> None:
    """20 mm at 33 mm/s on the mean: 0.3 s at the tip (physics.md)."""
    tube = network_of([[0, 0, 0], [20, 0, 0]], [(0, 1)], 0.2)
    front = dye_front(tube, carried(tube), 33.0 * np.pi * 0.2**2)
    assert front.tip_leaves_s[0] == pytest.approx(0.303, abs=0.001)
    slow = check_frames(front, 1 / 25)
    assert "film 33 frames a second" in slow.warning
    assert slow.frames == pytest.approx(7.6, abs=0.05)
    assert check_frames(front, 1 / 40).warning == ""
    assert check_frames(front, 1 / slow.needed_per_s).warning == ""
    assert check_frames(front, 0.2).quick.tolist() == [0]


def test_a_vessel_at_rest_has_no_times() -> None:
    dead = network_of(
        [[0, 0, 0], [5, 0, 0], [10, 0, 0], [5, 4, 0], [5, 4, 4]],
        [(0, 1), (1, 2), (1, 3), (3, 4)],
        0.2,
    )
    given = FlowConditions(1e-3, inlet_flow_ul_s=1.0, inlets=(0,), outlets=(2, 4),
                           outlet_flow_ul_s={4: 0.0})  # fmt: skip
    flow = steady_transit(dead, solve_flow(dead, given), (0,))
    front = dye_front(dead, flow, 1.0)
    assert np.isnan(front.tip_enters_s[2:]).all()
    assert np.isfinite(front.half_leaves_s[:2]).all()
    assert front.regime().tolist()[2:] == ["still", "still"]
