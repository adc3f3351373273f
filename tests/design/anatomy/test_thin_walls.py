"""Trunks too wide for a thin wall: told with a remedy that works, or grown with another drop."""

import re
from dataclasses import replace

import numpy as np
import pytest

from design.anatomy.grown import AnatomicTrees
from design.anatomy.heart import HeartAnatomy, grow_heart
from design.anatomy.sink import check_trunks, sink_trunk
from design.anatomy.tried_fewer import grow_or_advise
from design.errors import LEAST_TERMINALS, WideTrunkError
from design.tissue import block, tissue_from_surface
from design.tissue import heart as heart_shape
from design.units import PA_PER_MMHG
from design.vasculature.treemath import tree_from_topology, tree_radii
from tests.design.anatomy.hearts import HEART, heart_tissue
from tests.design.tissue.kept import kept_tissue

CLEARANCE = 0.1
THICK = 2.5
WIDE_PA = 90.0
"""With this pressure drop the trunk is 2.6 mm wide."""


def trunk(drop_pa):
    """A trunk in the middle of a wall 2.5 mm thick."""
    x = np.arange(5.0, 55.5, 1.0)
    line = np.column_stack([x, np.full(len(x), 10.0), np.full(len(x), 0.5 * THICK)])
    n = len(line) - 1
    children = np.full((n, 2), -1, dtype=np.int32)
    children[:-1, 0] = np.arange(1, n)
    return tree_from_topology(
        line[:-1],
        line[1:],
        np.arange(-1, n - 1).astype(np.int32),
        children,
        flow_ul_s=500.0,
        pressure_drop_pa=drop_pa,
        murray_exponent=2.5,
        viscosity_pa_s=4e-3,
        given=np.ones(n, dtype=np.bool_),
    )


def test_a_trunk_too_wide_for_the_wall_fits_with_the_drop_that_is_advised():
    """Fewer terminals were advised, which leave the trunk as wide as it is."""
    tissue, wide = kept_tissue(block((60.0, 20.0, THICK))), trunk(WIDE_PA)
    assert 0.5 * THICK - CLEARANCE < tree_radii(wide)[0] < 0.5 * THICK + CLEARANCE
    sunk = sink_trunk(tissue, wide, CLEARANCE)
    everywhere = np.arange(1, len(wide.parent))
    with pytest.raises(
        WideTrunkError, match=r"room for 2\.\d+ mm; give a higher pressure_drop"
    ) as refused:
        check_trunks(tissue, (sunk,), everywhere, CLEARANCE)
    thinner = trunk(WIDE_PA * refused.value.drop_factor)
    assert tree_radii(thinner)[0] < 0.5 * THICK - CLEARANCE
    assert refused.value.drop_factor < 3.0
    check_trunks(tissue, (thinner,), everywhere[:0], CLEARANCE)


def test_a_heart_raises_a_drop_of_its_own_choice_until_trunks_fit(monkeypatch):
    drops = []

    def grow(_, options, __):
        drops.append(options.pressure_drop_pa)
        if len(drops) < 3:
            raise WideTrunkError("too wide", drop_factor=1.5)
        tree = replace(trunk(WIDE_PA), pressure_drop_pa=options.pressure_drop_pa)
        return AnatomicTrees((tree,), (), (), ("found",))

    monkeypatch.setattr("design.anatomy.heart._grow", grow)
    made = grow_heart(heart_tissue(), HEART, HeartAnatomy(published_radii=True))
    assert drops == pytest.approx([1100.0, 1650.0, 2475.0])
    assert made.notes == (
        "found",
        "pressure_drop_mmhg was taken as 18.6 instead of 8.25: wider trunks don't fit in the wall",
    )
    drops.clear()
    with pytest.raises(WideTrunkError):
        grow_heart(heart_tissue(), HEART, HeartAnatomy())
    assert len(drops) == 1


@pytest.mark.slow
def test_a_heart_of_a_thin_right_wall_grows(monkeypatch):
    outer = heart_shape.RIGHT_OUTER
    monkeypatch.setattr(heart_shape, "RIGHT_INNER", tuple(axis - 2.0 for axis in outer))
    shape = heart_shape.biventricle(60.0)
    tissue = tissue_from_surface(shape.vertices, shape.faces)
    options = replace(HEART, terminals=40, pressure_drop_pa=500.0)
    with pytest.raises(WideTrunkError) as refused:
        grow_or_advise(
            lambda one: grow_heart(tissue, one, HeartAnatomy(trunk_ends=10)),
            options,
            LEAST_TERMINALS,
        )
    advised = re.search(r"pressure_drop_mmhg of ([\d.]+) or more", str(refused.value))
    assert advised is not None
    higher = replace(options, pressure_drop_pa=float(advised[1]) * PA_PER_MMHG)
    assert grow_heart(tissue, higher, HeartAnatomy(trunk_ends=10)).trees
    made = grow_heart(tissue, options, HeartAnatomy(trunk_ends=10, published_radii=True))
    assert sum(int(tree.terminals[0]) for tree in made.trees) == 40
    assert any("wider trunks don't fit in the wall" in note for note in made.notes)
