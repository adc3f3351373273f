"""Alignment of analytic surface points: convergence, mirror images, symmetry, scale."""

from dataclasses import replace

import manifold3d
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from design.solids.solid import Solid
from kernels.arrays import FloatArray
from registration.alignment import Alignment, AlignmentOptions, align
from registration.alignment.align import CLOSE_MM, _refuse_misfit
from registration.alignment.distance import ModelSurface, distance_grid
from registration.alignment.uncertainty import ScanErrors
from registration.errors import AlignmentError
from registration.measuring.topology import Landed, agreement
from registration.segmentation import gel_evidence
from tests.design.networks import network, polylines
from tests.registration.parts import (
    HERE,
    corners,
    lumens,
    planar_construct,
    planar_distance,
    rod,
    solid,
)
from tests.registration.phantom import BLOCK, IDENTITY, block, ladder, ladder_construct
from tests.slower import examples, first_of

FAST = AlignmentOptions(coarse_points=700, fine_points=5000, contest_points=40_000)
SIZE = (16.0, 8.0, 3.0)


def surface_points(part: Solid, count: int, seed: int) -> FloatArray:
    """Points spread evenly over the surface, with 5 µm of noise."""
    rng = np.random.default_rng(seed)
    triangles = part.vertices[part.faces]
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = np.linalg.norm(normal, axis=1)
    chosen = rng.choice(len(area), count, p=area / area.sum())
    a, b = np.sort(rng.uniform(size=(2, count)), axis=0)
    weight = np.stack([a, b - a, 1 - b], axis=1)[:, :, None]
    return (triangles[chosen] * weight).sum(axis=1) + rng.normal(0, 0.005, (count, 3))


def placed(points: FloatArray, seed: int, stretch: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points and the part's corners as a scanner looking down would see them."""
    rng = np.random.default_rng(seed)
    azimuth = rng.uniform(0, 2 * np.pi)
    tilt = np.deg2rad(rng.uniform(0, 10)) * np.array([np.cos(azimuth), np.sin(azimuth), 0])
    turn = Rotation.from_rotvec(tilt) * Rotation.from_rotvec([0, 0, rng.uniform(0, 2 * np.pi)])
    flip = Rotation.from_matrix(np.diag([1.0, -1.0, -1.0]))
    shift = rng.uniform(-3, 3, 3)
    both = np.concatenate([points, corners(SIZE)]) * stretch
    moved = (turn * flip).apply(both) + shift
    return moved[: len(points)], moved[len(points) :]


@pytest.fixture(scope="module")
def construct() -> Solid:
    return planar_construct()


@pytest.mark.parametrize("seed", first_of(range(4)))
def test_any_turn_with_tilt_and_shift_lands(construct: Solid, seed: int) -> None:
    shrink = np.array([0.98, 0.985, 0.975])
    points, truth = placed(surface_points(construct, 60_000, seed), seed, shrink)
    found = align(ModelSurface.of(construct), points, True, FAST)
    error = np.linalg.norm(found.scaled.apply(truth) - corners(SIZE), axis=1).max()
    assert error < 0.010
    np.testing.assert_allclose(found.scaled.scale, shrink, atol=1e-3)
    assert abs(np.linalg.det(found.rigid.matrix[:3, :3]) - 1) < 1e-9
    assert not found.ambiguous


def test_mirrored_points_are_refused_though_one_dimple_alone_tells(construct: Solid) -> None:
    points, _ = placed(surface_points(construct, 60_000, 1) * [-1, 1, 1], 7, np.ones(3))
    with pytest.raises(AlignmentError, match="mirror"):
        align(ModelSurface.of(construct), points, True, FAST)


def test_a_surface_that_little_light_reached_proves_no_mirror_image(construct: Solid) -> None:
    points, _ = placed(surface_points(construct, 60_000, 1) * [-1, 1, 1], 7, np.ones(3))
    found = align(ModelSurface.of(construct), points, True, FAST, lit=0.3)
    assert any("mirrored" in doubt for doubt in found.doubts)


def test_symmetric_part_is_flagged_ambiguous() -> None:
    block = manifold3d.Manifold.cube((10, 6, 3))
    channel = manifold3d.Manifold.cube((12, 1, 1)).translate((-1, 2.5, 1))
    part = solid(block - channel)
    points, _ = placed(surface_points(part, 40_000, 0), 3, np.ones(3))
    found = align(ModelSurface.of(part), points, True, FAST)
    assert found.ambiguous
    assert found.margin < 1.5


def test_a_straight_vessel_printed_short_is_short_at_neither_end_alone() -> None:
    """Its ends are a thirtieth of its surface; a robust fit from full length keeps one of them."""
    ends = [np.array([[0, 0, 0], [length, 0, 0]]) for length in (7.0, 6.75)]
    designed, printed = (solid(lumens(polylines([line], 0.23))) for line in ends)
    points = surface_points(printed, 20_000, 3)
    found = align(ModelSurface.of(designed), points, True, FAST, lumens=True)
    assert abs(found.scaled.scale[0] - 7.21 / 7.46) < 0.002


def test_thin_part_leaves_depth_unscaled() -> None:
    block = manifold3d.Manifold.cube((10, 6, 1.0)) - manifold3d.Manifold.cube((2, 3, 1))
    part = solid(block)
    points, _ = placed(surface_points(part, 40_000, 0), 3, np.array([0.98, 0.98, 0.9]))
    found = align(ModelSurface.of(part), points, True, FAST)
    assert not found.depth_fitted
    assert found.scaled.scale[2] == 1.0


def test_another_part_is_refused(construct: Solid) -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-9, 9, (30_000, 3))
    with pytest.raises(AlignmentError, match="of the scanned surface"):
        align(ModelSurface.of(construct), points, True, FAST)


def test_a_vessel_wider_all_along_leaves_scale_and_offset_alone() -> None:
    """Where the block may stretch along all axes lumens' walls alone tell scale from offset."""
    designed, printed = (
        manifold3d.Manifold.cube((10.0, 6.0, 2.6))
        - manifold3d.Manifold.batch_boolean(
            [
                rod(np.array([0, y, 1.2]), np.array([10.0, y, 1.2]), radius)
                for y, radius in ((1.2, wide), (2.6, 0.25), (3.7, 0.35), (4.9, 0.3))
            ],
            manifold3d.OpType.Add,
        )
        for wide in (0.45, 0.51)
    )
    seen = surface_points(solid(printed), 30_000, 3)
    seen += np.random.default_rng(4).normal(0, 0.006, seen.shape)
    found = align(ModelSurface.of(solid(designed)), seen, True, FAST).scaled
    np.testing.assert_allclose(found.scale[:2], 1, atol=1.5e-3)
    assert abs(found.offset_mm) < 0.006


def test_what_light_adds_to_facing_and_outer_walls_leaves_scales_alone(construct: Solid) -> None:
    """Opposite faces don't tell an offset of theirs from a scale; the lumens beside them do."""
    model, shrink = ModelSurface.of(construct), np.array([0.98, 0.985, 0.975])
    points = surface_points(construct, 60_000, 5)
    near = model.query(points)
    facing, outer = near.direction[:, 2] ** 2, model.curvature[near.face] >= 0
    moved = 0.004 + 0.012 * facing + 0.009 * (1 - facing) * outer
    flip = np.diag([1.0, -1.0, -1.0])
    seen = (points + moved[:, None] * near.direction) * shrink @ flip
    errors = replace(ScanErrors.of_blur(0.0), facing_mm=0.0075, outer_mm=0.011)
    found = align(model, seen, True, FAST, errors=errors).scaled
    np.testing.assert_allclose(found.scale, shrink, atol=4e-4)
    off = found.apply(corners(SIZE) * shrink @ flip) - corners(SIZE)
    assert np.linalg.norm(off, axis=1).max() < 0.004
    assert found.offset_mm == pytest.approx(0.004, abs=0.001)
    np.testing.assert_allclose(found.walls_mm, (0.012, 0.009), atol=0.002)


def test_fewer_than_500_points_are_refused(construct: Solid) -> None:
    points, _ = placed(surface_points(construct, 500, 1), 7, np.ones(3))
    with pytest.raises(AlignmentError, match=r"499 surface points are too few .*needed: 500"):
        align(ModelSurface.of(construct), points[1:], True, FAST)
    align(ModelSurface.of(construct), points, True, FAST)


def test_at_least_half_of_the_scanned_surface_must_fit() -> None:
    surface = ModelSurface.of(solid(manifold3d.Manifold.cube((4.0, 3.0, 2.0))))
    near, far = np.array([[1.0, 1.0, 0.9 * CLOSE_MM]]), np.array([[1.0, 1.0, 1.1 * CLOSE_MM]])
    _refuse_misfit(surface, np.concatenate([near, far]), HERE)
    with pytest.raises(AlignmentError, match=r"no pose fits: .* 33 % .*\(needed: 50 %\)"):
        _refuse_misfit(surface, np.concatenate([near, far, far]), HERE)


# Alignment from any pose: inverted, mirrored, partial, symmetric or nearly so.

FEW = AlignmentOptions(fine_points=5000, contest_points=20_000)
UPRIGHT = np.diag([1.0, -1.0, -1.0])
TURNED_OVER = np.eye(3)


def block_any_pose(dimple: tuple[float, float] | None = None) -> Solid:
    """A block with two equal channels, which half turns leave as it is; and a mark."""
    shape = manifold3d.Manifold.cube((10, 6, 3))
    for y in (1.5, 4.5):
        shape -= rod(np.array([-1, y, 1.5]), np.array([11, y, 1.5]), 0.4)
    if dimple:
        shape -= manifold3d.Manifold.sphere(0.5, 32).translate((*dimple, 3.0))
    return solid(shape)


def aligned(part: Solid, points: FloatArray, rotation: FloatArray) -> tuple[Alignment, float]:
    """The alignment of points that lie so under light from above, and its largest error, mm."""
    size = part.vertices.max(axis=0)
    where = corners((size[0], size[1], size[2])) @ rotation.T + [1.0, -2.0, 3.0]
    found = align(ModelSurface.of(part), points @ rotation.T + [1.0, -2.0, 3.0], True, FEW)
    off = found.scaled.apply(where) - corners((size[0], size[1], size[2]))
    return found, float(np.linalg.norm(off, axis=1).max())


def tilted(rotation: FloatArray, seed: int) -> FloatArray:
    turn = np.random.default_rng(seed).uniform(-9, 9, 3)
    return np.asarray(Rotation.from_euler("xyz", turn, degrees=True).as_matrix() @ rotation)


@pytest.mark.parametrize(
    ("rotation", "lay"),
    [
        (TURNED_OVER, "turned over"),
        pytest.param(
            Rotation.from_euler("y", 90, degrees=True).as_matrix(),
            "on its side",
            marks=pytest.mark.slow,
        ),
        (Rotation.from_euler("xz", [-90, 40], degrees=True).as_matrix(), "on its side"),
        (Rotation.from_rotvec([1.1, 0.7, -0.9]).as_matrix(), ""),
    ],
)
def test_a_part_lands_however_it_lies(construct: Solid, rotation: FloatArray, lay: str) -> None:
    found, error = aligned(construct, surface_points(construct, 20_000, 1), tilted(rotation, 1))
    assert error < 0.02
    assert not found.ambiguous, found.doubts
    assert found.lay.startswith(lay)


@pytest.mark.slow
def test_a_mirrored_part_is_refused_however_it_lies(construct: Solid) -> None:
    points = surface_points(construct, 20_000, 2) * [-1, 1, 1]
    with pytest.raises(AlignmentError, match="mirror image"):
        aligned(construct, points, tilted(TURNED_OVER, 2))


def test_a_piece_that_may_be_slid_says_along_which_axis() -> None:
    part = block_any_pose((1.0, 1.0))
    points = surface_points(part, 60_000, 4)
    points = points[(points[:, 0] > 3.5) & (points[:, 0] < 7.0)]
    found, _ = aligned(part, points, tilted(UPRIGHT, 4))
    assert found.ambiguous
    assert any("its position along x" in doubt for doubt in found.doubts)


@pytest.mark.slow
def test_a_symmetric_design_names_the_turns_that_nothing_tells() -> None:
    part = block_any_pose()
    found, _ = aligned(part, surface_points(part, 20_000, 5), tilted(UPRIGHT, 5))
    said = " ".join(found.doubts)
    for axis in "xyz":
        assert f"the same after a half turn about {axis}" in said


def test_one_mark_tells_where_it_is_seen_and_is_asked_for_where_it_is_not() -> None:
    part = block_any_pose((1.0, 1.0))
    points = surface_points(part, 60_000, 6)
    found, error = aligned(part, points, tilted(TURNED_OVER, 6))
    assert error < 0.02
    assert not found.ambiguous, found.doubts
    hidden = points[points[:, 0] > 1.8]
    found, _ = aligned(part, hidden, tilted(UPRIGHT, 6))
    assert any("x 1." in doubt and "wasn't seen" in doubt for doubt in found.doubts), found.doubts


@pytest.mark.slow
def test_a_face_that_the_others_outvote_is_named(construct: Solid) -> None:
    points = surface_points(construct, 20_000, 7)
    points[points[:, 2] < 0.05, 2] -= 0.29
    found, error = aligned(construct, points, UPRIGHT)
    assert error < 0.02
    assert "flat faces that face low z are off the design by +29" in found.doubts[0]


# Scans of a part with defects and of other parts, by where their hollows are.

OTHER = network(
    [(0.0, 0.7, 0.6), (9.0, 3.7, 1.9), (0.0, 3.8, 1.3), (9.0, 0.7, 1.3)],
    [[0, 1], [2, 3]], [0.3, 0.35], tree=np.arange(2),
)  # fmt: skip


def half(points: np.ndarray) -> np.ndarray:
    """Gel all over the half with the channels' ends: five of eight vessels aren't there."""
    return points[..., 0] * -1.0 + 3.0


def bubbles(points: np.ndarray) -> np.ndarray:
    """Six bubbles of 0.5 mm in the gel."""
    middles = [(x, y, 0.5) for x in (2.0, 4.5, 7.0) for y in (0.5, 3.9)]
    return np.min([np.linalg.norm(points - one, axis=-1) - 0.25 for one in middles], axis=0)


def landed(surface, network, segmentation):
    evidence = gel_evidence(segmentation.field, segmentation.strength)
    return Landed(surface, network, segmentation, evidence, IDENTITY, False, depth_down=True)


@pytest.mark.parametrize("filled", [None, half])
@pytest.mark.parametrize("extra", [None, bubbles])
def test_a_part_with_missing_vessels_and_bubbles_is_that_part(filled, extra):
    segmentation = block(extra=extra, filled=filled)
    surface = ModelSurface.of(ladder_construct())
    found = agreement(landed(surface, ladder(), segmentation))
    assert not found.other_part
    assert found.foreign_share < 0.1


def stopped(points: np.ndarray) -> np.ndarray:
    """Liquid in the upper half, as of a print that stopped."""
    return 0.5 * BLOCK[2] - points[..., 2]


def test_a_print_that_stopped_half_way_is_that_part() -> None:
    found = agreement(landed(ModelSurface.of(ladder_construct()), ladder(), block(extra=stopped)))
    assert found.foreign_share > 0.5  # gel is missing, and contradicts nothing
    assert found.designed_open > 0.9
    assert not found.other_part


def test_a_part_with_other_channels_in_the_same_block_is_another() -> None:
    model = solid(manifold3d.Manifold.cube(tuple(BLOCK)) - lumens(OTHER))
    found = agreement(landed(ModelSurface.of(model), OTHER, block()))
    assert found.other_part
    assert found.foreign_share > 0.5
    assert found.designed_open < 0.4


# Signed distances to surfaces, against plain NumPy and analytic shapes.


def naive_distance(point: FloatArray, triangle: FloatArray) -> float:
    """Distance to a triangle: inside its prism the plane's, else the nearest edge's."""
    a, b, c = triangle
    normal = np.cross(b - a, c - a)
    normal = normal / np.linalg.norm(normal)
    sides = [np.cross(normal, q - p) @ (point - p) for p, q in ((a, b), (b, c), (c, a))]
    if min(sides) >= 0:
        return abs(float(normal @ (point - a)))
    best = np.inf
    for p, q in ((a, b), (b, c), (c, a)):
        t = np.clip((point - p) @ (q - p) / ((q - p) @ (q - p)), 0, 1)
        best = min(best, float(np.linalg.norm(point - p - t * (q - p))))
    return best


@given(st.integers(0, 10_000))
@settings(max_examples=examples(25), deadline=None)
def test_distance_equals_the_smallest_over_all_triangles(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shape = solid(manifold3d.Manifold.hull_points(rng.uniform(-1, 1, (12, 3))))
    points = rng.uniform(-2, 2, (20, 3))
    found = ModelSurface.of(shape).query(points)
    triangles = shape.vertices[shape.faces]
    naive = [min(naive_distance(p, t) for t in triangles) for p in points]
    np.testing.assert_allclose(np.abs(found.distance), naive, atol=1e-9)
    np.testing.assert_allclose(
        np.linalg.norm(points - found.foot, axis=1), np.abs(found.distance), atol=1e-9
    )


def test_sign_is_right_all_over_a_part_with_lumens_and_sharp_edges() -> None:
    points = np.random.default_rng(1).uniform([-1, -1, -1], [17, 9, 4], (20_000, 3))
    truth = planar_distance(points)
    clear = np.abs(truth) > 0.01  # the model's cylinders have 32 sides
    found = ModelSurface.of(planar_construct()).query(points).distance
    np.testing.assert_array_equal(found[clear] < 0, truth[clear] < 0)


def test_grid_holds_the_exact_distances_at_its_points() -> None:
    surface = ModelSurface.of(solid(manifold3d.Manifold.cube((2, 1, 1))))
    grid = distance_grid(surface, margin_mm=1.0, finest_mm=0.25)
    nz, ny, nx = grid.values.shape
    corner = grid.origin_mm + grid.step_mm * np.array([nx - 1, ny - 1, nz - 1])
    assert (corner >= surface.bounds[1] + 1.0 - 1e-9).all()
    point = grid.origin_mm + grid.step_mm * np.array([3, 5, 2])
    assert grid.values[2, 5, 3] == pytest.approx(surface.query(point[None]).distance[0], abs=1e-6)
