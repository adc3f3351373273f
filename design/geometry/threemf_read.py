"""Read what a 3MF file has printed: roles, relationships, components, unit.

3MF Core Specification 1.3 and Production Extension 1.1 (3MF Consortium). What a part is for stands
in the type of its object, or in what slicers add: PrusaSlicer and SuperSlicer give ranges of
triangles a role (Metadata/Slic3r_PE_model.config), Bambu Studio and OrcaSlicer components
(Metadata/model_settings.config), Cura objects (their metadata). Negative volumes are cut out of
their own object; whatever isn't ink is left out, and named.
"""

from __future__ import annotations

import re
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final
from urllib.parse import unquote

import numpy as np
from lxml import etree  # type: ignore[import-untyped]
from manifold3d import Error, Manifold, Mesh64, OpType
from numpy.typing import NDArray

from design.errors import SolidError
from design.geometry.decimal_text import Marks, read_rows

VERTEX: Final = (b'<vertex x="', b'" y="', b'" z="', b'"/>\n')
TRIANGLE: Final = (b'<triangle v1="', b'" v2="', b'" v3="', b'"/>\n')
"""What stands around the numbers of each element."""

_MODEL: Final = "3D/3dmodel.model"
_MORE: Final = re.compile(rb'((?: v3| z)="[^"]*")[^/>]+/>')
"""What follows a triangle's corners (colours, paint) or a vertex: nothing that is read."""
_CONFIG: Final = re.compile(r"Metadata/.*model(_settings)?\.config", re.IGNORECASE)
_EXTENSIONS: Final = ("/core/", "/production/", "/material/")
"""Namespaces of extensions that a file may require: materials change no shape."""
_SHAPES: Final = ("beamlattice", "booleanshape", "displacementmesh", "levelset")
_MAX_DEPTH: Final = 20
_INK: Final = "part"
_NEGATIVE: Final = "negative volume"
_ROLES: Final = {
    "model": _INK, "modelpart": _INK, "normalpart": _INK,
    "negativevolume": _NEGATIVE, "negativepart": _NEGATIVE,
    "parametermodifier": "modifier", "modifierpart": "modifier",
    "infillmesh": "modifier", "cuttingmesh": "modifier",
    "supportenforcer": "support enforcer", "supportblocker": "support blocker",
    "antioverhangmesh": "support blocker",
    "supportmesh": "support", "support": "support", "solidsupport": "support",
    "surface": "surface", "other": "object of type other",
}  # fmt: skip
"""Names of the specification and of slicers, without underscores, in small letters."""

Mesh = tuple[NDArray[np.float64], NDArray[np.int64]]
Role = tuple[str, str]
"""What a volume is for, and its name."""


@dataclass(frozen=True)
class ThreeMF:
    """Triangles of a 3MF file that are printed.

    Attributes
    ----------
    vertices : (n, 3) float64, in `unit`
    faces : (m, 3) int64
    unit : str
        As 3MF spells it.
    notes : tuple of str
        What was left out or cut out.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    unit: str
    notes: tuple[str, ...]


@dataclass(frozen=True)
class _Volume:
    mesh: Mesh
    role: str
    name: str


@dataclass
class _Package:
    archive: zipfile.ZipFile
    names: dict[str, str] = field(default_factory=dict)
    roots: dict[str, Any] = field(default_factory=dict)
    lists: list[NDArray[np.float64]] = field(default_factory=list)

    def root(self, part: str) -> Any:
        """XML of a part, its lists of numbers taken out (`lists`): lxml is slow on them."""
        if not self.names:
            self.names = {name.lower(): name for name in self.archive.namelist()}
        key = unquote(part).lstrip("/").lower()
        if key not in self.names:
            raise SolidError(f"holds no {part.lstrip('/')}, which it names; export it again")
        if key not in self.roots:
            text = self.archive.read(self.names[key])
            if b"<!DOCTYPE" in text:
                raise SolidError(f"{part} declares a document type, which 3MF forbids")
            for name, marks in ((b"vertices", VERTEX), (b"triangles", TRIANGLE)):
                text = self._without_lists(text, name, marks)
            parser = etree.XMLParser(resolve_entities=False, no_network=True)
            self.roots[key] = etree.fromstring(text, parser)
        return self.roots[key]

    def _without_lists(self, text: bytes, name: bytes, marks: Marks) -> bytes:
        begin, end = b"<%b>" % name, b"</%b>" % name
        first, *others = text.split(begin)
        pieces = [first]
        for other in others:
            within, closed, behind = other.partition(end)
            rows = read_rows(within, marks) if closed else None
            if rows is None and closed:
                rows = read_rows(_MORE.sub(rb"\1/>", within), marks)
            if rows is None:
                pieces += [begin, other]
                continue
            pieces += [b'<%b list="%d"/>' % (name, len(self.lists)), behind]
            self.lists.append(rows)
        return b"".join(pieces)

    def numbers(self, mesh: Any, of: str, keys: tuple[str, str, str]) -> NDArray[np.float64]:
        """Three numbers of each element of a list, (n, 3)."""
        element = mesh.find(f"{{*}}{of}")
        if element is None:
            return np.empty((0, 3))
        if "list" in element.attrib:
            return self.lists[int(element.get("list"))]
        rows = [[float(one.get(key)) for key in keys] for one in element if _is_element(one)]
        return np.array(rows).reshape(-1, 3)


def read_3mf(path: Path) -> ThreeMF:
    """Read the parts that are printed, each where the build puts it.

    Raises
    ------
    SolidError
        When the file is damaged, holds what isn't read, or nothing that is printed.
    OSError
        When the file can't be opened.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            return _read(_Package(archive))
    except SolidError as exc:
        raise exc.around(f"{path}: ") from exc
    except (
        zipfile.BadZipFile, zlib.error, etree.XMLSyntaxError, EOFError, NotImplementedError,
        RuntimeError, KeyError, TypeError, ValueError, OverflowError,
    ) as exc:  # fmt: skip
        raise SolidError(
            f"{path}: not a readable 3MF file ({type(exc).__name__}: {exc}); export it again"
        ) from exc


def _read(package: _Package) -> ThreeMF:
    start = _start(package)
    root = package.root(start)
    _check_extensions(root)
    reader = _Reader(package, _slicer_roles(package))
    meshes: list[Mesh] = []
    for item in root.findall("{*}build/{*}item"):
        meshes += reader.printed(item, start)
    notes = tuple(dict.fromkeys(reader.notes))
    if not meshes:
        why = f" ({'; '.join(notes)})" if notes else ": its build names no object"
        raise SolidError(f"nothing in it is printed{why}; export the part's solid")
    offsets = np.cumsum([0, *(len(vertices) for vertices, _ in meshes[:-1])])
    return ThreeMF(
        np.concatenate([vertices for vertices, _ in meshes]),
        np.concatenate([faces + by for (_, faces), by in zip(meshes, offsets, strict=True)]),
        root.get("unit", "millimeter"),
        notes,
    )


def _start(package: _Package) -> str:
    """The part that the package's relationships call its model."""
    names = package.archive.namelist()
    if "_rels/.rels" in names:
        for one in package.root("_rels/.rels").findall("{*}Relationship"):
            if one.get("Type", "").endswith("/3dmodel"):
                return str(one.get("Target"))
    models = [name for name in names if name.lower().endswith(".model")]
    if _MODEL in models or len(models) == 1:
        return _MODEL if _MODEL in models else models[0]
    raise SolidError(
        f"of its {len(models)} models none is named by _rels/.rels as the one to print; export it "
        "again"
    )


def _check_extensions(root: Any) -> None:
    for prefix in root.get("requiredextensions", "").split():
        name = root.nsmap.get(prefix, prefix)
        if not any(known in name for known in _EXTENSIONS):
            raise SolidError(f"it requires the extension {name}, which isn't read; export it "
                               "as plain triangles")  # fmt: skip


@dataclass(frozen=True)
class _Roles:
    """What slicers say: of ranges of an object's triangles, and of an object's components."""

    ranges: dict[str, list[tuple[int, int, Role]]]
    components: dict[tuple[str, str], Role]


def _slicer_roles(package: _Package) -> _Roles:
    roles = _Roles({}, {})
    for name in filter(_CONFIG.fullmatch, package.archive.namelist()):
        for thing in package.root(name).iter("object"):
            key = thing.get("id")
            for volume in thing.iter("volume"):
                ends = int(volume.get("firstid")), int(volume.get("lastid"))
                roles.ranges.setdefault(key, []).append((*ends, _said(volume)))
            for part in thing.iter("part"):
                roles.components[key, part.get("id")] = _said(part)
    return roles


def _said(volume: Any) -> Role:
    """Role and name of a volume, as a slicer says them; older ones know parts and modifiers."""
    said = {one.get("key"): one.get("value", "") for one in volume.iterchildren("metadata")}
    old = "modifierpart" if said.get("modifier") == "1" else "modelpart"
    return said.get("volume_type") or volume.get("subtype") or old, said.get("name", "")


@dataclass
class _Reader:
    package: _Package
    roles: _Roles
    notes: list[str] = field(default_factory=list)

    def printed(self, item: Any, start: str) -> list[Mesh]:
        """Meshes of an item of the build, its negative volumes cut out."""
        part, key = _path(item, start), item.get("objectid")
        name = self._object(part, key).get("name") or f"object {key}"
        if item.get("printable") in ("0", "false"):
            self.notes.append(f"left out: {name}, which isn't to be printed (printable)")
            return []
        volumes = list(self._volumes(part, key, _INK, "", 0))
        ink, negative = [], []
        for volume in (_moved(one, item.get("transform")) for one in volumes):
            if volume.role == _INK:
                ink.append(volume)
            elif volume.role == _NEGATIVE:
                negative.append(volume)
            else:
                self.notes.append(f"left out: {volume.role} {volume.name}")
        if not (ink and negative):
            self.notes += [f"left out: {one.role} {one.name}" for one in negative]
            return [one.mesh for one in ink]
        self.notes += [f"cut out of {name}: {one.role} {one.name}" for one in negative]
        body = Manifold.batch_boolean([_manifold(one) for one in ink], OpType.Add)
        left = Manifold.batch_boolean([body, *map(_manifold, negative)], OpType.Subtract)
        if left.is_empty():
            raise SolidError(f"nothing is left of {name} without its negative volumes")
        mesh = left.to_mesh64()
        return [(np.array(mesh.vert_properties)[:, :3], np.array(mesh.tri_verts).astype(np.int64))]

    def _object(self, part: str, key: str) -> Any:
        for thing in self.package.root(part).iterfind("{*}resources/{*}object"):
            if thing.get("id") == key:
                return thing
        raise SolidError(f"it names object {key} of {part}, which isn't there; export it again")

    def _volumes(self, part: str, key: str, role: str, name: str, depth: int) -> Iterator[_Volume]:
        """All volumes of an object; ``role`` and ``name`` as what refers to it says, or empty."""
        thing = self._object(part, key)
        name = name or thing.get("name") or f"object {key}"
        own = _role(_cura(thing) or thing.get("type", "model"), name)
        role = own if role == _INK else role
        if depth > _MAX_DEPTH:
            raise SolidError(f"{name} is made of itself; export it again")
        for one in thing.iterfind("{*}components/{*}component"):
            to, child = _path(one, part), one.get("objectid")
            said = self.roles.components.get((key, child))
            # What a slicer says of a component counts, not its type: a negative part's is other.
            for volume in self._volumes(to, child, role, said[1] if said else "", depth + 1):
                as_said = replace(volume, role=_role(*said)) if said and role == _INK else volume
                yield _moved(as_said, one.get("transform"))
        mesh = thing.find("{*}mesh")
        odd = [one for one in (*thing, *(() if mesh is None else mesh)) if _is_element(one)]
        strange = [n for one in odd if (n := etree.QName(one).localname) in _SHAPES]
        if "lowres" in thing.attrib.values():  # of the slice extension: the mesh is a stand-in
            strange.append("stack of slices")
        if strange and role == _INK:
            raise SolidError(
                f"{name} has a {strange[0]}, which isn't read; export it as plain triangles"
            )
        if mesh is not None:
            yield from self._parts(key, self._mesh(mesh, name), role, name)

    def _mesh(self, mesh: Any, name: str) -> Mesh:
        vertices = self.package.numbers(mesh, "vertices", ("x", "y", "z"))
        numbers = self.package.numbers(mesh, "triangles", ("v1", "v2", "v3"))
        sound = (numbers == np.floor(numbers)) & (numbers >= 0) & (numbers < len(vertices))
        if not np.all(sound):
            raise SolidError(
                f"a triangle of {name} names a corner that isn't there (of {len(vertices)}); "
                "export it again"
            )
        return vertices, numbers.astype(np.int64)

    def _parts(self, key: str, mesh: Mesh, role: str, name: str) -> Iterator[_Volume]:
        """An object's mesh, by the ranges of triangles to which a slicer gives a role."""
        ranges = self.roles.ranges.get(key, ()) if role == _INK else ()
        if all(_role(*said) == _INK for *_, said in ranges):
            yield _Volume(mesh, role, name)
            return
        vertices, faces = mesh
        rest = np.ones(len(faces), np.bool_)
        for first, last, said in ranges:
            if not 0 <= first <= last < len(faces):
                raise SolidError(
                    f"volume {said[1]} of {name} has triangles {first} to {last}, of {len(faces)}; "
                    "export it again"
                )
            rest[first : last + 1] = False
            yield _Volume((vertices, faces[first : last + 1]), _role(*said), said[1] or name)
        if rest.any():
            yield _Volume((vertices, faces[rest]), _INK, name)


def _role(said: str, name: str) -> str:
    role = _ROLES.get(said.replace("_", "").lower())
    if role is None:
        raise SolidError(f"{name} is a {said}, and what that is isn't known; export it without")
    return role


def _cura(thing: Any) -> str:
    """The role that Cura gives an object among its metadata; else empty."""
    for one in thing.iterfind("{*}metadatagroup/{*}metadata"):
        name = one.get("name", "").rpartition(":")[2]
        if name.replace("_", "") in _ROLES and (one.text or "").strip().lower() == "true":
            return str(name)
    return ""


def _path(element: Any, part: str) -> str:
    """The part in which an item's or component's object stands."""
    paths = [value for key, value in element.attrib.items() if etree.QName(key).localname == "path"]
    return paths[0] if paths else part


def _moved(volume: _Volume, transform: str | None) -> _Volume:
    if transform is None:
        return volume
    matrix = np.array(transform.split(), np.float64).reshape(4, 3)
    vertices, faces = volume.mesh
    mirrored = np.linalg.det(matrix[:3]) < 0
    moved = vertices @ matrix[:3] + matrix[3]
    return replace(volume, mesh=(moved, faces[:, ::-1] if mirrored else faces))


def _manifold(volume: _Volume) -> Manifold:
    vertices, faces = volume.mesh
    mesh = Mesh64(np.ascontiguousarray(vertices), np.ascontiguousarray(faces, np.uint64))
    mesh.merge()
    manifold = Manifold(mesh)
    if manifold.status() != Error.NoError:
        raise SolidError(
            f"{volume.role} {volume.name} isn't a closed, oriented surface "
            f"({manifold.status().name}), so negative volumes can't be cut; mend it"
        )
    return manifold


def _is_element(one: Any) -> bool:
    """Whether it isn't a comment."""
    return isinstance(one.tag, str)
