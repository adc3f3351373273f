import numpy as np
import pytest

from benchmarks.checkers import near_pairs
from tests.benchmarks.checkers.nets import fork, net_of, random_tree
from tests.slower import first_of


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
