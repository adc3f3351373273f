"""3MF files: roles of their volumes, parts of the package, damage."""

from __future__ import annotations

import re
import zipfile
from pathlib import Path

import numpy as np
import pytest

from design.errors import SolidError, TissueError
from design.solids import block_solid, read_solid, write_3mf
from design.tissue import SizeLimits, load_tissue

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


def test_a_model_is_found_by_the_packages_relationships(tmp_path: Path) -> None:
    text = model(thing(1, mesh(BODY)), '<item objectid="1"/>')
    decoy = model(thing(1, mesh(ASIDE)), '<item objectid="1"/>')
    files = {"Parts/Übung 1.model": text, MODEL: decoy}
    path = package(tmp_path / "a.3mf", files, "Parts/%C3%9Cbung%201.model")
    assert read_solid(path, None).bounds[1].tolist() == [10, 8, 4]


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


def test_an_old_modifier_is_left_out(tmp_path: Path) -> None:
    text = model(thing(1, mesh(BODY, HOLE)), '<item objectid="1"/>')
    path = package(tmp_path / "a.3mf", {MODEL: text, **prusa("0", "1", old=True)})
    assert read_solid(path, None).volume_mm3 == pytest.approx(320)


def test_curas_support_mesh_is_left_out(tmp_path: Path) -> None:
    said = '<metadatagroup><metadata name="cura:support_mesh">True</metadata></metadatagroup>'
    text = model(thing(1, mesh(BODY)) + thing(2, said + mesh(ASIDE)),
                 '<item objectid="1"/><item objectid="2"/>')  # fmt: skip
    path = package(tmp_path / "a.3mf", {MODEL: text})
    assert read_solid(path, None).volume_mm3 == pytest.approx(320)


def test_a_model_in_feet_is_read(tmp_path: Path) -> None:
    text = model(thing(1, mesh((0, 0, 0, 0.01, 0.02, 0.03))), '<item objectid="1"/>')
    path = package(tmp_path / "a.3mf", {MODEL: text.replace("millimeter", "foot")})
    assert read_solid(path, None).bounds[1] == pytest.approx((3.048, 6.096, 9.144))
