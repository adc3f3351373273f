"""Read what a 3MF file has printed, by lxml: roles, relationships, components, unit.

3MF Core Specification 1.3 and Production Extension 1.1 (3MF Consortium). What a part is for stands
in the type of its object, or in what slicers add: PrusaSlicer and SuperSlicer give ranges of
triangles a role (Metadata/Slic3r_PE_model.config), Bambu Studio and OrcaSlicer components
(Metadata/model_settings.config), Cura objects (their metadata). Negative volumes are cut out of
their own object; whatever isn't ink is left out, and named. trimesh's reader knows none of these,
and takes 1 kB a triangle.
"""

from __future__ import annotations

import re
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any, Final
from urllib.parse import unquote

import numpy as np
from lxml import etree  # type: ignore[import-untyped]
from manifold3d import Error, Manifold, Mesh64, OpType

from design.errors import SolidError
from design.geometry.surface import MeshFile
from kernels.arrays import FloatArray, IntArray

_CONFIG: Final = re.compile(r"Metadata/.*model(_settings)?\.config", re.IGNORECASE)
_EXTENSIONS: Final = re.compile("/(core|production|material)/")
"""Namespaces of extensions that a file may require: materials change no shape."""
_SHAPES: Final = {"beamlattice", "booleanshape", "displacementmesh", "levelset"}
_MAX_DEPTH: Final = 20
_FLAT: Final = 1e-9
"""Determinant of a transform over the product of its rows' lengths."""
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
_LISTS: Final = {"vertices": ("vertex", "x", "y", "z"), "triangles": ("triangle", "v1", "v2", "v3")}
"""Lists of a mesh: their elements, and the attributes that hold numbers."""
_UNREADABLE: Final = (
    zipfile.BadZipFile, zlib.error, etree.XMLSyntaxError, EOFError, NotImplementedError,
    RuntimeError, LookupError, TypeError, ValueError, OverflowError,
)  # fmt: skip


@dataclass(frozen=True)
class _Volume:
    vertices: FloatArray
    faces: IntArray
    role: str
    name: str


def read_3mf(path: Path) -> MeshFile:
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
            return _Reader(archive).read()
    except SolidError as exc:
        raise exc.around(f"{path}: ") from exc
    except _UNREADABLE as exc:
        raise SolidError(
            f"{path}: not a readable 3MF file ({type(exc).__name__}: {exc}); export it again"
        ) from exc


class _Reader:
    def __init__(self, archive: zipfile.ZipFile) -> None:
        self.archive = archive
        self.names = {name.lower(): name for name in archive.namelist()}
        self.roots: dict[str, Any] = {}
        self.lists: list[FloatArray] = []
        self.notes: list[str] = []
        # Role and name, as slicers give them: of ranges of an object's triangles, of components.
        self.ranges: dict[str, list[tuple[int, int, str, str]]] = {}
        self.components: dict[tuple[str, str], tuple[str, str]] = {}

    def read(self) -> MeshFile:
        start = self._start()
        root = self._root(start)
        for prefix in root.get("requiredextensions", "").split():
            name = root.nsmap.get(prefix, prefix)
            if not _EXTENSIONS.search(name):
                raise SolidError(
                    f"it requires the extension {name}, which isn't read; export it as plain "
                    "triangles"
                )
        self._read_slicer_roles()
        items = root.findall("{*}build/{*}item")
        volumes = [volume for item in items for volume in self._printed(item, start)]
        notes = tuple(dict.fromkeys(self.notes))
        if not volumes:
            why = f" ({'; '.join(notes)})" if notes else ": its build names no object"
            raise SolidError(f"nothing in it is printed{why}; export the part's solid")
        before = np.cumsum([0, *(len(one.vertices) for one in volumes)])
        faces = [one.faces + by for one, by in zip(volumes, before[:-1], strict=True)]
        vertices = np.concatenate([one.vertices for one in volumes])
        return MeshFile(vertices, np.concatenate(faces), root.get("unit", "millimeter"), notes)

    def _root(self, part: str) -> Any:
        """Return the XML of a part, long lists in `lists`: a tree takes 1 kB an element."""
        key = unquote(part).lstrip("/").lower()
        if key not in self.names:
            raise SolidError(f"holds no {part.lstrip('/')}, which it names; export it again")
        if key not in self.roots:
            text = self.archive.read(self.names[key])
            if b"<!DOCTYPE" in text:
                raise SolidError(f"{part} declares a document type, which 3MF forbids")
            for name in _LISTS:
                first, *others = text.split(f"<{name}>".encode())
                text = b"".join([first, *(self._without_list(name, one) for one in others)])
            parser = etree.XMLParser(resolve_entities=False, no_network=True)
            self.roots[key] = etree.fromstring(text, parser)
        return self.roots[key]

    def _without_list(self, name: str, text: bytes) -> bytes:
        """Take the numbers out of text behind ``<name>``, where every element has all three."""
        within, _, behind = text.partition(f"</{name}>".encode())
        element, *keys = _LISTS[name]
        columns = np.empty((within.count(f"<{element} ".encode()), 3))
        for column, key in zip(columns.T, keys, strict=True):
            numbers = re.findall(rb'\s%b="([^"]*)"' % key.encode(), within)
            if len(numbers) != len(column) or b"<!--" in within:
                return f"<{name}>".encode() + text
            column[:] = np.array(numbers, "S").astype(np.float64)
        self.lists.append(columns)
        return f'<{name} list="{len(self.lists) - 1}"/>'.encode() + behind

    def _numbers(self, mesh: Any, name: str) -> FloatArray:
        """Return the three numbers of each element of a list, (n, 3)."""
        element = mesh.find(f"{{*}}{name}")
        if element is not None and "list" in element.attrib:
            return self.lists[int(element.get("list"))]
        rows = mesh.iterfind(f"{{*}}{name}/{{*}}{_LISTS[name][0]}")
        values = [[float(row.get(key)) for key in _LISTS[name][1:]] for row in rows]
        return np.array(values).reshape(-1, 3)

    def _start(self) -> str:
        """Return the part that the package's relationships call its model."""
        if "_rels/.rels" in self.names:
            for one in self._root("_rels/.rels").findall("{*}Relationship"):
                if one.get("Type", "").endswith("/3dmodel"):
                    return str(one.get("Target"))
        models = [name for name in self.names if name.endswith(".model")]
        if "3d/3dmodel.model" in models or len(models) == 1:
            return "3d/3dmodel.model" if len(models) > 1 else models[0]
        raise SolidError(
            f"of its {len(models)} models none is named by _rels/.rels as the one to print; "
            "export it again"
        )

    def _read_slicer_roles(self) -> None:
        for name in filter(_CONFIG.fullmatch, self.archive.namelist()):
            for thing in self._root(name).iter("object"):
                key = thing.get("id")
                for one in thing.iter("volume"):
                    ends = int(one.get("firstid")), int(one.get("lastid"))
                    self.ranges.setdefault(key, []).append((*ends, *_slicer_role(one)))
                for one in thing.iter("part"):
                    self.components[key, one.get("id")] = _slicer_role(one)

    def _printed(self, item: Any, start: str) -> list[_Volume]:
        """Return an item of the build, its negative volumes cut out."""
        part, key = _path(item, start), item.get("objectid")
        name = self._object(part, key).get("name") or f"object {key}"
        if item.get("printable") in ("0", "false"):
            self.notes.append(f"left out: {name}, which isn't to be printed (printable)")
            return []
        volumes = [_moved(one, item) for one in self._volumes(part, key, _INK, "", 0)]
        ink = [one for one in volumes if one.role == _INK]
        negative = [one for one in volumes if one.role == _NEGATIVE and ink]
        for one in volumes:
            if one.role != _INK:
                verb = f"cut out of {name}" if ink and one.role == _NEGATIVE else "left out"
                self.notes.append(f"{verb}: {one.role} {one.name}")
        return [_difference(ink, negative, name)] if negative else ink

    def _object(self, part: str, key: str) -> Any:
        for thing in self._root(part).iterfind("{*}resources/{*}object"):
            if thing.get("id") == key:
                return thing
        raise SolidError(f"it names object {key} of {part}, which isn't there; export it again")

    def _volumes(self, part: str, key: str, role: str, name: str, depth: int) -> Iterator[_Volume]:
        """Yield an object's volumes; ``role`` and ``name`` as a component gives them, or ""."""
        thing = self._object(part, key)
        name = name or thing.get("name") or f"object {key}"
        own = _role(_cura(thing) or thing.get("type", "model"), name)
        role = own if role == _INK else role
        if depth > _MAX_DEPTH:
            raise SolidError(f"{name} is made of itself; export it again")
        for one in thing.iterfind("{*}components/{*}component"):
            to, child = _path(one, part), one.get("objectid")
            given = self.components.get((key, child))
            # A slicer's role of a component counts, not its type: a negative part's is other.
            for volume in self._volumes(to, child, role, given[1] if given else "", depth + 1):
                as_given = replace(volume, role=_role(*given)) if given and role == _INK else volume
                yield _moved(as_given, one)
        mesh = thing.find("{*}mesh")
        inside = thing.iterfind("{*}*"), () if mesh is None else mesh.iterfind("{*}*")
        strange = [n for one in chain(*inside) if (n := _local(one.tag)) in _SHAPES]
        if "lowres" in thing.attrib.values():  # of the slice extension: the mesh is a stand-in
            strange.append("stack of slices")
        if strange and role == _INK:
            raise SolidError(
                f"{name} has a {strange[0]}, which isn't read; export it as plain triangles"
            )
        if mesh is not None:
            yield from self._by_ranges(key, self._mesh(mesh, role, name))

    def _mesh(self, mesh: Any, role: str, name: str) -> _Volume:
        vertices, numbers = self._numbers(mesh, "vertices"), self._numbers(mesh, "triangles")
        sound = (numbers == np.floor(numbers)) & (numbers >= 0) & (numbers < len(vertices))
        if not np.all(sound):
            raise SolidError(
                f"a triangle of {name} names a corner that isn't there (of {len(vertices)}); "
                "export it again"
            )
        return _Volume(vertices, numbers.astype(np.int64), role, name)

    def _by_ranges(self, key: str, whole: _Volume) -> Iterator[_Volume]:
        """Yield an object's mesh by the ranges of triangles to which a slicer gives a role."""
        rest = np.ones(len(whole.faces), np.bool_)
        ranges = self.ranges.get(key, ()) if whole.role == _INK else ()
        if all(_role(role, name) == _INK for *_, role, name in ranges):
            ranges = ()
        for first, last, role, name in ranges:
            if not 0 <= first <= last < len(rest):
                raise SolidError(
                    f"volume {name} of {whole.name} has triangles {first} to {last}, of "
                    f"{len(rest)}; export it again"
                )
            rest[first : last + 1] = False
            faces = whole.faces[first : last + 1]
            yield replace(whole, faces=faces, role=_role(role, name), name=name or whole.name)
        if rest.any():
            yield replace(whole, faces=whole.faces[rest])


def _local(tag: str) -> str:
    return tag.rpartition("}")[2]


def _slicer_role(volume: Any) -> tuple[str, str]:
    """Return a volume's role and name; older slicers know parts and modifiers."""
    given = {one.get("key"): one.get("value", "") for one in volume.iterchildren("metadata")}
    old = "modifierpart" if given.get("modifier") == "1" else "modelpart"
    return given.get("volume_type") or volume.get("subtype") or old, given.get("name", "")


def _role(given: str, name: str) -> str:
    role = _ROLES.get(given.replace("_", "").lower())
    if role is None:
        raise SolidError(f"{name} is a {given}, and what that is isn't known; export it without")
    return role


def _cura(thing: Any) -> str:
    """Return the role that Cura gives an object among its metadata; else empty."""
    for one in thing.iterfind("{*}metadatagroup/{*}metadata"):
        name = one.get("name", "").rpartition(":")[2]
        if name.replace("_", "") in _ROLES and (one.text or "").strip().lower() == "true":
            return str(name)
    return ""


def _path(element: Any, part: str) -> str:
    """Return the part in which an item's or component's object stands."""
    return next((value for key, value in element.attrib.items() if _local(key) == "path"), part)


def _moved(volume: _Volume, by: Any) -> _Volume:
    if by.get("transform") is None:
        return volume
    matrix = np.array(by.get("transform").split(), np.float64).reshape(4, 3)
    volume_factor = np.linalg.det(matrix[:3])
    if not abs(volume_factor) > _FLAT * np.linalg.norm(matrix[:3], axis=1).prod():
        raise SolidError(
            f"the transform {by.get('transform')!r} of {volume.name} makes it flat (determinant "
            f"{volume_factor:.3g}, needed: not 0); export it again with its full size"
        )
    faces = volume.faces[:, ::-1] if volume_factor < 0 else volume.faces
    return replace(volume, vertices=volume.vertices @ matrix[:3] + matrix[3], faces=faces)


def _difference(ink: list[_Volume], negative: list[_Volume], name: str) -> _Volume:
    body = Manifold.batch_boolean([_manifold(one) for one in ink], OpType.Add)
    left = Manifold.batch_boolean([body, *map(_manifold, negative)], OpType.Subtract)
    if left.is_empty():
        raise SolidError(f"nothing is left of {name} without its negative volumes")
    mesh = left.to_mesh64()
    vertices, faces = np.array(mesh.vert_properties)[:, :3], np.array(mesh.tri_verts)
    return _Volume(vertices, faces.astype(np.int64), _INK, name)


def _manifold(volume: _Volume) -> Manifold:
    mesh = Mesh64(np.ascontiguousarray(volume.vertices), volume.faces.astype(np.uint64, order="C"))
    mesh.merge()
    manifold = Manifold(mesh)
    if manifold.status() != Error.NoError:
        raise SolidError(
            f"{volume.role} {volume.name} isn't a closed, oriented surface "
            f"({manifold.status().name}), so negative volumes can't be cut; mend it"
        )
    return manifold
