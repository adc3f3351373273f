from math import pi

import numpy as np
import pytest
import trimesh
from scipy.integrate import quad

from design.errors import TissueError
from design.tissue import (
    annulus,
    biventricle,
    block,
    cylinder,
    folded_cortex,
    kidney,
    tissue_from_surface,
)
from design.tissue import shapes as heart_module

SHAPES = {
    "block": lambda: block((16.0, 8.0, 3.0)),
    "cylinder": lambda: cylinder(20.0, 5.0),
    "annulus": lambda: annulus(30.0, 20.0, 6.0),
    "folded cortex": folded_cortex,
    "biventricle": biventricle,
    "kidney": kidney,
}


@pytest.mark.parametrize("name", SHAPES)
def test_shape_is_closed_and_looks_outward(name):
    shape = SHAPES[name]()
    mesh = trimesh.Trimesh(shape.vertices, shape.faces, process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert shape.volume_mm3 > 0
    assert shape.faces.dtype == np.int32
    assert mesh.volume == pytest.approx(shape.volume_mm3)


def test_annulus_converges_to_the_round_ring_in_second_order():
    exact = pi * (15.0**2 - 10.0**2) * 6.0
    errors = [exact - annulus(30.0, 20.0, 6.0, sides).volume_mm3 for sides in (32, 64)]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.01)


def test_folded_cortex_converges_to_thickness_times_arc_length():
    k = 2 * pi / 16.0
    arc = quad(lambda x: np.hypot(1.0, 4.0 * k * np.sin(k * x)), 0, 40.0, limit=400)[0]
    exact = 3.0 * arc * 32.0
    errors = [abs(folded_cortex(facet_mm=f).volume_mm3 - exact) for f in (1.0, 0.5)]
    assert errors[0] < 2e-3 * exact
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.15)


def test_biventricle_has_the_volume_of_its_ellipsoids():
    h = heart_module
    rng = np.random.default_rng(0)
    low, high = np.array([-21.0, -21.0, -45.0]), np.array([43.0, 21.0, 17.0])
    p = rng.uniform(low, high, (400_000, 3))

    def within(axes, centre=(0, 0, 0)):
        return (((p - centre) / axes) ** 2).sum(axis=1) < 1

    left, cavity = within(h.LEFT_OUTER), within(h.LEFT_INNER)
    right = within(h.RIGHT_OUTER, h.RIGHT_CENTRE)
    right_cavity = within(h.RIGHT_INNER, h.RIGHT_CENTRE) & ~left
    inside = (left | right) & ~cavity & ~right_cavity & (p[:, 2] < h.BASE_Z)
    expected = inside.mean() * np.prod(high - low)
    assert biventricle(60.0).volume_mm3 == pytest.approx(expected, rel=0.01)


def test_kidney_lies_on_the_bed_with_its_sinus_at_its_concave_side():
    shape = kidney(60.0)
    assert np.ptp(shape.vertices[:, 1]) == pytest.approx(60.0)
    assert shape.vertices[:, 2].min() == 0.0
    tissue = tissue_from_surface(shape.vertices, shape.faces)
    middle = np.array([[x, 0.0, 12.6] for x in (-14.0, -5.0, 5.0)])
    assert tissue.contains(middle).tolist() == [False, False, True]


@pytest.mark.parametrize(
    "make",
    [
        lambda: block((1.0, 0.0, 1.0)),
        lambda: cylinder(-1.0, 2.0),
        lambda: annulus(10.0, 12.0, 2.0),
        lambda: annulus(12.0, 10.0, float("nan")),
        lambda: biventricle(0.0),
        lambda: kidney(-1.0),
        lambda: cylinder(1.0, 1.0, sides=2),
        lambda: folded_cortex(thickness_mm=6.0),
    ],
)
def test_impossible_shapes_are_refused(make):
    with pytest.raises(TissueError):
        make()
