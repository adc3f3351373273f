"""Shapes, zones that cut them, parts, demand."""

import io
import json
import sys
from contextlib import redirect_stdout
from dataclasses import replace
from math import pi
from pathlib import Path

import numpy as np
import pytest
import trimesh
from manifold3d import Manifold
from scipy.integrate import quad

from benchmarks.checkers import write_stl
from benchmarks.tissue import worker
from benchmarks.tissue.cases import make, true_volume
from benchmarks.tissue.run import corners_of, judged, welded_volumes
from design.errors import TissueError
from design.tissue import (
    BlockZone,
    CylinderZone,
    MeshZone,
    SphereZone,
    Surface,
    VolumeImage,
    annulus,
    biventricle,
    block,
    carve,
    cylinder,
    depth_demand,
    folded_cortex,
    function_demand,
    image_demand,
    kidney,
    part_numbers,
    part_tissue,
    parts_of,
    tissue_from_surface,
)
from design.tissue import shapes as h
from design.vasculature import check_parts
from tests.design.tissue import surfaces
from tests.design.tissue.kept import kept_tissue
from tests.slower import first_of

BALL = trimesh.creation.icosphere(4, 4.0)
CUBE = block((10.0, 10.0, 10.0))
NEEDLE = CylinderZone((2.0, 5.0, -1.0), (8.0, 5.0, 11.0), 0.4)


@pytest.mark.parametrize(
    ("zone", "volume"),
    [
        (CylinderZone((5, 5, -1), (5, 5, 11), 1.0), 10 * pi),
        (SphereZone((5, 5, 5), 2.0), 32 * pi / 3),
        (BlockZone((9, 9, 9), (1, 1, 1)), 512.0),
        (BlockZone((-5, -5, -5), (5, 5, 5)), 125.0),
        (MeshZone(Surface(np.array(BALL.vertices) + 5.0, np.array(BALL.faces))), BALL.volume),
    ],
)
def test_zone_takes_its_volume_out(zone, volume):
    found, notes = carve(CUBE, [zone])
    assert notes == ()
    assert surfaces.closed(found)
    assert 1000 - found.volume_mm3 == pytest.approx(volume, rel=0.01)


def test_what_is_kept_free_is_free_and_what_is_kept_within_is_within():
    rng = np.random.default_rng(0)
    way = rng.normal(size=(4000, 3))
    way /= np.linalg.norm(way, axis=1)[:, None]
    shape = carve(CUBE, [SphereZone((5, 5, 5), 2.0)])[0]
    out = kept_tissue(shape)
    assert not out.contains(5.0 + 1.999 * way).any()
    shape = carve(block((9.0, 9.0, 9.0)), (), [SphereZone((4.5, 4.5, 4.5), 4.0)])[0]
    within = kept_tissue(shape)
    assert not within.contains(4.5 + 4.001 * way).any()


def test_needle_hole_is_outside_and_vessels_keep_clear_of_it():
    shape, _ = carve(CUBE, [NEEDLE])
    tissue = kept_tissue(shape)
    axis = np.linspace(NEEDLE.from_mm, NEEDLE.to_mm, 50)
    assert not tissue.contains(axis).any()
    start, end = np.array([[1.0, 5.0, 5.0]]), np.array([[9.0, 5.0, 5.0]])
    assert not tissue.grid.capsule_inside(start, end, np.array([0.1])).any()


def test_zone_that_misses_and_tissue_cut_in_two_are_told():
    found, notes = carve(CUBE, [NEEDLE, SphereZone((30, 0, 0), 1.0)])
    assert notes == (
        "keep_out 2 (sphere) doesn't meet the tissue and changes nothing; check its place",
    )
    assert found.volume_mm3 < 1000.0
    notes = carve(CUBE, [BlockZone((3, -1, -1), (4, 11, 11))])[1]
    assert len(notes) == 1
    assert "into 2 pieces (66.7 %, 33.3 % of it)" in notes[0]


@pytest.mark.parametrize(
    ("out", "within", "message"),
    [
        ([BlockZone((-1, -1, -1), (11, 11, 11))], [], r"keep_out 1 \(block\) takes the whole"),
        (
            [BlockZone((-1, -1, -1), (6, 11, 11)), BlockZone((5, -1, -1), (11, 11, 11))],
            [],
            "zones together take the whole",
        ),
        ([], [SphereZone((30, 0, 0), 1.0)], "keep_within leaves nothing"),
        ([SphereZone((0, 0, 0), 0.0)], [], "keep_out 1: radius_mm is 0"),
        ([CylinderZone((1, 1, 1), (1, 1, 1), 1.0)], [], "cylinder has no length"),
        ([BlockZone((0, 0, 0), (1, 1, 0))], [], "is flat"),
        ([MeshZone(Surface(CUBE.vertices, CUBE.faces[1:]), "port.stl")], [], r"port\.stl"),
    ],
)
def test_impossible_zones_are_refused(out, within, message):
    with pytest.raises(TissueError, match=message):
        carve(CUBE, out, within)


# Tissues of several parts, and faces without area.


def _tissue(*solids):
    return tissue_from_surface(*surfaces.joined(*map(surfaces.surface, solids)))


SMALL = Manifold.cube((6.0, 6.0, 6.0))
LARGE = Manifold.cube((10.0, 10.0, 10.0))
BESIDE = {
    "apart": SMALL.translate((20.0, 0.0, 0.0)),
    "at a corner": SMALL.translate((10.0, 10.0, 10.0)),
    "at an edge": SMALL.translate((10.0, 10.0, 0.0)),
}


@pytest.mark.parametrize("place", BESIDE)
def test_parts_are_told_apart_even_where_they_touch(place):
    tissue = _tissue(LARGE, BESIDE[place])
    parts = parts_of(tissue)
    assert [round(part.volume_mm3) for part in parts] == [1000, 216]
    middles = np.array([part.middle_mm for part in parts])
    assert part_numbers(tissue, parts, middles).tolist() == [0, 1]


def test_a_part_that_no_vessel_ends_in_is_refused_by_size_and_place():
    tissue = _tissue(LARGE, BESIDE["apart"])
    inside = np.array([[5.0, 5.0, 5.0]])
    with pytest.raises(TissueError, match=r"the part of 216 mm³ around \(23, 3, 3\) mm"):
        check_parts(tissue, inside)
    _, demand, number = check_parts(tissue, np.array([[23.0, 3.0, 3.0], [5.0, 5.0, 5.0]]))
    assert demand == pytest.approx([1000 / 1216, 216 / 1216])
    assert number.tolist() == [1, 0]


def test_a_part_is_a_tissue_of_its_own_and_a_cavity_is_none():
    tissue = kept_tissue(surfaces.nested_shells())
    outer, inner = parts_of(tissue)
    own = part_tissue(tissue, outer)
    assert own.volume_mm3 == pytest.approx(outer.volume_mm3)
    assert own.contains(np.array([[9.0, 0, 0], [7.0, 0, 0], [0, 0, 0.0]])).tolist() == [1, 0, 0]
    assert outer.volume_mm3 + inner.volume_mm3 == pytest.approx(tissue.volume_mm3)
    at = np.array([[9.0, 0, 0], [7.0, 0, 0], [4.5, 0, 0], [0, 0, 0.0]])
    assert part_numbers(tissue, (outer, inner), at).tolist() == [0, -1, 1, -1]


# A handful of the battery's tissues (`make bench-tissue` has three hundred).

KINDS = ("point", "inverted", "shells", "sheets", "edge", "face", "flat", "joints", "voxels")


@pytest.mark.parametrize("kind", first_of(KINDS, 2))
def test_every_part_is_supplied(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case, path = make(kind, 0), tmp_path / f"{kind}-0.stl"
    write_stl(path, corners_of(case.mesh))
    # Here, not in a process of its own as the benchmark does: that imports all of it once more.
    monkeypatch.setattr(sys, "argv", ["worker", str(path)])
    with redirect_stdout(io.StringIO()) as told:
        worker.main()
    lines = map(json.loads, told.getvalue().splitlines())
    said = {one["done"]: one for one in lines if "done" in one}
    found = judged(case, said[path.stem], path)
    assert found["result"] == "supplied", found


@pytest.mark.parametrize("kind", ["apart", "many", "sizes", "linked"])
def test_the_judges_parts_are_those_of_the_file(kind: str) -> None:
    case = make(kind, 1)
    true = sorted((true_volume(part) for part in case.parts), reverse=True)
    assert welded_volumes(case.mesh) == pytest.approx(true, rel=1e-4)


# Shapes of organs and phantoms.


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
    assert surfaces.closed(shape)
    assert shape.faces.dtype == np.int32
    volume = trimesh.Trimesh(shape.vertices, shape.faces, process=False).volume
    assert 0 < shape.volume_mm3 == pytest.approx(volume)


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
    tissue = kept_tissue(shape)
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


# Demand by depth, by a function, by an image.


@pytest.fixture(scope="module")
def cube():
    return kept_tissue(block((10.0, 10.0, 10.0)))


@pytest.fixture(scope="module")
def ball():
    return kept_tissue(surfaces.surface(surfaces.sphere(10.0, 128)))


def inside(tissue, count, seed=0):
    low, high = tissue.bounds
    points = np.random.default_rng(seed).uniform(low, high, (count, 3))
    return points[tissue.contains(points)]


def test_table_by_depth_is_linear_and_flat_beyond(ball):
    demand = depth_demand(ball, [1.0, 3.0], [4.0, 2.0])
    points = np.array([[9.5, 0, 0], [8.0, 0, 0], [7.5, 0, 0], [2.0, 0, 0]])
    np.testing.assert_allclose(demand.weight(points), [1.0, 0.75, 0.625, 0.5], atol=0.01)


def test_mean_weight_is_the_volume_mean(ball):
    # Depth d is at radius 10 - d: the mean of d / 10 is a quarter.
    assert depth_demand(ball, [0.0, 10.0], [0.0, 5.0]).mean_weight == pytest.approx(0.25, rel=0.01)
    # Only the outer 2 mm: 1 - 0.8^3.
    shell = depth_demand(ball, [2.0, 2.0001], [1.0, 0.0])
    assert shell.mean_weight == pytest.approx(1 - 0.8**3, rel=0.01)


def test_bound_is_found_where_none_is_given_and_kept_where_one_is(cube):
    demand = function_demand(cube, lambda p: 3.0 * p[:, 0])
    assert 30.0 < demand.greatest < 33.1
    ratio = demand.weight(np.array([[2.0, 5, 5]])) / demand.mean_weight
    assert ratio == pytest.approx(0.4, rel=1e-3)
    with pytest.raises(TissueError, match=r"above the greatest value 20"):
        function_demand(cube, lambda p: 3.0 * p[:, 0], greatest=20.0)


def test_image_is_linear_between_voxels(cube):
    affine = np.diag([2.0, 2.0, 2.0, 1.0])
    affine[:3, 3] = 1.0
    values = np.broadcast_to(np.arange(5)[:, None, None], (5, 5, 5)).astype(np.int16)
    demand = image_demand(cube, VolumeImage(values, affine))
    points = np.array([[1.0, 5, 5], [4.0, 5, 5], [9.0, 5, 5], [10.0, 5, 5]])
    np.testing.assert_allclose(demand.weight(points), [0.0, 0.375, 1.0, 1.0], atol=1e-12)
    assert demand.mean_weight == pytest.approx(0.5, rel=1e-3)


def test_accepting_by_weight_places_points_by_demand_and_keeps_the_total(ball):
    tissue = replace(ball, demand=depth_demand(ball, [0.0, 10.0], [1.0, 0.0]))
    points = inside(tissue, 60_000, seed=1)
    weight = tissue.demand.weight(points)
    kept = points[np.random.default_rng(2).uniform(size=len(points)) < weight]
    assert len(kept) / len(points) == pytest.approx(tissue.demand.mean_weight, abs=0.01)
    radius = np.linalg.norm(kept, axis=1)
    # Density r/10 over the sphere: the share within radius r is (r/10)^4.
    for r in (4.0, 6.0, 8.0):
        assert (radius < r).mean() == pytest.approx((r / 10) ** 4, abs=0.015)
    assert (weight / tissue.demand.mean_weight).mean() == pytest.approx(1.0, abs=0.01)


def image(values, scale=5.0):
    return VolumeImage(values, np.diag([scale, scale, scale, 1.0]))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda t: depth_demand(t, [0, 1], [1]), "2 depths and 1 relative"),
        (lambda t: depth_demand(t, [1, 0], [1, 1]), "don't ascend"),
        (lambda t: depth_demand(t, [0], [-1]), "negative"),
        (lambda t: depth_demand(t, [0], [0]), "0 at every depth"),
        (lambda t: depth_demand(t, [50, 51], [0, 1]), "0 throughout the tissue"),
        (lambda t: function_demand(t, lambda p: p[:, 0] * np.nan), "NaN"),
        (lambda t: function_demand(t, lambda p: p), "gave shape"),
        (lambda t: function_demand(t, lambda p: 0 * p[:, 0]), "ask for something"),
        (lambda t: image_demand(t, image(np.ones((3, 3, 3)), 1.0)), r"covers \d+ % of the tissue"),
        (lambda t: image_demand(t, image(np.zeros((3, 3, 3)))), "0 everywhere"),
        (lambda t: image_demand(t, image(-np.ones((3, 3, 3)))), "negative"),
    ],
)
def test_impossible_demand_is_refused(cube, make, message):
    with pytest.raises(TissueError, match=message):
        make(cube)
