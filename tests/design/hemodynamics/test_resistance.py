"""Resistance against Poiseuille's law, and the taper's closed form against quadrature."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

from design.errors import FlowError
from design.hemodynamics import vessel_resistance
from design.network import VesselNetwork
from tests.design.hemodynamics.networks import VISCOSITY, network_of


def test_a_straight_vessel_has_poiseuilles_resistance() -> None:
    network = network_of([[0, 0, 0], [0, 3, 4]], [(0, 1)], 0.25)
    expected = 8 * VISCOSITY * 5.0 / (np.pi * 0.25**4)
    assert vessel_resistance(network, VISCOSITY) == pytest.approx([expected], rel=1e-14)


@pytest.mark.parametrize(("first", "last"), [(0.5, 0.1), (0.1, 0.5), (0.3, 0.29999)])
def test_a_taper_has_the_integral_of_one_over_r4(first: float, last: float) -> None:
    network = VesselNetwork(
        nodes=np.array([[0.0, 0, 0], [7, 0, 0]]),
        vessel_nodes=np.array([[0, 1]]),
        kind=np.array([0]),
        tree=np.array([0]),
        offset=np.array([0, 2]),
        points=np.array([[0.0, 0, 0], [7, 0, 0]]),
        radius=np.array([first, last]),
    )
    integral = quad(lambda s: (first + (last - first) * s / 7) ** -4, 0, 7, epsrel=1e-12)[0]
    expected = 8 * VISCOSITY / np.pi * integral
    assert vessel_resistance(network, VISCOSITY)[0] == pytest.approx(expected, rel=1e-10)


def test_pieces_of_a_polyline_add_up() -> None:
    network = VesselNetwork(
        nodes=np.array([[0.0, 0, 0], [1, 2, 0]]),
        vessel_nodes=np.array([[0, 1]]),
        kind=np.array([0]),
        tree=np.array([0]),
        offset=np.array([0, 3]),
        points=np.array([[0.0, 0, 0], [1, 0, 0], [1, 2, 0]]),
        radius=np.full(3, 0.2),
    )
    expected = 8 * VISCOSITY * 3.0 / (np.pi * 0.2**4)
    assert vessel_resistance(network, VISCOSITY)[0] == pytest.approx(expected, rel=1e-14)


def test_a_vessel_of_zero_length_is_refused() -> None:
    network = network_of([[0, 0, 0], [1, 0, 0], [1, 0, 0]], [(0, 1), (1, 2)], 0.2)
    with pytest.raises(FlowError, match="vessel 1 has zero length"):
        vessel_resistance(network, VISCOSITY)
