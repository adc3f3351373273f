"""Surfaces of labelled volumes and of points: volume, place, refusals."""

import nibabel
import nrrd
import numpy as np
import pytest
import tifffile
import trimesh
from scipy.ndimage import gaussian_filter

from design.errors import TissueError
from design.tissue import (
    VolumeImage,
    label_surface,
    load_label_surface,
    load_point_surface,
    point_surface,
    read_image,
)
from design.tissue.points import estimate_normals
from tests.design.tissue import surfaces
from tests.design.tissue.kept import kept_tissue
from tests.slower import first_of

RNG = np.random.default_rng(0)


def ball(radius, size=40, value=1):
    index = np.stack(np.meshgrid(*[np.arange(size)] * 3, indexing="ij"), axis=-1)
    inside = np.linalg.norm(index - (size - 1) / 2 - 0.2, axis=-1) < radius
    return (inside * value).astype(np.int16)


def stretched():
    """Voxels 0.3 x 0.2 x 0.5 mm, turned and mirrored."""
    turn = np.linalg.qr(RNG.normal(size=(3, 3)))[0]
    affine = np.eye(4)
    affine[:3, :3] = turn @ np.diag([0.3, -0.2 * np.linalg.det(turn), 0.5])
    affine[:3, 3] = (5.0, -7.0, 11.0)
    return affine


@pytest.mark.parametrize("radius", [3, 6, 10, 17])
def test_sphere_keeps_its_volume_and_lies_within_a_third_of_a_voxel(radius):
    voxels = ball(radius)
    shape, notes = label_surface(VolumeImage(voxels, np.diag([0.25, 0.25, 0.25, 1.0])), 1)
    assert notes == ()
    assert surfaces.closed(shape)
    assert shape.volume_mm3 == pytest.approx(voxels.sum() * 0.25**3, rel=0.01)
    away = np.linalg.norm(shape.vertices / 0.25 - 19.7, axis=1) - radius
    assert np.abs(away).max() < 0.45
    assert np.sqrt(np.mean(away**2)) < 0.15


@pytest.mark.parametrize("seed", first_of(range(3)))
def test_random_blobs_keep_their_volume_in_any_affine(seed):
    rng = np.random.default_rng(seed)
    voxels = gaussian_filter(rng.normal(size=(30, 34, 26)), 2.5) > 0.02
    affine = stretched()
    shape, _ = label_surface(VolumeImage(voxels.astype(np.uint8), affine), 1)
    assert surfaces.closed(shape)
    volume = voxels.sum() * abs(np.linalg.det(affine[:3, :3]))
    assert shape.volume_mm3 == pytest.approx(volume, rel=0.01)


def test_every_voxel_keeps_its_side():
    voxels = np.random.default_rng(4).random((12, 12, 12)) < 0.5
    voxels[0] = voxels[-1] = False
    shape, _ = label_surface(VolumeImage(voxels.astype(int), np.eye(4)), 1)
    tissue = kept_tissue(shape)
    centres = np.argwhere(np.ones_like(voxels)).astype(float)
    np.testing.assert_array_equal(tissue.contains(centres), voxels[tuple(centres.astype(int).T)])


def test_wall_of_one_voxel_stays_whole():
    voxels = np.zeros((20, 20, 20), dtype=int)
    voxels[3:17, 3:17, 3:17] = 7
    voxels[4:16, 4:16, 4:16] = 0
    shape, _ = label_surface(VolumeImage(voxels, np.eye(4)), 7)
    assert surfaces.closed(shape)
    assert len(trimesh.Trimesh(shape.vertices, shape.faces, process=False).split()) == 2
    assert shape.volume_mm3 == pytest.approx((voxels > 0).sum(), rel=0.01)


def written(path, voxels, affine, unit="mm"):
    name = path.name
    if ".nii" in name:
        image = nibabel.Nifti1Image(voxels, affine)
        if unit:
            image.header.set_xyzt_units({"um": "micron"}.get(unit, unit))
        nibabel.save(image, path)
    elif name.endswith(".nrrd"):
        header = {"space dimension": 3, "space directions": affine[:3, :3].T}
        header["space origin"] = affine[:3, 3]
        if unit:
            header["space units"] = [unit] * 3
        nrrd.write(str(path), voxels, header)
    return path


@pytest.mark.parametrize("name", ["a.nii", "a.nii.gz", "a.nrrd"])
@pytest.mark.parametrize(("unit", "scale"), [("mm", 1.0), ("um", 1000.0)])
def test_files_give_the_same_surface_in_mm(tmp_path, name, unit, scale):
    voxels, affine = ball(10, value=3), stretched()
    expected, _ = label_surface(VolumeImage(voxels, affine), 3)
    scaled = np.diag([scale, scale, scale, 1.0]) @ affine
    shape, _ = load_label_surface(written(tmp_path / name, voxels, scaled, unit), 3)
    assert shape.volume_mm3 == pytest.approx(expected.volume_mm3, rel=1e-4)
    np.testing.assert_allclose(
        [shape.vertices.min(axis=0), shape.vertices.max(axis=0)],
        [expected.vertices.min(axis=0), expected.vertices.max(axis=0)],
        atol=0.05,
    )


@pytest.mark.parametrize("name", ["a.nii.gz", "a.nrrd"])
def test_unit_is_asked_for_and_never_guessed(tmp_path, name):
    path = written(tmp_path / name, ball(10), np.diag([0.2, 0.2, 0.2, 1.0]), None)
    with pytest.raises(TissueError, match=r"0\.2 x 0\.2 x 0\.2 .*give unit: mm"):
        load_label_surface(path, 1)
    volume = load_label_surface(path, 1, unit="mm")[0].volume_mm3
    assert volume == pytest.approx(ball(10).sum() * 0.008, rel=0.01)
    same = load_label_surface(path, 1, voxel_mm=(2.0, 2.0, 2.0))[0].volume_mm3
    assert same == pytest.approx(1000 * volume, rel=1e-4)
    with pytest.raises(TissueError, match="doesn't fit in any"):
        load_label_surface(path, 1, voxel_mm=(0.3, 0.3, 0.3))


def test_file_that_says_otherwise_is_refused(tmp_path):
    path = written(tmp_path / "a.nii", ball(10), np.diag([0.2, 0.2, 0.2, 1.0]))
    with pytest.raises(TissueError, match="declares its unit as mm, not um"):
        load_label_surface(path, 1, unit="um")
    with pytest.raises(TissueError, match=r"says voxels are 0\.2 x 0\.2 x 0\.2 mm, not"):
        load_label_surface(path, 1, voxel_mm=(0.2, 0.2, 0.4))


def test_tiff_stack_needs_a_voxel_size_unless_it_says_one(tmp_path):
    voxels, size = ball(10).astype(np.uint8), (0.1, 0.2, 0.3)
    pages = voxels.transpose(2, 1, 0)
    expected = voxels.sum() * 0.006
    tifffile.imwrite(tmp_path / "plain.tif", pages)
    with pytest.raises(TissueError, match="give voxel_mm"):
        load_label_surface(tmp_path / "plain.tif", 1)
    shape, _ = load_label_surface(tmp_path / "plain.tif", 1, voxel_mm=size)
    assert shape.volume_mm3 == pytest.approx(expected, rel=0.01)
    np.testing.assert_allclose(
        shape.vertices.mean(axis=0), 20.2 * np.array(size), atol=0.05 * max(size)
    )
    tifffile.imwrite(
        tmp_path / "imagej.tif",
        pages,
        imagej=True,
        resolution=(1 / 100, 1 / 200),
        metadata={"spacing": 300.0, "unit": "um", "axes": "ZYX"},
    )
    tifffile.imwrite(
        tmp_path / "stack.ome.tif",
        pages,
        metadata={"axes": "ZYX", "PhysicalSizeX": 100.0, "PhysicalSizeY": 200.0}
        | {"PhysicalSizeZ": 300.0, "PhysicalSizeXUnit": "µm"},
    )
    for name in ("imagej.tif", "stack.ome.tif"):
        found, _ = load_label_surface(tmp_path / name, 1)
        assert found.volume_mm3 == pytest.approx(expected, rel=0.01)
        np.testing.assert_allclose(found.vertices, shape.vertices, atol=1e-3)


def test_files_that_are_no_volume_are_refused(tmp_path):
    (tmp_path / "noise.nii").write_bytes(bytes(range(256)) * 8)
    (tmp_path / "noise.nrrd").write_bytes(bytes(range(256)) * 8)
    (tmp_path / "noise.tif").write_bytes(bytes(range(256)) * 8)
    tifffile.imwrite(tmp_path / "flat.tif", np.zeros((20, 20), np.uint8))
    nibabel.save(
        nibabel.Nifti1Image(np.zeros((9, 9, 9, 2), np.int16), np.eye(4)), tmp_path / "v.nii"
    )
    for name in ("noise.nii", "noise.nrrd", "noise.tif", "flat.tif", "v.nii"):
        with pytest.raises(TissueError, match=name.replace(".", r"\.")):
            load_label_surface(tmp_path / name, 1, voxel_mm=(1, 1, 1))
    with pytest.raises(TissueError, match="no such file"):
        load_label_surface(tmp_path / "none.nii", 1)
    with pytest.raises(TissueError, match="must end with"):
        load_label_surface(tmp_path / "a.dcm", 1)


def test_wrong_labels_are_refused_with_what_there_is(tmp_path):
    image = VolumeImage(ball(10, value=3), np.eye(4))
    with pytest.raises(TissueError, match=r"no voxel has label 2; it has 0 \(\d+ .*3 \(\d+ voxels"):
        label_surface(image, 2)
    blurred = VolumeImage(ball(10) * 0.5, np.eye(4))
    with pytest.raises(TissueError, match="no voxel has label 1"):
        label_surface(blurred, 1)
    mixed = ball(10) * 1.0
    mixed[20, 20, 20] = 0.4
    with pytest.raises(TissueError, match="aren't whole numbers"):
        label_surface(VolumeImage(mixed, np.eye(4)), 1)


def test_axes_counted_in_several_units_are_refused_by_name(tmp_path):
    path = tmp_path / "labels.tif"
    said = {"spacing": 0.03, "unit": "micron", "zunit": "mm", "axes": "ZYX"}
    volume = np.ones((4, 5, 6), np.uint8)
    tifffile.imwrite(path, volume, imagej=True, resolution=(0.05, 0.05), metadata=said)
    with pytest.raises(TissueError, match="micron and mm"):
        read_image(path)


# Surfaces through points.


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


@pytest.mark.parametrize("oriented", first_of([False, True]))
@pytest.mark.parametrize("count", first_of([1000, 4000]))
def test_sphere_is_met_within_a_twentieth_of_the_spacing(count, oriented):
    way = sphere(count)
    shape, notes = point_surface(10 * way, way if oriented else None)
    spacing = np.sqrt(4 * np.pi * 100 / count)
    error = np.abs(np.linalg.norm(middles(shape), axis=1) - 10)
    assert surfaces.closed(shape)
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
    assert surfaces.closed(shape)
    assert shape.volume_mm3 == pytest.approx(4 / 3 * np.pi * (1000 - 216), rel=0.01)


def test_estimated_normals_look_outward_everywhere():
    points, normals = torus(1200)
    near = np.argsort(np.linalg.norm(points[:, None] - points, axis=2), axis=1)[:, 1:15]
    found, parts = estimate_normals(points, near)
    assert parts == 1
    assert (np.einsum("ij,ij->i", found, normals) > 0.8).all()
