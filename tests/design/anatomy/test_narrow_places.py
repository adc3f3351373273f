"""A heart's main branches know where the wall is too thin for them."""

import numpy as np
import pytest

from design.anatomy.heart import narrow_places
from design.anatomy.trunk_lines import join_layer
from design.tissue import block
from tests.design.tissue.kept import kept_tissue


@pytest.mark.parametrize(("thick_mm", "narrow"), [(4.0, True), (12.0, False)])
def test_places_are_narrow_where_the_wall_is_thinner_than_twice_the_depth(thick_mm, narrow):
    tissue = kept_tissue(block((30.0, 30.0, thick_mm)))
    at = np.linspace(8.0, 22.0, 8)
    x, y = np.meshgrid(at, at)
    points = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, thick_mm - 1.0)])
    layer = join_layer(tissue, points, 0.5)
    assert (narrow_places(tissue, layer, 2.5) == narrow).all()
