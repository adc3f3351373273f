import numpy as np
import pytest
import trimesh

from benchmarks.checkers import box_triangles, pieces_outside, winding_numbers
from tests.benchmarks.checkers.nets import fork, net_of

BOX = box_triangles(np.array([-1.0, -3, -1]), np.array([5.0, 3, 1]))


def shell(outer, inner):
    """A hollow ball: the cavity's surface turned inside out."""
    ball = [trimesh.creation.icosphere(subdivisions=3, radius=r).triangles for r in (outer, inner)]
    return np.concatenate([ball[0], ball[1][:, ::-1]])


def test_what_lies_inside_passes():
    assert len(pieces_outside(fork(), BOX).pieces) == 0


def test_a_planted_piece_outside_is_found_and_the_root_is_apart():
    points = [[-2, 0, 0], [2, 0, 0], [4, 2, 0], [4, -9, 0]]
    found = pieces_outside(net_of(points, [[0, 1], [1, 2], [1, 3]], 0.1), BOX)
    assert found.pieces.tolist() == [2]
    assert np.isinf(found.excess_mm).all()


def test_a_piece_wholly_outside_is_found_though_it_meets_no_surface():
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
