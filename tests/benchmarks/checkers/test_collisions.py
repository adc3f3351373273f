"""Checkers of shapes: collisions, containment, distances, windings; against plain arithmetic."""

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from scipy.optimize import minimize

from benchmarks.checkers import (
    box_triangles,
    enclosed_volume,
    near_pairs,
    pieces_outside,
    read_stl,
    winding_numbers,
    write_stl,
)
from benchmarks.checkers.containment import surface_tree, to_surface
from benchmarks.checkers.meshes import segment_segment, segment_triangle
from tests.benchmarks.checkers.nets import fork, net_of, random_tree
from tests.slower import first_of

FloatArray = NDArray[np.float64]


# Every triangle for every point, by NumPy alone: no search to get wrong. It vouches for the
# checkers' own tree, which in turn checks the product at many more points.


def brute_distances(points: FloatArray, triangles: FloatArray) -> FloatArray:
    """Distance of each point (n, 3) from the nearest of triangles (f, 3, 3), (n,)."""
    return np.array([_distances(p, triangles).min() for p in points])


def brute_windings(points: FloatArray, triangles: FloatArray) -> FloatArray:
    """Winding number of each point (n,): solid angles over 4π (van Oosterom & Strackee 1983)."""
    found = np.empty(len(points))
    for n, point in enumerate(points):
        a, b, c = (triangles[:, k] - point for k in range(3))
        la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
        above = np.einsum("ij,ij->i", a, np.cross(b, c))
        below = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
        found[n] = np.arctan2(above, below).sum() / (2 * np.pi)
    return found


def _distances(point: FloatArray, triangles: FloatArray) -> FloatArray:
    """To the foot of the perpendicular where it is within the triangle, else to the edges."""
    corner = [triangles[:, k] for k in range(3)]
    best = np.full(len(triangles), np.inf)
    for k in range(3):
        a, b = corner[k], corner[(k + 1) % 3]
        along, to = b - a, point - a
        square = (along * along).sum(1)
        t = np.clip(np.divide((to * along).sum(1), square, where=square > 0, out=0 * square), 0, 1)
        best = np.minimum(best, np.linalg.norm(to - t[:, None] * along, axis=1))
    normal = np.cross(corner[1] - corner[0], corner[2] - corner[0])
    within = np.ones(len(triangles), dtype=bool)
    for k in range(3):
        side = np.cross(corner[(k + 1) % 3] - corner[k], point - corner[k])
        within &= (side * normal).sum(1) >= 0
    size = np.linalg.norm(normal, axis=1)
    within &= size > 0
    height = np.abs(((point - corner[0]) * normal).sum(1)[within]) / size[within]
    best[within] = np.minimum(best[within], height)
    return best


def test_a_clean_fork_has_no_near_pairs():
    assert len(near_pairs(fork(), clearance_ratio=0.1).pairs) == 0


def planted(gap_mm: float):
    """A far branch of a tree crosses the near one, their walls ``gap_mm`` apart, radius 0.1."""
    z = 0.2 + gap_mm
    points = [[-5, 0, 0], [0, 0, 0], [0, 8, 0], [10, 0, 0], [10, 8, 0], [5, 5, z], [5, -5, z]]
    return net_of(points, [[0, 1], [1, 3], [1, 2], [2, 4], [4, 5], [5, 6]], 0.1)


@pytest.mark.parametrize(("gap", "collides"), [(-0.05, True), (0.009, True), (0.011, False)])
def test_a_planted_collision_is_found_up_to_the_clearance(gap, collides):
    found = near_pairs(planted(gap), clearance_ratio=0.1)
    assert found.colliding.tolist() == ([[1, 5]] if collides else [])
    assert len(found.within_joints) == 0
    if collides:
        assert found.gap == pytest.approx([gap])


def test_the_thinner_radius_and_the_larger_clearance_count():
    apart = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]
    net = net_of(apart, [[0, 1], [2, 3]], [0.7, 0.2])
    assert near_pairs(net, clearance_ratio=0.49).colliding.tolist() == []
    assert near_pairs(net, clearance_ratio=0.51).colliding.tolist() == [[0, 1]]
    assert near_pairs(net, clearance_mm=0.11, clearance_ratio=0.1).colliding.tolist() == [[0, 1]]


def short_link(length):
    """Two branches a short link apart, both turned the same way: near, one joint or not."""
    points = [[-3, 0, 0], [0, 0, 0], [length, 0, 0], [0, 3, 0], [length, 3, 0], [3, -3, 0]]
    return net_of(points, [[0, 1], [1, 2], [1, 3], [2, 4], [2, 5]], 0.1)


def test_what_is_near_along_the_vessels_belongs_to_the_joint():
    found = near_pairs(short_link(0.15), clearance_ratio=0.1)
    assert found.joint.all()
    at = found.within_joints.tolist().index([2, 3])
    assert found.gap[at] == pytest.approx(-0.05)
    assert [2, 3] in near_pairs(short_link(0.209), clearance_ratio=0.1).within_joints.tolist()
    assert len(near_pairs(short_link(0.211), clearance_ratio=0.1).pairs) == 0


def test_a_way_just_longer_than_the_limit_makes_a_collision():
    """A hairpin: out, across and back, its arms overlapping; the way between them is the bend."""

    def hairpin(depth):
        points = [[0, 0, 0], [2, 0, 0], [2, 0, depth], [2, 0.05, depth], [2, 0.05, 0], [0, 0.1, 0]]
        return net_of(points, [[0, 1], [1, 2], [2, 3], [3, 4], [4, 5]], [0.1] * 5)

    limit = 0.4 + 0.01
    below, above = (limit - 0.05 - 1e-6) / 2, (limit - 0.05 + 1e-6) / 2
    assert near_pairs(hairpin(below), clearance_ratio=0.1).colliding.tolist() == []
    assert near_pairs(hairpin(above), clearance_ratio=0.1).colliding.tolist() == [[0, 4]]


def test_other_trees_always_count():
    points = [[0, 0, 0], [1, 0, 0], [1.05, 0, 0], [2, 0, 0]]
    assert near_pairs(net_of(points, [[0, 1], [2, 3]], 0.1)).colliding.tolist() == [[0, 1]]


def test_the_shorter_way_round_a_loop_counts():
    """Opposite sides of a ring overlap; the way is 0.1 round its short side, 3 round the long."""
    points = [[-5, 0, 0], [0, 0, 0], [1, 0, 0], [1, 0.1, 0], [0, 0.1, 0]]
    ring = [[0, 1], [1, 2], [2, 3], [4, 3]]
    assert near_pairs(net_of(points, ring, 0.06)).within_joints.tolist() == [[1, 3]]
    closed = net_of(points + [[0, 3, 0]], ring + [[1, 5], [5, 4]], 0.06)
    assert [1, 3] in near_pairs(closed).within_joints.tolist()
    long_way = net_of(
        points + [[3, 0, 0], [3, 0.1, 0]], [*ring[:2], [2, 5], [5, 6], [6, 3], ring[3]], 0.06
    )
    assert [1, 5] in near_pairs(long_way).colliding.tolist()


def all_pairs(net, ratio):
    """Every pair in plain Python: sampled-free distances by projections, ways by Floyd-Warshall."""
    n, nodes = net.count, net.node_count
    way = np.full((nodes, nodes), np.inf)
    np.fill_diagonal(way, 0)
    for (a, b), length in zip(net.node, net.length, strict=True):
        way[a, b] = way[b, a] = min(way[a, b], length)
    for k in range(nodes):
        way = np.minimum(way, way[:, [k]] + way[[k], :])
    colliding, joint = [], []
    for i in range(n):
        for j in range(i + 1, n):
            if set(net.node[i]) & set(net.node[j]):
                continue
            ri, rj = net.widest[i], net.widest[j]
            keep = ratio * min(ri, rj)
            if axis_distance(net, i, j) - ri - rj >= keep:
                continue
            between = way[np.ix_(net.node[i], net.node[j])].min()
            (joint if between <= 2 * (ri + rj) + keep else colliding).append([i, j])
    return colliding, joint


def axis_distance(net, i, j):
    """Alternating projection onto either segment, which converges on convex sets."""
    t = 0.5
    for _ in range(20_000):
        p = net.start[j] + t * (net.end[j] - net.start[j])
        u = net.end[i] - net.start[i]
        q = net.start[i] + np.clip((p - net.start[i]) @ u / (u @ u), 0, 1) * u
        v = net.end[j] - net.start[j]
        new = np.clip((q - net.start[j]) @ v / (v @ v), 0, 1)
        if abs(new - t) < 1e-15:
            break
        t = new
    return np.linalg.norm(net.start[j] + t * v - q)


@pytest.mark.parametrize("seed", first_of(range(4)))
def test_the_box_tree_finds_what_all_pairs_find(seed):
    random = np.random.default_rng(seed)
    net = random_tree(random, 25, radius=0.02)
    colliding, joint = all_pairs(net, 0.1)
    found = near_pairs(net, clearance_ratio=0.1)
    assert found.colliding.tolist() == colliding
    assert found.within_joints.tolist() == joint
    assert len(colliding) > 3


BOX = box_triangles(np.array([-1.0, -3, -1]), np.array([5.0, 3, 1]))


def shell(outer, inner):
    """A hollow ball: the cavity's surface turned inside out."""
    ball = [trimesh.creation.icosphere(subdivisions=3, radius=r).triangles for r in (outer, inner)]
    return np.concatenate([ball[0], ball[1][:, ::-1]])


def test_what_lies_inside_passes():
    assert len(pieces_outside(fork(), BOX).pieces) == 0


def test_planted_pieces_outside_are_found_though_they_meet_no_surface():
    points = [[-2, 0, 0], [2, 0, 0], [4, 2, 0], [4, -9, 0]]
    found = pieces_outside(net_of(points, [[0, 1], [1, 2], [1, 3]], 0.1), BOX)
    assert found.pieces.tolist() == [2]
    assert np.isinf(found.excess_mm).all()
    points = [[0, 0, 0], [9, 0, 0], [10, 1, 0], [10, -1, 0]]
    found = pieces_outside(net_of(points, [[0, 1], [1, 2], [1, 3]], 0.1), BOX)
    assert found.pieces.tolist() == [1, 2]


@pytest.mark.parametrize(("radius", "leaves"), [(0.999, []), (1.001, [1, 2])])
def test_the_lumen_counts_not_just_the_axis(radius, leaves):
    found = pieces_outside(fork([0.1, radius, radius]), BOX)
    assert found.pieces.tolist() == leaves
    assert found.excess_mm == pytest.approx([0.001] * len(leaves))


def test_a_cavity_is_outside():
    ball = shell(5.0, 2.0)
    windings = winding_numbers(np.array([[0, 0, 0], [3, 0, 0], [0.1, -3, 1], [6, 0, 0.0]]), ball)
    assert windings.tolist() == [0, 1, 1, 0]
    points = [[0, 0, 6], [0, 0, 4], [3.5, 0, 0], [-0.5, 0, 0]]
    found = pieces_outside(net_of(points, [[0, 1], [1, 2], [1, 3]], 0.1), ball)
    assert found.pieces.tolist() == [2]


def test_windings_on_a_torus_agree_with_its_formula():
    torus = trimesh.creation.torus(3.0, 1.0, major_sections=96, minor_sections=48)
    points = np.random.default_rng(2).uniform([-4.5, -4.5, -1.5], [4.5, 4.5, 1.5], (3000, 3))
    tube = np.hypot(np.hypot(points[:, 0], points[:, 1]) - 3.0, points[:, 2])
    clear = np.abs(tube - 1.0) > 0.01
    windings = winding_numbers(points, np.asarray(torus.triangles))
    assert (windings[clear] == (tube < 1.0)[clear]).all()


def test_overlapping_shells_count_twice_and_stay_inside():
    two = np.concatenate([BOX, BOX + [1.0, 0, 0]])
    assert winding_numbers(np.array([[0.5, 0, 0], [-0.5, 0.3, 0.2]]), two).tolist() == [2, 1]


def test_excess_is_exact_on_a_ball_of_many_faces():
    ball = trimesh.creation.icosphere(subdivisions=4, radius=2.0)
    random = np.random.default_rng(3)
    start, end = random.uniform(-1, 1, (2, 40, 3))
    nodes = np.concatenate([[[0, 0, -1.9]], start, end])
    edges = [[0, 1 + k] for k in range(40)] + [[1 + k, 41 + k] for k in range(40)]
    net = net_of(nodes, edges, 1.2)
    found = pieces_outside(net, np.asarray(ball.triangles))
    deep = 2.0 - np.maximum(np.linalg.norm(start, axis=1), np.linalg.norm(end, axis=1))
    expected = {40 + k: 1.2 - d for k, d in enumerate(deep) if d < 1.19}
    got = dict(zip(found.pieces.tolist(), found.excess_mm.tolist(), strict=True))
    assert set(expected) <= set(got)
    assert all(abs(got[k] - e) < 0.01 for k, e in expected.items())


def minimised(first, second):
    """Least distance between two convex hulls of points, by quadratic minimisation."""

    def split(w):
        return w[: len(first)], w[len(first) :]

    def square(w):
        u, v = split(w)
        return float(((u @ first - v @ second) ** 2).sum())

    def slope(w):
        u, v = split(w)
        apart = u @ first - v @ second
        return 2 * np.concatenate([first @ apart, -(second @ apart)])

    sums = [
        {"type": "eq", "fun": lambda w: split(w)[0].sum() - 1},
        {"type": "eq", "fun": lambda w: split(w)[1].sum() - 1},
    ]
    begin = np.concatenate([np.full(len(p), 1 / len(p)) for p in (first, second)])
    options = {"ftol": 1e-14, "maxiter": 300}
    bounds = [(0, 1)] * len(begin)
    found = minimize(square, begin, jac=slope, bounds=bounds, constraints=sums, options=options)
    return np.sqrt(found.fun)


@pytest.mark.parametrize("corners", [2, 3])
def test_distance_is_the_least_between_any_two_points(corners):
    random = np.random.default_rng(corners)
    distance = segment_segment if corners == 2 else segment_triangle
    for _ in range(150):
        first = random.normal(size=(2, 3))
        second = random.normal(size=(corners, 3)) + random.normal(size=3) * random.uniform(0, 2)
        assert distance(*first, *second) == pytest.approx(minimised(first, second), abs=2e-4)


def test_crossing_parallel_touching_and_pointlike_segments():
    at = lambda *p: np.array(p, dtype=float)  # noqa: E731
    assert segment_segment(at(-1, 0, 0), at(1, 0, 0), at(0, -1, 3), at(0, 1, 3)) == 3
    assert segment_segment(at(0, 0, 0), at(1, 0, 0), at(0, 2, 0), at(1, 2, 0)) == 2
    assert segment_segment(at(0, 0, 0), at(1, 0, 0), at(4, 4, 0), at(9, 4, 0)) == 5
    assert segment_segment(at(0, 0, 0), at(1, 0, 0), at(1, 0, 0), at(2, 5, 0)) == 0
    assert segment_segment(at(1, 1, 1), at(1, 1, 1), at(0, 0, 1), at(2, 0, 1)) == 1


def test_a_segment_through_a_triangle_has_no_distance():
    corner = np.array([[0, 0, 0], [3, 0, 0], [0, 3, 0]], dtype=float)
    for flip in (corner, corner[::-1]):
        assert segment_triangle(np.array([1, 1, -1.0]), np.array([1, 1, 1.0]), *flip) == 0
        assert segment_triangle(np.array([1, 1, 2.0]), np.array([1, 1, 1.0]), *flip) == 1
        assert segment_triangle(np.array([2, 2, -1.0]), np.array([2, 2, 1.0]), *flip) > 0.7


SMALL_BOX = box_triangles(np.zeros(3), np.array([4.0, 3.0, 2.0]))


def test_distance_and_winding_of_a_box_are_known():
    points = np.array([[2.0, 1.5, 0.5], [2.0, 1.5, 3.0], [7.0, 7.0, 1.0], [5.0, 4.0, 3.0]])
    np.testing.assert_allclose(brute_distances(points, SMALL_BOX), [0.5, 1.0, 5.0, np.sqrt(3.0)])
    np.testing.assert_allclose(brute_windings(points, SMALL_BOX), [1.0, 0.0, 0.0, 0.0], atol=1e-12)


def test_box_tree_agrees_with_brute_force_on_random_triangles():
    rng = np.random.default_rng(0)
    triangles = rng.uniform(0, 10, (200, 1, 3)) + rng.normal(0, 1, (200, 3, 3))
    points = rng.uniform(0, 10, (50, 3))
    tree = surface_tree(triangles)
    found = to_surface(points, points, np.full(50, 99.0), tree, triangles[tree.order])
    np.testing.assert_allclose(found, brute_distances(points, triangles), atol=1e-12)


def test_winding_numbers_agree_with_brute_force():
    rng = np.random.default_rng(1)
    shifted = SMALL_BOX + np.array([1.0, 1.0, 0.5])
    both = np.concatenate([SMALL_BOX, shifted])
    points = rng.uniform(-1, 6, (200, 3))
    found = winding_numbers(points, both)
    np.testing.assert_array_equal(found, np.rint(brute_windings(points, both)))
    assert found.max() == 2


def test_a_box_reads_back_turned_outward_and_other_files_are_refused(tmp_path):
    box = box_triangles(np.array([1.0, 2, 3]), np.array([2.0, 4, 7]))
    assert enclosed_volume(box) == pytest.approx(8.0)
    box = box_triangles(np.zeros(3), np.ones(3))
    write_stl(tmp_path / "box.stl", box[:, ::-1])
    assert np.array_equal(read_stl(tmp_path / "box.stl"), box)
    (tmp_path / "a.stl").write_text("solid a\nendsolid a\n")
    with pytest.raises(ValueError, match="binary STL"):
        read_stl(tmp_path / "a.stl")
