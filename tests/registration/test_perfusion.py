"""Flow through measured lumens, against Poiseuille's law by hand."""

from __future__ import annotations

import numpy as np
import pytest

from registration.measuring.gauging import printed_network
from registration.measuring.gauging.perfusion import fed_vessels, perfusion
from tests.registration.phantom import CHANNEL, WIDE, block, ladder, traces
from tests.registration.test_defects import plug


def test_a_rung_between_equal_pressures_is_fed_by_whatever_flows() -> None:
    """A sound print failed by a rung of 0.1 % of the flow, which half a per cent turned round."""
    designed, across = np.array([1.0, 1e-3, 1e-3, 1.0]), np.array([50.0, 0.05, 30.0, 50.0])
    printed = np.array([1.0, -2e-6, 2e-6, 0.005])
    fed = fed_vessels(printed, designed, across, 100.0)
    assert fed.tolist() == [True, True, False, False]
    assert not fed_vessels(0.0 * printed, designed, across, 100.0).any()


def test_split_follows_the_fourth_power() -> None:
    narrow = lambda v, along: np.full_like(along, -0.05 * (v == CHANNEL))  # noqa: E731
    found = perfusion(ladder(), traces(block(narrow)))
    assert found is not None
    r = 0.25
    ratio = found.resistance_pa_s_ul[CHANNEL] / found.designed_resistance_pa_s_ul[CHANNEL]
    assert ratio == pytest.approx((r / (r - 0.05)) ** 4, rel=0.06)
    conductance = 1 / found.resistance_pa_s_ul
    # The headers' share of each way's resistance is small, and the same in both.
    way = [1 / (1 / conductance[v] + 1 / conductance[h] + 1 / conductance[h + 4])
           for v, h in ((CHANNEL, 1), (WIDE, 2))]  # fmt: skip
    assert found.share[CHANNEL] == pytest.approx(way[0] / sum(way), abs=0.01)


def test_occluded_channel_takes_no_flow_and_the_other_takes_all() -> None:
    found = perfusion(ladder(), traces(block(filled=plug(2.3, 3.1))))
    assert found is not None
    assert found.resistance_pa_s_ul[CHANNEL] == np.inf
    assert found.flow_ul_s[CHANNEL] == 0
    assert found.share[WIDE] == pytest.approx(1)
    assert found.perfused is False
    assert not found.fed[CHANNEL]
    assert found.fed[WIDE]
    assert found.inflow_ul_s == pytest.approx(1)


def test_oval_lumen_conducts_less_than_a_round_one_of_its_area() -> None:
    def squeeze(points):
        """An ellipse of 0.34 by 0.2 mm in place of the first channel."""
        y, z = points[..., 1] - 1.2, points[..., 2] - 1.3
        inside = np.abs(points[..., 0] - 4.5) - 2.0
        ellipse = (np.hypot(y / 0.34, z / 0.20) - 1) * 0.25
        return ellipse, np.maximum(np.hypot(y, z) - 0.45, inside)

    def filled(points):
        ellipse, tube = squeeze(points)
        return np.maximum(tube, -ellipse)

    def extra(points):
        ellipse, tube = squeeze(points)
        return np.maximum(tube, ellipse)

    # Gel is put back after the hole is made, so both leave the ellipse.
    found = traces(block(extra=extra, filled=filled))[CHANNEL]
    middle = np.abs(found.along - 2.8) < 1.0
    np.testing.assert_allclose(found.sections.ovality[middle], 0.34 / 0.20, rtol=0.06)
    np.testing.assert_allclose(found.sections.area[middle], np.pi * 0.34 * 0.20, rtol=0.03)
    radius = printed_network(ladder(), traces(block(extra=extra, filled=filled)))
    along = radius.polyline(CHANNEL)[1][1:-1][middle]
    a, b = 0.34, 0.20
    np.testing.assert_allclose(along**4, 2 * (a * b) ** 3 / (a * a + b * b), rtol=0.08)


def test_blocked_inlet_perfuses_nothing() -> None:
    block_in = block(filled=lambda p: np.abs(p[..., 0] - 0.8) - 0.2)
    found = perfusion(ladder(), traces(block_in))
    assert found is not None
    assert found.perfused is False
    assert (found.flow_ul_s == 0).all()
    assert np.isnan(found.pressure_drop_pa)
