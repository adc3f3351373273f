"""Radii under diameter-dependent viscosity."""

import numpy as np
import pytest

from design.tissue import block
from design.vasculature import (
    GrowthOptions,
    collisions,
    grow_tree,
    tree_radii,
    tree_to_network,
)
from design.vasculature.viscosity import relative_viscosity
from tests.design.tissue.kept import kept_tissue
from tests.design.vasculature import oracles


@pytest.fixture(scope="module")
def box():
    shape = block((10.0, 8.0, 6.0))
    return kept_tissue(shape)


def pries(radius_mm, haematocrit):
    """Pries et al. 1994 written out, over plasma; radii as an array."""
    d = 2000.0 * np.asarray(radius_mm)
    squeezed = (d / (d - 1.1)) ** 2
    mu45 = 6 * np.exp(-0.085 * d) + 3.2 - 2.44 * np.exp(-0.06 * d**0.645)
    f = 1 / (1 + 10.0**-11 * d**12)
    c = (0.8 + np.exp(-0.075 * d)) * (f - 1) + f
    share = ((1 - haematocrit) ** c - 1) / ((1 - 0.45) ** c - 1)
    return (1 + (mu45 - 1) * share * squeezed) * squeezed


@pytest.mark.parametrize("haematocrit", [0.3, 0.45])
@pytest.mark.parametrize("smallest", [None, 0.006])
def test_terminal_flows_are_equal_by_an_independent_solver_with_that_law(
    box, haematocrit, smallest
):
    options = GrowthOptions(
        terminals=300,
        viscosity_law="pries_1994",
        haematocrit=haematocrit,
        smallest_radius_mm=smallest,
        pressure_drop_pa=2e4,
    )
    tree = grow_tree(box, options)
    radius = tree_radii(tree)
    thick = pries(radius, haematocrit) / pries(1e6, haematocrit)
    assert thick.max() / thick.min() > 1.2
    flows = oracles.terminal_flows(tree, radius, thick)
    np.testing.assert_allclose(flows, options.flow_ul_s(box.volume_mm3) / 300, rtol=1e-6)
    assert collisions(tree_to_network(tree), 0.0, options.clearance_ratio).count == 0
    if smallest is not None:
        assert radius.min() == pytest.approx(smallest)


@pytest.mark.parametrize("haematocrit", [0.2, 0.45, 0.6])
def test_law_is_pries_over_its_value_in_wide_vessels(haematocrit):
    radii = np.geomspace(0.0025, 2.0, 40)
    expected = pries(radii, haematocrit) / pries(50.0, haematocrit)
    found = [relative_viscosity(r, haematocrit) for r in radii]
    np.testing.assert_allclose(found, expected, rtol=1e-4)
    assert relative_viscosity(0.5, -1.0) == 1.0
    assert relative_viscosity(1e-6, 0.45) == relative_viscosity(0.002, 0.45)
