"""Mesh files, judged after being read back."""

from __future__ import annotations

import base64
import zipfile
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import trimesh

from design.errors import SolidError
from design.geometry.threemf_read import read_3mf
from design.solids import (
    Part,
    Solid,
    block_solid,
    construct_solid,
    lumen_solid,
    read_solid,
    validate_file,
    write_3mf,
    write_obj,
    write_ply,
    write_solid_vtp,
    write_stl,
)
from design.solids.read import load_mesh
from design.solids.write import read_corners
from tests.design.solids.networks import ladder

WRITERS: dict[str, Callable[[Path, Solid], None]] = {
    ".stl": write_stl,
    ".3mf": write_3mf,
    ".ply": write_ply,
    ".obj": write_obj,
}


@pytest.fixture(scope="module")
def construct() -> Solid:
    lumen = lumen_solid(ladder(), extend_ends_mm=1.0)
    return construct_solid(block_solid((16, 8, 3)), lumen, [((1.5, 1, 3), 0.6)])


@pytest.mark.parametrize("suffix", WRITERS)
def test_a_file_read_back_is_the_same_solid(construct: Solid, tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"solid{suffix}"
    WRITERS[suffix](path, construct)
    check = validate_file(path)
    check.require_valid()
    assert (check.watertight, check.oriented, check.manifold) == (True, True, True)
    assert (check.genus, check.shells) == (4, 1)
    assert check.volume == pytest.approx(construct.volume_mm3, rel=1e-7)
    assert check.crossing_faces == 0
    again = read_solid(path, "mm")
    order = np.lexsort(construct.vertices.T), np.lexsort(again.vertices.T)
    assert np.array_equal(construct.vertices[order[0]], again.vertices[order[1]])
    assert len(again.faces) == len(construct.faces)


@pytest.mark.parametrize(("unit", "factor"), [("um", 1e-3), ("cm", 10.0), ("in", 25.4)])
def test_a_file_without_unit_is_read_in_the_one_given(tmp_path, unit, factor):
    path = tmp_path / "block.stl"
    write_stl(path, block_solid((1, 2, 3)))
    assert read_solid(path, unit).bounds[1] == pytest.approx(np.array([1, 2, 3]) * factor)


def test_a_unit_is_asked_for_and_never_guessed(tmp_path: Path) -> None:
    write_stl(tmp_path / "block.stl", block_solid((1, 2, 3)))
    with pytest.raises(SolidError, match="doesn't say its unit"):
        read_solid(tmp_path / "block.stl", None)
    write_3mf(tmp_path / "block.3mf", block_solid((1, 2, 3)))
    assert read_solid(tmp_path / "block.3mf", None).volume_mm3 == pytest.approx(6.0)
    with pytest.raises(SolidError, match="says millimeter, not in"):
        read_solid(tmp_path / "block.3mf", "in")


def test_3mf_in_another_unit_is_converted(tmp_path: Path) -> None:
    write_3mf(tmp_path / "mm.3mf", block_solid((1, 2, 3)))
    path = tmp_path / "inch.3mf"
    with zipfile.ZipFile(tmp_path / "mm.3mf") as old, zipfile.ZipFile(path, "w") as new:
        for name in old.namelist():
            new.writestr(name, old.read(name).replace(b'unit="millimeter"', b'unit="inch"'))
    assert read_solid(path, None).volume_mm3 == pytest.approx(6.0 * 25.4**3)


def test_ply_carries_a_named_number_a_vertex(tmp_path: Path) -> None:
    solid = block_solid((1, 2, 3))
    values = np.arange(8) * 1.5
    write_ply(tmp_path / "block.ply", solid, values, "deviation_um")
    mesh = trimesh.load_mesh(tmp_path / "block.ply", process=False)
    data = mesh.metadata["_ply_raw"]["vertex"]["data"]
    assert np.array_equal(data["deviation_um"], values.astype(np.float32))
    assert np.array_equal(np.asarray(mesh.vertices), solid.vertices)
    with pytest.raises(SolidError, match="8 vertices"):
        write_ply(tmp_path / "block.ply", solid, np.zeros(7))
    with pytest.raises(SolidError, match="one word"):
        write_ply(tmp_path / "block.ply", solid, np.zeros(8), "two words")


def test_a_holed_file_is_called_open(tmp_path: Path) -> None:
    box = trimesh.creation.box((1, 1, 1))
    trimesh.Trimesh(box.vertices, box.faces[:-1], process=False).export(tmp_path / "open.stl")
    check = validate_file(tmp_path / "open.stl")
    assert (check.watertight, check.manifold, check.open_edges) == (False, False, 3)
    assert check.genus is None
    with pytest.raises(SolidError, match=r"open.stl.*3 open"):
        check.require_valid()
    with pytest.raises(SolidError, match=r"open.stl.*3 open edges"):
        read_solid(tmp_path / "open.stl", "mm")


def test_an_inside_out_file_is_not_valid(tmp_path: Path) -> None:
    box = trimesh.creation.box((1, 1, 1))
    trimesh.Trimesh(box.vertices, box.faces[:, ::-1], process=False).export(tmp_path / "in.stl")
    check = validate_file(tmp_path / "in.stl")
    assert (check.watertight, check.oriented) == (True, False)
    assert not check.valid


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.stl", b"", "a.stl"),
        ("a.stl", b"solid x\nendsolid x\n", "a.stl"),
        ("a.ply", b"not a ply file", "not a readable PLY"),
        ("a.3mf", b"not a zip archive", "not a readable 3MF"),
        ("a.docx", b"", r"\.docx isn't one of"),
    ],
)
def test_unreadable_files_are_refused(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(SolidError, match=message):
        validate_file(tmp_path / name)


def test_3mf_names_and_colours_its_parts(tmp_path: Path) -> None:
    path = tmp_path / "parts.3mf"
    one, two = block_solid((1, 2, 3)), block_solid((1, 1, 1), (5, 0, 0))
    parts = [Part(one, "artery <1>", "#C0392B"), Part(two, "vein", "#2980B980")]
    write_3mf(path, parts, {"Title": "tree & body", "Designer": "lab"})
    text = zipfile.ZipFile(path).read("3D/3dmodel.model").decode()
    root = ElementTree.fromstring(text)
    core = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
    meta = {entry.get("name"): entry.text for entry in root.findall(core + "metadata")}
    assert meta == {"Application": "printctl", "Title": "tree & body", "Designer": "lab"}
    objects = root.findall(f"{core}resources/{core}object")
    assert [entry.get("name") for entry in objects] == ["artery <1>", "vein"]
    bases = root.findall(f".//{core}base")
    assert [bases[int(entry.get("pindex", -1))].get("displaycolor") for entry in objects] == [
        "#C0392B",
        "#2980B980",
    ]
    assert validate_file(path).volume == pytest.approx(7.0)


def test_3mf_is_read_by_lib3mf_without_a_warning(tmp_path: Path, construct: Solid) -> None:
    lib3mf = pytest.importorskip("lib3mf")
    path = tmp_path / "solid.3mf"
    write_3mf(path, [Part(construct, "body", "#AABBCC")], {"Title": "x"})
    model = lib3mf.get_wrapper().CreateModel()
    reader = model.QueryReader("3mf")
    reader.SetStrictModeActive(True)
    reader.ReadFromFile(str(path))
    assert reader.GetWarningCount() == 0
    meshes = model.GetMeshObjects()
    assert meshes.Count() == 1
    meshes.MoveNext()
    assert meshes.GetCurrentMeshObject().IsManifoldAndOriented()


@pytest.mark.parametrize(
    ("parts", "metadata", "message"),
    [
        ([], {}, "without parts"),
        ([{"colour": "red"}], {}, "'red'"),
        ([{}], {"Owner": "me"}, "'Owner'"),
    ],
)
def test_what_3mf_cant_say_is_refused(tmp_path, parts, metadata, message):
    cube = block_solid((1, 1, 1))
    with pytest.raises(SolidError, match=message):
        write_3mf(tmp_path / "a.3mf", [Part(cube, **more) for more in parts], metadata)


def test_vtp_holds_points_and_triangles(tmp_path: Path) -> None:
    solid = block_solid((1, 2, 3))
    write_solid_vtp(tmp_path / "a.vtp", solid)
    root = ElementTree.parse(tmp_path / "a.vtp").getroot()
    arrays = root.iter("DataArray")
    found = {entry.get("Name"): base64.b64decode(entry.text or "") for entry in arrays}
    assert int.from_bytes(found["Points"][:8], "little") == 12 * 8
    points = np.frombuffer(found["Points"][8:], "<f4").reshape(-1, 3)
    assert np.array_equal(points, solid.vertices)
    corners = np.frombuffer(found["connectivity"][8:], "<i4").reshape(-1, 3)
    assert np.array_equal(corners, solid.faces)
    assert np.frombuffer(found["offsets"][8:], "<i4")[-1] == 3 * len(solid.faces)


def test_a_binary_stl_reads_alike_with_and_without_the_mesh_library(tmp_path: Path) -> None:
    path = tmp_path / "block.stl"
    write_stl(path, block_solid((3.0, 2.0, 1.0)))
    mesh = load_mesh(path)
    found = read_solid(path, "mm")
    np.testing.assert_array_equal(
        np.sort(found.vertices[found.faces].reshape(-1, 9), axis=0),
        np.sort(np.asarray(mesh.vertices)[np.asarray(mesh.faces)].reshape(-1, 9), axis=0),
    )
    path.write_bytes(path.read_bytes() + b"x")
    assert read_corners(path) is None


@pytest.mark.parametrize("for_sections", [True, False])
def test_a_damaged_stl_is_refused_by_what_is_wrong_with_it(construct, tmp_path, for_sections):
    whole = tmp_path / "part.stl"
    write_stl(whole, construct)
    data = whole.read_bytes()
    cut = tmp_path / "cut.stl"
    cut.write_bytes(data[: 84 + 50 * 7 + 11])
    with pytest.raises(SolidError, match=rf"counts {len(construct.faces)} triangles.* holds 7"):
        read_solid(cut, "mm", for_sections=for_sections)
    holed = bytearray(data)
    holed[84 + 12 : 84 + 16] = np.float32(np.nan).tobytes()
    (tmp_path / "nan.stl").write_bytes(holed)
    with pytest.raises(SolidError, match="1 corners aren't numbers"):
        read_solid(tmp_path / "nan.stl", "mm", for_sections=for_sections)


def test_3mf_reads_as_by_the_mesh_library(tmp_path: Path, construct: Solid) -> None:
    path = tmp_path / "one.3mf"
    write_3mf(path, construct)
    found = read_3mf(path)
    with path.open("rb") as file:
        mesh = trimesh.load_mesh(file, file_type="3mf", process=False)
    assert np.array_equal(found.vertices[found.faces], mesh.triangles)
    assert (found.unit, found.notes) == ("millimeter", ())


def test_two_boxes_that_share_an_edge_are_not_valid(tmp_path: Path) -> None:
    box = trimesh.creation.box((1, 1, 1))
    other = box.copy()
    other.apply_translation([1, 1, 0])
    trimesh.util.concatenate([box, other]).export(tmp_path / "edge.stl")
    check = validate_file(tmp_path / "edge.stl")
    assert (check.wrong_edges, check.valid) == (1, False)
