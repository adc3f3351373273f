from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh
from manifold3d import Manifold

from design.errors import TissueError
from design.tissue import Surface, load_tissue, repair_surface
from design.tissue.parts import parts_of
from design.tissue.shells import crossing_faces
from tests.design.tissue import surfaces

SHARED = Path(__file__).parents[4] / "shared" / "data"


@cache
def ball():
    return surfaces.surface(surfaces.sphere(10.0))


def sound(shape):
    mesh = trimesh.Trimesh(shape.vertices, shape.faces, process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert len(crossing_faces(shape.vertices, shape.faces)) == 0
    return shape.volume_mm3


def joined(*shapes):
    start = np.cumsum([0] + [len(s.vertices) for s in shapes])
    faces = [s.faces + n for s, n in zip(shapes, start, strict=False)]
    return np.concatenate([s.vertices for s in shapes]), np.concatenate(faces)


def inverted(shape):
    return Surface(shape.vertices, shape.faces[:, ::-1])


def mended(vertices, faces, *words):
    """Repair; the one note must hold the words."""
    found, notes = repair_surface(vertices, faces)
    assert len(notes) == 1
    for word in ("mesh repaired", "before", *words):
        assert word in notes[0]
    return sound(found)


@pytest.mark.parametrize("make", [surfaces.hollow_sphere, surfaces.torus, surfaces.nested_shells])
def test_sound_surface_is_handed_on_untouched(make):
    shape = make()
    found, notes = repair_surface(shape.vertices, shape.faces)
    assert notes == ()
    assert found.volume_mm3 == pytest.approx(shape.volume_mm3, rel=1e-12)
    assert len(found.faces) == len(shape.faces)
    assert set(map(tuple, found.vertices)) == set(map(tuple, shape.vertices))


@pytest.mark.parametrize(
    "name", ["biventricle_svv", "gyrus_patch_fsaverage5", "cortex_pial_left_fsaverage5"]
)
def test_real_meshes_need_no_repair(name):
    path = SHARED / f"{name}.stl"
    if not path.is_file():
        pytest.skip("no shared data beside the repository")
    mesh = trimesh.load(path, process=False)
    assert repair_surface(np.asarray(mesh.vertices), np.asarray(mesh.faces))[1] == ()


def test_triangle_soup_with_rounded_corners_is_sewn():
    rng = np.random.default_rng(0)
    soup = ball().vertices[ball().faces].reshape(-1, 3)
    soup = soup + rng.uniform(-1e-5, 1e-5, soup.shape)
    faces = np.arange(len(soup)).reshape(-1, 3)
    assert mended(soup, faces, "vertices merged") == pytest.approx(ball().volume_mm3, rel=1e-5)


def test_turned_faces_are_turned_back():
    faces = ball().faces.copy()
    turned = np.random.default_rng(1).choice(len(faces), 500, replace=False)
    faces[turned] = faces[turned, ::-1]
    volume = mended(ball().vertices, faces, "500 face(s) turned to agree")
    assert volume == pytest.approx(ball().volume_mm3)


def test_small_holes_are_filled_with_their_places_told():
    middle = ball().vertices[ball().faces].mean(axis=1)
    gone = (np.linalg.norm(middle - [0, 0, 10], axis=1) < 0.8) | (
        np.linalg.norm(middle - [10, 0, 0], axis=1) < 0.6
    )
    volume = mended(ball().vertices, ball().faces[~gone], "2 hole(s) filled", "near (")
    assert volume == pytest.approx(ball().volume_mm3, rel=3e-3)


def test_overlapping_shells_become_one():
    one, two = surfaces.sphere(6.0), surfaces.sphere(6.0).translate((5.0, 0.0, 0.0))
    parts = surfaces.surface(one), surfaces.surface(two)
    union = surfaces.surface(one + two).volume_mm3
    assert mended(*joined(*parts), "2 overlapping shells") == pytest.approx(union, rel=1e-6)
    volume = mended(*joined(parts[0], inverted(parts[1])), "1 shell(s) turned", "2 overlapping")
    assert volume == pytest.approx(union, rel=1e-6)


def ball_with_a_tangle(sides):
    shape = surfaces.surface(surfaces.sphere(10.0, sides))
    one, two = shape.faces[1000][:2]
    vertices = shape.vertices.copy()
    vertices[one] += 1.7 * (vertices[two] - vertices[one])
    return shape, vertices


def test_crossing_faces_are_all_found():
    shape, vertices = ball_with_a_tangle(64)
    expected = set()
    low = vertices[shape.faces].min(axis=1)
    high = vertices[shape.faces].max(axis=1)
    for n in range(len(shape.faces)):
        near = np.flatnonzero((low <= high[n]).all(axis=1) & (high >= low[n]).all(axis=1))
        for m in near[near > n]:
            if not set(shape.faces[n]) & set(shape.faces[m]) and meet(
                vertices[shape.faces[n]], vertices[shape.faces[m]]
            ):
                expected.add((n, m))
    found = {tuple(sorted(pair)) for pair in crossing_faces(vertices, shape.faces).tolist()}
    assert found == expected
    assert expected


def meet(one, two):
    """Whether an edge of either triangle passes through the other, by solving for where."""
    for a, b in ((one, two), (two, one)):
        for k in range(3):
            p, q = a[k], a[(k + 1) % 3]
            columns = np.column_stack([q - p, b[0] - b[1], b[0] - b[2]])
            if abs(np.linalg.det(columns)) < 1e-15:
                continue
            t, u, v = np.linalg.solve(columns, b[0] - p)
            if 0 <= t <= 1 and u >= 0 and v >= 0 and u + v <= 1:
                return True
    return False


def test_large_hole_is_refused_with_size_and_place():
    top = ball().vertices[ball().faces].mean(axis=1)[:, 2] > 8
    with pytest.raises(TissueError, match=r"1 of 1 holes are too wide .* 12\.\d .*near \("):
        repair_surface(ball().vertices, ball().faces[~top])


def test_surface_that_passes_through_itself_at_large_is_refused():
    # A tube along a figure of eight; it was called open, of what was cut out around the crossing.
    turn = np.linspace(0, 2 * np.pi, 120, endpoint=False)
    middle = np.column_stack([8 * np.sin(turn), 8 * np.sin(turn) * np.cos(turn), 0 * turn])
    way = np.roll(middle, -1, axis=0) - np.roll(middle, 1, axis=0)
    way /= np.linalg.norm(way, axis=1)[:, None]
    up = np.array([0.0, 0.0, 1.0])
    side = np.cross(way, up)
    ring = np.linspace(0, 2 * np.pi, 24, endpoint=False)[:, None, None]
    points = (middle + 1.5 * (np.cos(ring) * side + np.sin(ring) * up)).transpose(1, 0, 2)
    i, j = np.meshgrid(np.arange(120), np.arange(24), indexing="ij")
    a, b = i * 24 + j, i * 24 + (j + 1) % 24
    c, d = (i + 1) % 120 * 24 + j, (i + 1) % 120 * 24 + (j + 1) % 24
    faces = np.concatenate([np.stack([a, b, d], -1), np.stack([a, d, c], -1)]).reshape(-1, 3)
    with pytest.raises(TissueError, match=r"passes through itself: .*near \(.*one solid there"):
        repair_surface(points.reshape(-1, 3), faces)


def test_moebius_strip_is_refused():
    turn = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    edge = [
        (8 + w * np.cos(turn / 2))[:, None]
        * np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
        + np.outer(w * np.sin(turn / 2), [0, 0, 1])
        for w in (-1, 1)
    ]
    i = np.arange(60)
    j = (i + 1) % 60
    last = i == 59
    a, b = i, i + 60
    c, d = np.where(last, j + 60, j), np.where(last, j, j + 60)
    faces = np.concatenate([np.column_stack([a, b, d]), np.column_stack([a, d, c])])
    with pytest.raises(TissueError, match=r"can't be oriented: .*near \("):
        repair_surface(np.concatenate(edge), faces)


def test_file_is_repaired_with_a_note(tmp_path):
    path = tmp_path / "holes.stl"
    keep = np.delete(ball().faces, [5, 900], axis=0)
    trimesh.Trimesh(ball().vertices, keep, process=False).export(path)
    tissue = load_tissue(path, "mm")
    assert tissue.volume_mm3 == pytest.approx(ball().volume_mm3, rel=1e-2)
    assert tissue.notes[0].startswith("holes.stl: mesh repaired: 2 hole(s) filled")


@pytest.mark.parametrize("place", [(30.0, 0.0, 0.0), (0.0, 0.0, 0.0)])
def test_a_sheet_beside_or_within_is_left_out_and_told(place):
    corners = np.array([[0.0, 0, 0], [4, 0, 1], [4, 4, 0], [0, 4, 1]]) + place
    sheet = Surface(corners, np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32))
    volume = mended(*joined(ball(), sheet), "1 sheet(s) of", "left out, which enclose nothing")
    assert volume == pytest.approx(ball().volume_mm3, rel=1e-12)


def test_the_wall_between_solids_that_share_a_face_goes():
    one = surfaces.surface(Manifold.cube((4.0, 4.0, 4.0)))
    other = Surface(one.vertices * [-1, 1, 1], one.faces[:, ::-1].copy())
    found, _ = repair_surface(*joined(one, other))
    assert sound(found) == pytest.approx(128.0)
    assert np.abs(found.vertices[found.faces][..., 0]).max(axis=1).min() > 0


def test_all_at_once():
    rng = np.random.default_rng(2)
    faces = np.delete(ball().faces, [5, 900, 901], axis=0)
    turned = rng.choice(len(faces), 100, replace=False)
    faces[turned] = faces[turned, ::-1]
    soup = ball().vertices[np.concatenate([faces, faces[40:50]])].reshape(-1, 3)
    volume = mended(soup, np.arange(len(soup)).reshape(-1, 3), "duplicate", "turned", "filled")
    assert volume == pytest.approx(ball().volume_mm3, rel=3e-3)


def test_small_tangle_is_replaced():
    shape, vertices = ball_with_a_tangle(160)
    assert len(crossing_faces(vertices, shape.faces)) > 0
    volume = mended(vertices, shape.faces, "passed through itself", "near (")
    assert volume == pytest.approx(shape.volume_mm3, rel=2e-3)


def test_many_holes_are_refused():
    keep = np.random.default_rng(3).random(len(ball().faces)) > 0.08
    with pytest.raises(TissueError, match=r"holes (make up|are too wide)"):
        repair_surface(ball().vertices, ball().faces[keep])


def test_vertices_on_a_neighbours_edge_split_it():
    """A joint of three faces in a T: the edges are open, and nothing is missing."""
    points, faces = ball().vertices.tolist(), ball().faces.tolist()
    for k in (0, 7, 40):
        a, b, c = faces[k]
        points.append((0.3 * np.array(points[a]) + 0.7 * np.array(points[b])).tolist())
        faces[k] = [a, len(points) - 1, c]
        faces.append([len(points) - 1, b, c])
    volume = mended(np.array(points), np.array(faces), "3 edge(s) split at vertices")
    assert volume == pytest.approx(ball().volume_mm3, rel=1e-12)


def test_a_solid_with_a_large_hole_is_no_sheet_and_refused():
    shell = surfaces.surface(surfaces.sphere(4.0).translate((30.0, 0.0, 0.0)))
    middle = shell.vertices[shell.faces].mean(axis=1)
    half = Surface(shell.vertices, shell.faces[middle[:, 2] < 0])
    with pytest.raises(TissueError, match="mesh is open"):
        repair_surface(*joined(ball(), half))


def cube(side, *corner):
    return surfaces.surface(Manifold.cube((side,) * 3).translate(tuple(map(float, corner))))


def test_parts_that_touch_in_edges_alone_stay_parts(tmp_path):
    """Six cubes around an empty one: each touches four others in an edge."""
    places = [(1, 1, 0), (1, 0, 1), (0, 1, 1), (2, 1, 1), (1, 2, 1), (1, 1, 2)]
    vertices, faces = joined(*(cube(4.0, *(4 * x for x in place)) for place in places))
    path = tmp_path / "cubes.ply"
    trimesh.Trimesh(vertices, faces, process=False).export(path)
    parts = parts_of(load_tissue(path, "mm"))
    assert [part.volume_mm3 for part in parts] == pytest.approx([64.0] * 6)


def test_boxes_that_share_a_wall_split_otherwise_are_one():
    one, other = cube(8.0, 0, 0, 0), cube(8.0, 8, 0, 0)
    mirrored = Surface(other.vertices * [1, -1, 1] + [0, 8, 0], other.faces[:, ::-1].copy())
    for beside in (other, mirrored):
        found, _ = repair_surface(*joined(one, beside))
        assert sound(found) == pytest.approx(1024.0)


def aside(shape):
    return surfaces.surface(shape.translate((25.0, 0.0, 0.0)))


def test_shells_are_turned_united_or_told_by_where_they_lie():
    far, hollow = aside(surfaces.sphere(4.0)), aside(surfaces.sphere(5.0) - surfaces.sphere(3.0))
    for beside, words in ((far, "1 shell(s) turned"), (hollow, "2 shell(s) turned")):
        volume = mended(*joined(ball(), inverted(beside)), words)
        assert volume == pytest.approx(ball().volume_mm3 + beside.volume_mm3)
    block = surfaces.surface(Manifold.cube((2.0, 2.0, 2.0)))
    beside = Surface(block.vertices + [2.0, 0.5, 0.5], block.faces)
    words = "2 overlapping shells united, or touching ones"
    assert mended(*joined(block, beside), words) == pytest.approx(16.0)
    found, notes = repair_surface(*joined(ball(), surfaces.surface(surfaces.sphere(3.0))))
    assert sound(found) == pytest.approx(ball().volume_mm3, rel=1e-6)
    assert "1 shell(s) inside others look outward" in notes[1]


@pytest.mark.parametrize("again", [slice(10), slice(None)])
def test_duplicate_faces_are_dropped_in_both_windings(again):
    faces = np.concatenate([ball().faces, ball().faces[again, ::-1]])
    volume = mended(ball().vertices, faces, "duplicate face(s)")
    assert volume == pytest.approx(ball().volume_mm3)
