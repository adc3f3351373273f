import numpy as np
import pytest
import trimesh

from design.errors import TissueError
from design.tissue import load_point_surface, point_surface
from design.tissue.points import estimate_normals
from tests.design.tissue import surfaces
from tests.slower import first_of


def sphere(count, seed=0):
    way = np.random.default_rng(seed).normal(size=(count, 3))
    return way / np.linalg.norm(way, axis=1)[:, None]


def torus(count, seed=0):
    """Points of a torus of radii 8 and 3, and their normals."""
    rng = np.random.default_rng(seed)
    u, v, w = rng.uniform(0, 2 * np.pi, (3, 4 * count))
    kept = np.flatnonzero(w / (2 * np.pi) < (8 + 3 * np.cos(v)) / 11)[:count]
    u, v = u[kept], v[kept]
    normal = np.column_stack([np.cos(v) * np.cos(u), np.cos(v) * np.sin(u), np.sin(v)])
    return 8 * np.column_stack([np.cos(u), np.sin(u), 0 * u]) + 3 * normal, normal


def middles(shape):
    return np.concatenate([shape.vertices, shape.vertices[shape.faces].mean(axis=1)])


def closed(shape):
    mesh = trimesh.Trimesh(shape.vertices, shape.faces, process=False)
    return mesh.is_watertight and mesh.is_winding_consistent


@pytest.mark.parametrize("oriented", first_of([False, True]))
@pytest.mark.parametrize("count", first_of([1000, 4000]))
def test_sphere_is_met_within_a_twentieth_of_the_spacing(count, oriented):
    way = sphere(count)
    shape, notes = point_surface(10 * way, way if oriented else None)
    spacing = np.sqrt(4 * np.pi * 100 / count)
    error = np.abs(np.linalg.norm(middles(shape), axis=1) - 10)
    assert closed(shape)
    assert np.sqrt(np.mean(error**2)) < 0.02 * spacing
    assert error.max() < 0.06 * spacing
    assert f"through {count} points" in notes[-1]
    assert ("were estimated" in notes[0]) is not oriented


@pytest.mark.parametrize("oriented", first_of([False, True]))
def test_torus_keeps_its_hole(oriented):
    points, normals = torus(3000)
    shape, _ = point_surface(points, normals if oriented else None)
    p = middles(shape)
    error = np.hypot(np.hypot(p[:, 0], p[:, 1]) - 8, p[:, 2]) - 3
    mesh = trimesh.Trimesh(shape.vertices, shape.faces, process=False)
    assert mesh.euler_number == 0
    assert np.abs(error).max() < 0.05
    assert shape.volume_mm3 == pytest.approx(2 * np.pi**2 * 8 * 9, rel=0.005)


def test_error_falls_faster_than_the_spacing():
    errors = []
    for count in (500, 4500):
        shape, _ = point_surface(10 * sphere(count), sphere(count))
        errors.append(abs(shape.volume_mm3 / (4 * np.pi * 1000 / 3) - 1))
    assert errors[1] < errors[0] / 3


def test_gap_is_refused_with_its_size():
    way = sphere(1500)
    way = way[way[:, 2] < 0.8]
    with pytest.raises(TissueError, match=r"points leave gaps.* % of the surface .*near \("):
        point_surface(10 * way, way)


@pytest.mark.parametrize("oriented", first_of([True, False]))
@pytest.mark.parametrize("suffix", ["xyz", "csv", "ply"])
def test_files_are_read_with_and_without_normals(tmp_path, suffix, oriented):
    way = sphere(1000)
    path = tmp_path / f"ball.{suffix}"
    table = np.column_stack([way, way]) if oriented else way
    names = ["x", "y", "z", "nx", "ny", "nz"][: table.shape[1]]
    if suffix == "ply":
        lines = ["ply", "format ascii 1.0", f"element vertex {len(way)}"]
        lines += [f"property float {name}" for name in names] + ["end_header"]
        text = "\n".join(lines) + "\n"
    else:
        text = "# ball\n" if suffix == "xyz" else ",".join(names) + "\n"
    separator = "," if suffix == "csv" else " "
    text += "".join(separator.join(f"{v:.9g}" for v in row) + "\n" for row in table)
    path.write_text(text)
    shape, notes = load_point_surface(path, "cm")
    assert shape.volume_mm3 == pytest.approx(4 / 3 * np.pi * 1000, rel=0.01)
    assert ("were estimated" in notes[0]) is not oriented
    assert notes[-1].startswith(f"ball.{suffix}: surface laid through 1000 points")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 2\n", "lines have 2 columns"),
        ("1 2 3\n1 2 3 4 5 6\n", "3 or 6 columns"),
        ("1 2 3\na b c\n", "line 2: 'a b c' isn't numbers"),
        ("x y z\n", "holds no points"),
    ],
)
def test_wrong_files_are_refused(tmp_path, text, message):
    path = tmp_path / "points.xyz"
    path.write_text(text)
    with pytest.raises(TissueError, match=message):
        load_point_surface(path, "mm")


@pytest.mark.slow
def test_mesh_surface_is_found_again():
    shape = surfaces.hollow_sphere()
    mesh = trimesh.Trimesh(shape.vertices, shape.faces, process=False)
    points, face = trimesh.sample.sample_surface(mesh, 8000, seed=0)
    found, _ = point_surface(np.asarray(points), np.asarray(mesh.face_normals[face]))
    assert found.volume_mm3 == pytest.approx(shape.volume_mm3, rel=0.005)


def test_cavity_is_told_by_its_normals():
    outer, inner = sphere(1600), sphere(800, seed=1)
    points = np.concatenate([10 * outer, 6 * inner])
    shape, _ = point_surface(points, np.concatenate([outer, -inner]))
    assert closed(shape)
    assert shape.volume_mm3 == pytest.approx(4 / 3 * np.pi * (1000 - 216), rel=0.01)


def test_estimated_normals_look_outward_everywhere():
    points, normals = torus(1200)
    near = np.argsort(np.linalg.norm(points[:, None] - points, axis=2), axis=1)[:, 1:15]
    found, parts = estimate_normals(points, near)
    assert parts == 1
    assert (np.einsum("ij,ij->i", found, normals) > 0.8).all()
