from pathlib import Path

import numpy as np
import pytest
import trimesh

from design.errors import TissueError
from design.tissue import SizeLimits, block, load_tissue, tissue_from_surface

SHARED = Path(__file__).parents[4] / "shared" / "data"
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


def test_unit_scales_the_tissue(tmp_path):
    tissue = load_tissue(written(tmp_path / "box.stl", scale=0.1), "cm")
    assert tissue.volume_mm3 == pytest.approx(384.0, rel=1e-6)


def test_inches_labelled_mm_are_refused_with_the_unit_that_fits(tmp_path):
    path = written(tmp_path / "inches.stl", scale=1 / 25.4)
    with pytest.raises(TissueError, match=r"0\.6299 mm long .* in \(16 mm\)"):
        load_tissue(path, "mm")
    assert load_tissue(path, "in").volume_mm3 == pytest.approx(384.0, rel=1e-5)


def test_size_limits_are_a_parameter(tmp_path):
    path = written(tmp_path / "tiny.stl", scale=0.1)
    limits = SizeLimits(smallest_mm=1.0)
    assert load_tissue(path, "mm", limits=limits).volume_mm3 == pytest.approx(0.384, rel=1e-5)


def test_open_mesh_is_refused_with_the_number_of_open_edges(tmp_path):
    path = written(tmp_path / "open.stl", keep=slice(2, None))
    with pytest.raises(
        TissueError, match=r"open\.stl: mesh is open: 2 of 2 holes .* 6 of 18 edges"
    ):
        load_tissue(path, "mm")


def test_missing_and_unknown_files_are_refused(tmp_path):
    with pytest.raises(TissueError, match="no such file"):
        load_tissue(tmp_path / "absent.stl", "mm")
    with pytest.raises(TissueError, match=r"\.xyz isn't one of"):
        load_tissue(tmp_path / "points.xyz", "mm")
    with pytest.raises(TissueError, match="isn't one of"):
        load_tissue(written(tmp_path / "box.stl"), "parsec")  # type: ignore[arg-type]


def test_garbage_is_refused(tmp_path):
    path = tmp_path / "noise.ply"
    path.write_bytes(bytes(range(256)) * 4)
    with pytest.raises(TissueError, match=r"noise\.ply"):
        load_tissue(path, "mm")


def test_real_gyrus_has_its_published_volume():
    path = SHARED / "gyrus_patch_fsaverage5.stl"
    if not path.is_file():
        pytest.skip("no shared data beside the repository")
    tissue = load_tissue(path, "mm")
    assert tissue.volume_mm3 == pytest.approx(4760, rel=2e-3)
    point, inward = tissue.top_vertex()
    assert point[2] == tissue.surface.vertices[:, 2].max()
    assert tissue.contains((point + 0.3 * inward)[None]).all()


def test_nan_vertices_are_refused():
    vertices = BOX.vertices.copy()
    vertices[0, 0] = np.nan
    with pytest.raises(TissueError, match="NaN"):
        tissue_from_surface(vertices, BOX.faces)


def test_inconsistent_faces_are_refused():
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
