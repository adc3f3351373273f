"""Dye flow beside closed vessels."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from design.vasculature.named import planar_four_vessel
from registration.dye import DyeOptions, DyeReport, dye_verdict
from registration.dye.flow import solve_without_closed
from sim.devices.dye import Occlusion, dye_flow
from tests.registration.dye.films import PLANAR_FLOW, planar_report

NETWORK = planar_four_vessel()


@pytest.fixture(scope="module")
def closed(tmp_path_factory: pytest.TempPathFactory) -> DyeReport:
    """The widest channel, which carries most of the flow, is closed; the pump goes on."""
    options = DyeOptions(flow_ul_s=PLANAR_FLOW, start_s=1.5)
    return planar_report(tmp_path_factory.mktemp("closed"), [Occlusion(8, 0.3)], options=options)


def test_flow_beside_a_closed_vessel_is_the_simulators() -> None:
    flow = solve_without_closed(NETWORK, None, (7,))
    assert flow is not None
    # The simulator cuts vessel 7 in two pieces, both at rest.
    known = np.delete(dye_flow(NETWORK, 1.0, [Occlusion(7)]).flow_ul_s, 8)
    assert np.abs(flow.solution.flow) == pytest.approx(known, abs=1e-9)
    assert not flow.moves()[7]
    assert flow.moves().sum() == 13


def test_a_vessel_that_is_late_beside_a_closed_one_is_still_told(closed: DyeReport) -> None:
    def slow(vessel: int) -> DyeReport:
        vessels = list(closed.vessels)
        times = vessels[vessel].beside
        assert times is not None
        assert times.leaves_s is not None
        late = dataclasses.replace(times, leaves_s=times.leaves_s + 15.0)
        vessels[vessel] = dataclasses.replace(vessels[vessel], beside=late)
        return dataclasses.replace(closed, vessels=vessels)

    reasons = dye_verdict(slow(5), 40.0)["reasons"]
    assert any("dye leaves 10 of 11 others" in reason for reason in reasons)
    assert any("vessel 5: dye leaves 15 s too late" in reason for reason in reasons)
