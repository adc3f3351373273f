"""Inlets on supplies of their own: flows by hand, and what can't be."""

import numpy as np
import pytest

from design.errors import FlowError
from design.hemodynamics import (
    FlowConditions,
    PulsatileConditions,
    Supply,
    same_shear_conditions,
    solve_flow,
    solve_pulsatile,
)
from design.hemodynamics.waveforms import Sine
from design.network import VesselNetwork
from design.units import WATER_DENSITY


def tubes() -> VesselNetwork:
    """Two unconnected parts: a tube, and two that join into one."""
    nodes = np.array([[0, 0, 0], [9, 0, 0], [0, 5, 0], [0, 8, 0], [5, 6, 0], [9, 6, 0]], float)
    ends = np.array([[0, 1], [2, 4], [3, 4], [4, 5]])
    none = np.zeros(4, dtype=np.int64)
    return VesselNetwork.from_segments(nodes, ends, np.full(4, 0.3), none, none)


OWN = (Supply((2, 3), 6.0),)


def test_each_supply_gives_its_own_flow() -> None:
    net = tubes()
    found = solve_flow(net, FlowConditions(1e-3, inlet_flow_ul_s=4.0, supplies=OWN))
    np.testing.assert_allclose(found.flow[[0, 3]], [4.0, 6.0])
    assert found.pressure[2] == pytest.approx(found.pressure[3])
    assert found.pressure[0] != pytest.approx(found.pressure[2])
    wider = same_shear_conditions(FlowConditions(1e-3, inlet_flow_ul_s=4.0, supplies=OWN), 2.0)
    assert wider.supplies[0].flow_ul_s == 48.0


def test_a_pulse_leaves_other_supplies_steady() -> None:
    net = tubes()
    driven = PulsatileConditions(1e-3, Sine(4.0, 1.0, 1.0), supplies=OWN)
    flow = solve_pulsatile(net, driven).flow_in
    np.testing.assert_allclose(flow[0].real[[0, 3]], [4.0, 6.0])
    assert abs(flow[1, 0]) == pytest.approx(1.0)
    np.testing.assert_allclose(flow[1, 1:], 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("supplies", "said"),
    [
        ((Supply((1,), 1.0),), "node 1 has a supply of its own and isn't an inlet"),
        ((Supply((2,), 1.0), Supply((2, 3), 1.0)), "inlet 2 hangs on two supplies"),
        ((Supply((0, 2, 3), 1.0),), "nothing is left for the common one"),
    ],
)
def test_impossible_supplies_are_refused(supplies: tuple[Supply, ...], said: str) -> None:
    with pytest.raises(FlowError, match=said):
        solve_flow(tubes(), FlowConditions(1e-3, inlet_flow_ul_s=1.0, supplies=supplies))


def test_inertia_follows_the_density() -> None:
    net = tubes()
    waves = [
        solve_pulsatile(
            net, PulsatileConditions(1e-3, Sine(4.0, 1.0, 1.0), supplies=OWN, density=density)
        ).pressure[1, 0]
        for density in (WATER_DENSITY, 2 * WATER_DENSITY)
    ]
    # A sine's phasor is imaginary, and so is what friction takes of it.
    assert waves[0].imag == pytest.approx(waves[1].imag)
    assert waves[1].real == pytest.approx(2 * waves[0].real)
