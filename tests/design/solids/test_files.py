"""Mesh files, judged after being read back; 3MF's roles, parts and damage."""

import base64
import re
import zipfile
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import trimesh

from design.errors import SolidError, TissueError
from design.geometry.mesh_files import read_corners
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
from design.solids.files.read import load_mesh
from design.tissue import SizeLimits, load_tissue
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


def test_inside_out_boxes_and_two_that_share_an_edge_are_not_valid(tmp_path: Path) -> None:
    box = trimesh.creation.box((1, 1, 1))
    trimesh.Trimesh(box.vertices, box.faces[:, ::-1], process=False).export(tmp_path / "in.stl")
    check = validate_file(tmp_path / "in.stl")
    assert (check.watertight, check.oriented) == (True, False)
    assert not check.valid
    other = box.copy()
    other.apply_translation([1, 1, 0])
    trimesh.util.concatenate([box, other]).export(tmp_path / "edge.stl")
    check = validate_file(tmp_path / "edge.stl")
    assert (check.wrong_edges, check.valid) == (1, False)


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


# 3MF files: roles of their volumes, parts of the package, damage.


MODEL = "3D/3dmodel.model"
CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"
Box = tuple[float, float, float, float, float, float]
BODY: Box = (0, 0, 0, 10, 8, 4)
HOLE: Box = (3, 2, 0, 7, 6, 4)
ASIDE: Box = (20, 0, 0, 30, 8, 4)


def mesh(*boxes: Box) -> str:
    """Boxes in one mesh, twelve triangles each."""
    solids = [block_solid(np.subtract(b[3:], b[:3]), b[:3]) for b in boxes]
    vertices = np.vstack([one.vertices for one in solids])
    faces = np.vstack([one.faces + 8 * k for k, one in enumerate(solids)])
    corners = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in vertices)
    rows = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in faces)
    return f"<mesh><vertices>{corners}</vertices><triangles>{rows}</triangles></mesh>"


def model(resources: str, items: str, more: str = "") -> str:
    return (
        f'<model unit="millimeter" xmlns="{CORE}" xmlns:p="{PRODUCTION}" {more}>'
        f"<resources>{resources}</resources><build>{items}</build></model>"
    )


def thing(number: int, inside: str, more: str = "") -> str:
    return f'<object id="{number}" {more}>{inside}</object>'


def package(path: Path, files: dict[str, str], start: str = MODEL) -> Path:
    rels = (
        '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
        f'<Relationship Target="/{start}" Id="rel0" '
        'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>'
    )
    with zipfile.ZipFile(path, "w") as archive:
        for name, text in {"_rels/.rels": rels, **files}.items():
            archive.writestr(name, text)
    return path


def prusa(*roles: str, old: bool = False) -> dict[str, str]:
    key = "modifier" if old else "volume_type"
    volumes = "".join(
        f'<volume firstid="{12 * k}" lastid="{12 * k + 11}"><metadata type="volume" key="name" '
        f'value="v{k}"/><metadata type="volume" key="{key}" value="{role}"/></volume>'
        for k, role in enumerate(roles)
    )
    text = f'<config><object id="1">{volumes}</object></config>'
    return {"Metadata/Slic3r_PE_model.config": text}


@pytest.mark.parametrize(
    ("role", "volume", "note"),
    [
        ("ModelPart", 320 + 320, ""),
        ("NegativeVolume", 320, "cut out of object 1: negative volume v1"),
        ("ParameterModifier", 320, "left out: modifier v1"),
        ("SupportEnforcer", 320, "left out: support enforcer v1"),
        ("SupportBlocker", 320, "left out: support blocker v1"),
    ],
)
def test_prusas_ranges_of_triangles_have_roles(tmp_path, role, volume, note):
    text = model(thing(1, mesh(BODY, ASIDE)), '<item objectid="1"/>')
    found = read_solid(package(tmp_path / "a.3mf", {MODEL: text, **prusa("ModelPart", role)}), None)
    assert found.volume_mm3 == pytest.approx(volume)
    assert found.notes == ((f"a.3mf: {note}",) if note else ())


def test_a_negative_volume_is_cut_out_of_its_own_object_alone(tmp_path: Path) -> None:
    """In whichever order, and where a second object stands in the same place."""
    for boxes, roles in (((BODY, HOLE), ("ModelPart", "NegativeVolume")),
                         ((HOLE, BODY), ("NegativeVolume", "ModelPart"))):  # fmt: skip
        text = model(
            thing(1, mesh(*boxes)) + thing(2, mesh(ASIDE)),
            '<item objectid="1"/><item objectid="2" transform="1 0 0 0 1 0 0 0 1 0 20 0"/>',
        )
        path = package(tmp_path / "a.3mf", {MODEL: text, **prusa(*roles)})
        assert read_solid(path, None).volume_mm3 == pytest.approx(320 - 64 + 320)


@pytest.mark.parametrize(
    ("subtype", "volume"),
    [
        ("normal_part", 640),
        ("negative_part", 256),
        ("modifier_part", 320),
        ("support_enforcer", 320),
        ("support_blocker", 320),
    ],
)
def test_bambus_components_in_other_parts_have_roles(tmp_path, subtype, volume):
    """Their own type is "other" where a slicer calls them negative."""
    second = ASIDE if subtype == "normal_part" else HOLE
    parts = thing(1, mesh(BODY), 'type="model"') + thing(2, mesh(second), 'type="other"')
    path = "p:path='/3D/Objects/object_1.model'"
    whole = thing(8, f'<components><component {path} objectid="1"/>'
                     f'<component {path} objectid="2"/></components>')  # fmt: skip
    said = (
        '<config><object id="8"><part id="1" subtype="normal_part"/>'
        f'<part id="2" subtype="{subtype}"><metadata key="name" value="two"/></part></object>'
        "</config>"
    )
    files = {
        MODEL: model(whole, '<item objectid="8"/>', 'requiredextensions="p"'),
        "3D/Objects/object_1.model": model(parts, ""),
        "Metadata/model_settings.config": said,
    }
    found = read_solid(package(tmp_path / "a.3mf", files), None)
    assert found.volume_mm3 == pytest.approx(volume)
    assert bool(found.notes) == (subtype != "normal_part")


@pytest.mark.parametrize("kind", ["support", "solidsupport", "surface", "other"])
def test_objects_of_other_types_are_left_out_by_name(tmp_path: Path, kind: str) -> None:
    resources = thing(1, mesh(BODY)) + thing(2, mesh(ASIDE), f'type="{kind}" name="aside"')
    text = model(resources, '<item objectid="1"/><item objectid="2"/>')
    path = package(tmp_path / "a.3mf", {MODEL: text})
    found = read_solid(path, None)
    assert found.volume_mm3 == pytest.approx(320)
    assert "left out" in found.notes[0]
    assert "aside" in found.notes[0]
    text = model(resources, '<item objectid="2"/>')
    with pytest.raises(SolidError, match=r"nothing in it is printed \(left out: .*aside"):
        read_solid(package(path, {MODEL: text}), None)


def test_what_isnt_printable_is_left_out_of_a_tissue_too(tmp_path: Path) -> None:
    resources = thing(1, mesh(BODY)) + thing(2, mesh(ASIDE), 'name="aside"')
    text = model(resources, '<item objectid="1"/><item objectid="2" printable="0"/>')
    path = package(tmp_path / "a.3mf", {MODEL: text})
    assert read_solid(path, None).bounds[1].tolist() == [10, 8, 4]
    tissue = load_tissue(path, "mm", limits=SizeLimits(1, 100))
    assert tissue.volume_mm3 == pytest.approx(320)
    assert any("aside" in note for note in tissue.notes)
    with pytest.raises(TissueError, match="declares its unit as mm, not in"):
        load_tissue(path, "in")


def test_a_model_is_found_by_the_packages_relationships_and_read_in_feet(tmp_path: Path) -> None:
    text = model(thing(1, mesh(BODY)), '<item objectid="1"/>')
    decoy = model(thing(1, mesh(ASIDE)), '<item objectid="1"/>')
    files = {"Parts/Übung 1.model": text, MODEL: decoy}
    path = package(tmp_path / "a.3mf", files, "Parts/%C3%9Cbung%201.model")
    assert read_solid(path, None).bounds[1].tolist() == [10, 8, 4]
    text = model(thing(1, mesh((0, 0, 0, 0.01, 0.02, 0.03))), '<item objectid="1"/>')
    path = package(tmp_path / "b.3mf", {MODEL: text.replace("millimeter", "foot")})
    assert read_solid(path, None).bounds[1] == pytest.approx((3.048, 6.096, 9.144))


def test_transforms_of_items_and_components_follow_each_other(tmp_path: Path) -> None:
    """The inner one first; a mirrored part keeps its faces outward."""
    inner = '<component objectid="1" transform="-1 0 0 0 1 0 0 0 1 0 0 0"/>'
    text = model(
        thing(1, mesh(BODY)) + thing(2, f"<components>{inner}</components>"),
        '<item objectid="2" transform="0 1 0 -1 0 0 0 0 2 100 0 0"/>',
    )
    found = read_solid(package(tmp_path / "a.3mf", {MODEL: text}), None)
    assert found.bounds.tolist() == [[92, -10, 0], [100, 0, 8]]
    assert found.volume_mm3 == pytest.approx(640)


@pytest.mark.parametrize("third", ["0 0 0", "1 1 0"])
def test_a_transform_that_makes_a_part_flat_is_called_flat(tmp_path: Path, third: str) -> None:
    items = f'<item objectid="1"/><item objectid="1" transform="1 0 0 0 1 0 {third} 3 0 0"/>'
    text = model(thing(1, mesh(BODY)), items)
    with pytest.raises(SolidError, match=r"makes it flat \(determinant 0"):
        read_solid(package(tmp_path / "a.3mf", {MODEL: text}), None)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (r"(x=\S+) (y=[^ ]+)", r"\2 \1"),
        ("<vertices>", "<vertices><!-- corners -->"),
        ('"/><vertex', '" /> <vertex'),
        ('v1="', 'pid="1" v1="'),
        (r'(v3="\d+")/>', r'\1 p1="0" p:paint="4C" />'),
    ],
)
def test_numbers_are_read_however_they_are_written(tmp_path: Path, old: str, new: str) -> None:
    text, count = re.subn(old, new, model(thing(1, mesh(BODY)), '<item objectid="1"/>'))
    assert count
    found = read_solid(package(tmp_path / "a.3mf", {MODEL: text}), None)
    assert found.volume_mm3 == pytest.approx(320)


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ('v2="5"', 'v2="-1"', "corner that isn't there"),
        ('v2="5"', 'v2="0.5"', "corner that isn't there"),
        ('v2="5"', f'v2="{2**32 + 5}"', "corner that isn't there"),
        ('v2="5"', 'v2="99999999999999999999"', "corner that isn't there"),
        ("</model>", "", "not a readable 3MF file"),
        ('unit="millimeter"', 'unit="yard"', "the file's unit is yard"),
        ('type="model"', 'type="ghost"', "is a ghost"),
        ('objectid="2"', 'objectid="7"', "names object 7"),
        ("<mesh>", "<beamset/><mesh><beamlattice/>", "beamlattice, which isn't read"),
        (' xml:lang="en-US"', ' xmlns:s="urn:slice" requiredextensions="s"', "urn:slice"),
        ("<build>", "<!-- ", "not a readable 3MF file"),
        ("<model", '<!DOCTYPE m [<!ENTITY a "1">]><model', "declares a document type"),
        ("/3D/3dmodel", "/3D/other", "holds no 3D/other.model"),
    ],
)
def test_what_isnt_read_is_refused_with_the_reason(tmp_path, old, new, why):
    path = tmp_path / "one.3mf"
    write_3mf(path, block_solid((1, 1, 1)))
    with zipfile.ZipFile(path) as archive:
        files = {name: archive.read(name).decode() for name in archive.namelist()}
    where = next(name for name, text in files.items() if old in text)
    files[where] = files[where].replace(old, new, 1)
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    with pytest.raises(SolidError, match=why):
        read_solid(path, None)


def test_components_that_hold_themselves_are_refused(tmp_path: Path) -> None:
    inside = '<components><component objectid="1"/></components>'
    text = model(thing(1, inside), '<item objectid="1"/>')
    with pytest.raises(SolidError, match="made of itself"):
        read_solid(package(tmp_path / "a.3mf", {MODEL: text}), None)


def test_an_old_modifier_and_curas_support_mesh_are_left_out(tmp_path: Path) -> None:
    text = model(thing(1, mesh(BODY, HOLE)), '<item objectid="1"/>')
    path = package(tmp_path / "a.3mf", {MODEL: text, **prusa("0", "1", old=True)})
    assert read_solid(path, None).volume_mm3 == pytest.approx(320)
    said = '<metadatagroup><metadata name="cura:support_mesh">True</metadata></metadatagroup>'
    both = thing(1, mesh(BODY)) + thing(2, said + mesh(ASIDE))
    text = model(both, '<item objectid="1"/><item objectid="2"/>')
    path = package(tmp_path / "b.3mf", {MODEL: text})
    assert read_solid(path, None).volume_mm3 == pytest.approx(320)
