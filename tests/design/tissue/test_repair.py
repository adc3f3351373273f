"""Loading and repair of meshes: units, limits, what is mended and what is refused."""

from functools import cache

import numpy as np
import pytest
import trimesh
from manifold3d import Manifold

from design.errors import TissueError
from design.tissue import (
    SizeLimits,
    Surface,
    block,
    load_tissue,
    parts_of,
    repair_surface,
    tissue_from_surface,
)
from design.tissue.parts import crossing_faces
from tests.design.tissue import surfaces
from tests.design.tissue.kept import shared

BOX = block((16.0, 8.0, 3.0))


def written(path, scale=1.0, keep=slice(None)):
    mesh = trimesh.Trimesh(BOX.vertices * scale, BOX.faces[keep], process=False)
    mesh.export(path)
    return path


@pytest.mark.parametrize("suffix", ["stl", "obj", "ply", "3mf"])
def test_every_format_gives_the_same_tissue(tmp_path, suffix):
    tissue = load_tissue(written(tmp_path / f"box.{suffix}"), "mm")
    assert tissue.volume_mm3 == pytest.approx(384.0)
    np.testing.assert_allclose(tissue.bounds, [[0, 0, 0], [16, 8, 3]], atol=1e-6)


def test_unit_scales_the_tissue_and_size_limits_are_a_parameter(tmp_path):
    tissue = load_tissue(written(tmp_path / "box.stl", scale=0.1), "cm")
    assert tissue.volume_mm3 == pytest.approx(384.0, rel=1e-6)
    path = written(tmp_path / "tiny.stl", scale=0.1)
    limits = SizeLimits(smallest_mm=1.0)
    assert load_tissue(path, "mm", limits=limits).volume_mm3 == pytest.approx(0.384, rel=1e-5)


def test_inches_labelled_mm_are_refused_with_the_unit_that_fits(tmp_path):
    path = written(tmp_path / "inches.stl", scale=1 / 25.4)
    with pytest.raises(TissueError, match=r"0\.6299 mm long .* in \(16 mm\)"):
        load_tissue(path, "mm")
    assert load_tissue(path, "in").volume_mm3 == pytest.approx(384.0, rel=1e-5)


def test_open_mesh_is_refused_with_the_number_of_open_edges(tmp_path):
    path = written(tmp_path / "open.stl", keep=slice(2, None))
    with pytest.raises(TissueError, match=r"open\.stl: .* 2 of 2 holes .* 6 of 18 edges"):
        load_tissue(path, "mm")


def test_missing_unknown_and_garbage_files_are_refused(tmp_path):
    with pytest.raises(TissueError, match="no such file"):
        load_tissue(tmp_path / "absent.stl", "mm")
    with pytest.raises(TissueError, match=r"\.xyz isn't one of"):
        load_tissue(tmp_path / "points.xyz", "mm")
    with pytest.raises(TissueError, match="isn't one of"):
        load_tissue(written(tmp_path / "box.stl"), "parsec")  # type: ignore[arg-type]
    path = tmp_path / "noise.ply"
    path.write_bytes(bytes(range(256)) * 4)
    with pytest.raises(TissueError, match=r"noise\.ply"):
        load_tissue(path, "mm")


def test_real_gyrus_has_its_published_volume():
    tissue = load_tissue(shared("gyrus_patch_fsaverage5.stl"), "mm")
    assert tissue.volume_mm3 == pytest.approx(4760, rel=2e-3)
    point, inward = tissue.top_vertex()
    assert point[2] == tissue.surface.vertices[:, 2].max()
    assert tissue.contains((point + 0.3 * inward)[None]).all()


def test_nan_vertices_and_inconsistent_faces_are_refused():
    vertices = BOX.vertices.copy()
    vertices[0, 0] = np.nan
    with pytest.raises(TissueError, match="NaN"):
        tissue_from_surface(vertices, BOX.faces)
    faces = BOX.faces.copy()
    faces[0] = faces[0, ::-1]
    with pytest.raises(TissueError, match="isn't consistently oriented: at 3 of 18 edges"):
        tissue_from_surface(BOX.vertices, faces)


def test_empty_mesh_is_refused(tmp_path):
    (tmp_path / "none.stl").write_text("solid nothing\nendsolid nothing\n")
    (tmp_path / "none.obj").write_text("# nothing\n")
    for name in ("none.stl", "none.obj"):
        with pytest.raises(TissueError, match=name):
            load_tissue(tmp_path / name, "mm")
    with pytest.raises(TissueError, match="mesh is empty"):
        tissue_from_surface(np.empty((0, 3)), np.empty((0, 3), dtype=int))


# Repair.


@cache
def ball():
    return surfaces.surface(surfaces.sphere(10.0))


def sound(shape):
    assert surfaces.closed(shape)
    assert len(crossing_faces(shape.vertices, shape.faces)) == 0
    return shape.volume_mm3


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
    mesh = trimesh.load(shared(f"{name}.stl"), process=False)
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
    assert mended(*surfaces.joined(*parts), "2 overlapping shells") == pytest.approx(
        union, rel=1e-6
    )
    volume = mended(
        *surfaces.joined(parts[0], inverted(parts[1])), "1 shell(s) turned", "2 overlapping"
    )
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


def test_large_holes_and_many_are_refused_with_size_and_place():
    top = ball().vertices[ball().faces].mean(axis=1)[:, 2] > 8
    with pytest.raises(TissueError, match=r"1 of 1 holes are too wide .* 12\.\d .*near \("):
        repair_surface(ball().vertices, ball().faces[~top])
    keep = np.random.default_rng(3).random(len(ball().faces)) > 0.08
    with pytest.raises(TissueError, match=r"holes (make up|are too wide)"):
        repair_surface(ball().vertices, ball().faces[keep])
    shell = surfaces.surface(surfaces.sphere(4.0).translate((30.0, 0.0, 0.0)))
    middle = shell.vertices[shell.faces].mean(axis=1)
    half = Surface(shell.vertices, shell.faces[middle[:, 2] < 0])
    with pytest.raises(TissueError, match="mesh is open"):
        repair_surface(*surfaces.joined(ball(), half))


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
    volume = mended(
        *surfaces.joined(ball(), sheet), "1 sheet(s) of", "left out, which enclose nothing"
    )
    assert volume == pytest.approx(ball().volume_mm3, rel=1e-12)


def test_the_wall_between_solids_that_share_a_face_goes():
    one = surfaces.surface(Manifold.cube((4.0, 4.0, 4.0)))
    other = Surface(one.vertices * [-1, 1, 1], one.faces[:, ::-1].copy())
    found, _ = repair_surface(*surfaces.joined(one, other))
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


def cube(side, *corner):
    return surfaces.surface(Manifold.cube((side,) * 3).translate(tuple(map(float, corner))))


def test_parts_that_touch_in_edges_alone_stay_parts(tmp_path):
    """Six cubes around an empty one: each touches four others in an edge."""
    places = [(1, 1, 0), (1, 0, 1), (0, 1, 1), (2, 1, 1), (1, 2, 1), (1, 1, 2)]
    vertices, faces = surfaces.joined(*(cube(4.0, *(4 * x for x in place)) for place in places))
    path = tmp_path / "cubes.ply"
    trimesh.Trimesh(vertices, faces, process=False).export(path)
    parts = parts_of(load_tissue(path, "mm"))
    assert [part.volume_mm3 for part in parts] == pytest.approx([64.0] * 6)


def test_boxes_that_share_a_wall_split_otherwise_are_one():
    one, other = cube(8.0, 0, 0, 0), cube(8.0, 8, 0, 0)
    mirrored = Surface(other.vertices * [1, -1, 1] + [0, 8, 0], other.faces[:, ::-1].copy())
    for beside in (other, mirrored):
        found, _ = repair_surface(*surfaces.joined(one, beside))
        assert sound(found) == pytest.approx(1024.0)


def aside(shape):
    return surfaces.surface(shape.translate((25.0, 0.0, 0.0)))


def test_shells_are_turned_united_or_told_by_where_they_lie():
    far, hollow = aside(surfaces.sphere(4.0)), aside(surfaces.sphere(5.0) - surfaces.sphere(3.0))
    for beside, words in ((far, "1 shell(s) turned"), (hollow, "2 shell(s) turned")):
        volume = mended(*surfaces.joined(ball(), inverted(beside)), words)
        assert volume == pytest.approx(ball().volume_mm3 + beside.volume_mm3)
    block = surfaces.surface(Manifold.cube((2.0, 2.0, 2.0)))
    beside = Surface(block.vertices + [2.0, 0.5, 0.5], block.faces)
    words = "2 overlapping shells united, or touching ones"
    assert mended(*surfaces.joined(block, beside), words) == pytest.approx(16.0)
    found, notes = repair_surface(*surfaces.joined(ball(), surfaces.surface(surfaces.sphere(3.0))))
    assert sound(found) == pytest.approx(ball().volume_mm3, rel=1e-6)
    assert "1 shell(s) inside others look outward" in notes[1]


@pytest.mark.parametrize("again", [slice(10), slice(None)])
def test_duplicate_faces_are_dropped_in_both_windings(again):
    faces = np.concatenate([ball().faces, ball().faces[again, ::-1]])
    volume = mended(ball().vertices, faces, "duplicate face(s)")
    assert volume == pytest.approx(ball().volume_mm3)
