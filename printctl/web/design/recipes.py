"""Recipes of the workspace: their text, checks and files."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count
from pathlib import Path, PurePath
from typing import Any, Final

import numpy as np
from pydantic import ValidationError

from design.errors import SolidError
from design.files import write_bytes, write_text
from design.geometry.surface import START_BYTES, TRIANGLE
from firmware_profiles import ProfileError, load
from firmware_profiles.load import FOLDERS
from printctl.pipeline.run_options import TOOLPATH_NAMES
from printctl.pipeline.running.lock import is_run_active
from printctl.recipe import Recipe
from printctl.recipe.load import STARTER, sentence
from printctl.recipe.schema import KeyPath, Schema, fields_of, user_path
from printctl.recipe.sections.anatomy import INLETS
from printctl.run_folder.manifest import digest_bytes
from printctl.web.design.recipe_text import differences, read_text, with_values
from printctl.web.design.run_views import tissue_page
from printctl.web.errors import BadRequestError, ChangedError, ConflictError, NotFoundError
from printctl.web.profile_store import ProfileStore
from printctl.web.workspace import Workspace, checked_name, is_name, usable_name

PROFILES: Final = {folder: model for model, folder in FOLDERS.items()}
"""Models of profiles, by their sort."""


@dataclass(frozen=True)
class RecipeProblem:
    """Error in a recipe, with the keys to its field; none for the whole."""

    path: KeyPath
    message: str


@dataclass(frozen=True)
class CheckedRecipe:
    """A recipe's text, read and held against the schema; no ``data`` when it can't be read."""

    valid: bool
    problems: tuple[RecipeProblem, ...]
    data: dict[str, Any] | None

    def usable(self) -> Recipe:
        """Return the recipe.

        Raises
        ------
        BadRequestError
            With what has to be mended.
        """
        if not self.valid:
            raise BadRequestError("\n".join(one.message for one in self.problems))
        return Recipe.model_validate(self.data)


@dataclass(frozen=True)
class PickTarget:
    """A field of a recipe that a click on the tissue's surface can set.

    The place, mm, stands there under ``key``; empty where the field is the place itself.
    """

    name: str
    path: KeyPath
    key: str = ""


_PACKAGE: Final = Path(__file__).resolve().parents[2]
_SHIPPED: Final = _PACKAGE / "examples"
EXAMPLES: Final = _SHIPPED if _SHIPPED.is_dir() else _PACKAGE.parent / "examples"
"""In an installed package; in a copy of the sources beside the packages."""
SUFFIXES: Final = (
    ".stl", ".obj", ".ply", ".3mf", ".xyz", ".txt", ".csv", ".swc", ".json", ".npz", ".vtp",
    ".nii", ".gz", ".nrrd", ".tif", ".tiff",
)  # fmt: skip
"""Of files that a recipe may name: tissues, networks, tables."""
MESHES: Final = (".stl", ".obj", ".ply", ".3mf")
RESERVED: Final = ("schema", "examples", "choices", "validate", "import", "files")
"""Names that the REST paths below ``recipes`` have."""
_STARTS: Final = {
    ".ply": b"ply", ".3mf": b"PK", ".npz": b"PK", ".gz": b"\x1f\x8b", ".nrrd": b"NRRD",
}  # fmt: skip
_TEXTS: Final = (".obj", ".xyz", ".txt", ".csv", ".swc", ".json")


@dataclass(frozen=True)
class RecipeFile:
    """Stored recipe of the workspace: ``modified`` s since 1970, and how many problems it has."""

    name: str
    modified: float
    problems: int


@dataclass(frozen=True)
class RecipeText(CheckedRecipe):
    """A recipe as it lies in its file, and what is wrong with it.

    ``version`` changes with every change of the text; it is to be sent back with a changed one.
    """

    name: str
    text: str
    version: str
    places: tuple[PickTarget, ...]


@dataclass(frozen=True)
class MeshSize:
    """Extent of a mesh along x, y and z, in the file's own unit."""

    size: tuple[float, float, float]


@dataclass(frozen=True)
class RecipeChoices:
    """What a recipe's fields, and a new recipe, can be chosen from.

    ``profiles`` has by sort the names to be written, each with the name to be shown; ``files`` lie
    beside the recipes, which may name those of ``suffixes``; ``unusable`` ones must be renamed.
    """

    examples: tuple[str, ...]
    profiles: dict[str, dict[str, str]]
    files: tuple[str, ...]
    suffixes: tuple[str, ...]
    stages: tuple[str, ...]
    unusable: tuple[str, ...]


class Recipes:
    """The folder ``recipes`` of a workspace, with the files that they name, and its bin."""

    def __init__(self, workspace: Workspace) -> None:
        self.workspace, self._store = workspace, ProfileStore(workspace.root)
        self.folder, self._bin = workspace.root / "recipes", workspace.private / "bin"
        self._lock = threading.RLock()

    def rows(self) -> list[RecipeFile]:
        """All of them, by name."""
        return [
            RecipeFile(name, self._there(name).stat().st_mtime, len(self.read(name).problems))
            for name in self.names()
        ]

    def names(self) -> list[str]:
        """Their names, sorted."""
        files = [path for path in self.workspace.found("recipes/*.yaml") if path.is_file()]
        return sorted(path.stem for path in files if is_name(path.stem))

    def choices(self) -> RecipeChoices:
        """Return what there is to choose from."""
        files = (p.name for p in self.folder.iterdir() if p.suffix.lower() in SUFFIXES)
        return RecipeChoices(
            tuple(self.examples()),
            {sort: self._store.choices(model) for sort, model in PROFILES.items()},
            tuple(sorted(files)),
            SUFFIXES,
            TOOLPATH_NAMES,
            tuple(self.workspace.unusable_names("recipes/*.yaml", "runs/*")),
        )

    def examples(self) -> list[str]:
        """What a new recipe can begin from."""
        paths = [*EXAMPLES.glob("*.yaml"), *EXAMPLES.glob("paper/*.yaml")]
        named = (path.relative_to(EXAMPLES).with_suffix("").as_posix() for path in paths)
        return ["starter", *sorted(named)]

    def check(self, text: str) -> CheckedRecipe:
        """Hold a recipe's text against the schema, and look for the profiles and files it names."""
        try:
            data = read_text(text)
        except BadRequestError as exc:
            return CheckedRecipe(False, (RecipeProblem((), str(exc)),), None)
        problems = []
        try:
            Recipe.model_validate(data)
        except ValidationError as exc:
            for one in exc.errors():
                path = user_path(one["loc"])
                problems.append(RecipeProblem(path, sentence(dict(one), path).strip()))
        for path, value, node in fields_of(data):
            why = self._why_not(value, node) if isinstance(value, str) else ""
            if why:
                problems.append(RecipeProblem(path, f"{'.'.join(map(str, path))}: {why}"))
        return CheckedRecipe(not problems, tuple(problems), data)

    def _why_not(self, name: str, node: Schema) -> str:
        """Why a name can't stand in a field, by its node of the schema; empty where it can."""
        if "profile" in node:
            model = PROFILES[node["profile"]]
            if name.endswith((".yaml", ".yml")) and name not in self._store.choices(model):
                return (
                    "on the page a shipped profile is named, or one of your own in "
                    f"{self._store.folder(model)}; any other file is used from a terminal"
                )
            try:
                load(model, name)
            except ProfileError as exc:
                return str(exc)
        elif node.get("file"):
            inside = PurePath(name)
            if inside.is_absolute() or ".." in inside.parts or "\\" in name or not name:
                return (
                    f"{name!r} isn't the name of a file beside the recipe; upload the file to the "
                    "recipes and give its name"
                )
            try:
                there = (self.folder / inside).exists()
            except OSError:  # no file system takes such a name
                there = False
            return "" if there else f"there is no file {name!r} beside the recipe; upload it"
        return ""

    def read(self, name: str) -> RecipeText:
        """A recipe's text, and what is wrong with it."""
        text = self.text(name)
        checked = self.check(text)
        places = tuple(_pick_targets((checked.data or {}).get("vasculature")))
        version = _version(text)
        return RecipeText(**vars(checked), name=name, text=text, version=version, places=places)

    def text(self, name: str) -> str:
        """A recipe's text.

        Raises
        ------
        NotFoundError
        """
        return self._there(name).read_text(encoding="utf-8", errors="replace")

    def tissue_page(self, name: str) -> Path:
        """The page of a recipe's tissue, on which places are picked; see `tissue_page`."""
        section = (self.read(name).data or {}).get("tissue")
        return tissue_page(self.workspace.recipe(name), section, self.workspace.private / "pages")

    def write(self, name: str, text: str, version: str | None = None) -> RecipeText:
        """Write a recipe, right or wrong; what can't be read as YAML is refused.

        ``version`` is of the text that was changed; None for a new recipe.

        Raises
        ------
        BadRequestError
            When it can't be read.
        ConflictError
            When the recipe has changed since, or a new one is already there.
        """
        read_text(text)
        path = self.workspace.recipe(name)
        with self._lock:
            if version is None and name in RESERVED:
                raise BadRequestError(f"{name!r} can't be a recipe's name; give another one")
            if version is None and path.exists():
                raise ConflictError(f"there is a recipe {name!r} already; give another name")
            if version is not None:
                self.refuse_changed(name, version, text)
            write_text(path, text)
            return self.read(name)

    def refuse_changed(self, name: str, version: str, yours: str = "") -> str:
        """Return a recipe's text; ChangedError where its version is another by now.

        ``yours`` is the text that was to be written, where there is one.
        """
        theirs = self.text(name)
        if _version(theirs) == version:
            return theirs
        both = f" ({differences(theirs, yours)})" if yours else ""
        raise ChangedError(
            f"recipe {name!r} was changed elsewhere meanwhile, and nothing was done{both}; load it "
            "again"
        )

    def new(self, name: str, source: str = "starter") -> RecipeText:
        """Begin a recipe from the starter, or from an example."""
        if source not in self.examples():
            raise NotFoundError(f"there is no example {source[:80]!r}")
        path = STARTER if source == "starter" else EXAMPLES / f"{source}.yaml"
        return self._copied(path.read_text(encoding="utf-8"), name)

    def duplicate(self, name: str, copy: str) -> RecipeText:
        """Make a copy under another name."""
        return self._copied(self.text(name), copy)

    def _copied(self, text: str, name: str) -> RecipeText:
        return self.write(checked_name(name), with_values(text, {("name",): name}))

    def rename(self, name: str, to: str) -> RecipeText:
        """Give a recipe another name; runs that it made keep theirs."""
        with self._lock:  # what is saved meanwhile would be lost
            made = self.duplicate(name, to)
            self._there(name).unlink()
        return made

    def take_in(self, file_name: str, data: bytes) -> RecipeText:
        """Take in an uploaded recipe; its name is the file's, with a number where that is taken."""
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError as exc:
            raise BadRequestError("a recipe is text in UTF-8; this isn't") from exc
        stem = PurePath(usable_name(file_name, "recipe")).stem
        name = base = stem.replace(".", "_")[:48]
        further = count(2)
        while name in self.names():
            name = f"{base}_{next(further)}"
        return self.write(name, text)

    def take_file(self, file_name: str, data: bytes) -> str:
        """Take in a file that recipes name: a mesh, a network, a table.

        Raises
        ------
        BadRequestError
            For a name that can't be used, a suffix that no recipe reads, or another content.
        ConflictError
            When there is another file of that name.
        """
        name = usable_name(file_name)
        if PurePath(name).suffix.lower() not in SUFFIXES:
            raise BadRequestError(f"{name}: recipes name files of {', '.join(SUFFIXES)}")
        if not data:
            raise BadRequestError(f"{name} is empty (0 bytes); export it again")
        if not _is_of_its_kind(name, data):
            raise BadRequestError(
                f"{name} isn't what its suffix says, by its first bytes ({data[:4].hex(' ')}); "
                "export it again"
            )
        path = self.workspace.inside(self.folder / name)
        with self._lock:
            if path.exists() and path.read_bytes() != data:
                raise ConflictError(f"there is another file {name!r} already; rename yours")
            write_bytes(path, data)
        return name

    def mesh_size(self, name: str) -> MeshSize:
        """Return how large a mesh beside the recipes is, in its own unit.

        Raises
        ------
        NotFoundError, BadRequestError
            Where it isn't there, or is no mesh.
        """
        path = self.workspace.inside(self.folder / usable_name(name))
        if not path.is_file():
            raise NotFoundError(f"there is no file {name[:80]!r} beside the recipes")
        try:
            from design.geometry.mesh_files import read_mesh  # half a second, when one is dropped

            mesh = read_mesh(path, MESHES)
        except SolidError as exc:
            raise BadRequestError(str(exc).replace(f"{path}: ", f"{path.name}: ")) from exc
        x, y, z = np.ptp(mesh.vertices, axis=0).tolist()
        return MeshSize((x, y, z))

    def delete(self, name: str) -> None:
        """Put a recipe into the bin, from which `restore` takes it back; not while it is made."""
        path, run = self._there(name), self.workspace.run(name)
        if run.is_dir() and is_run_active(run):
            raise ConflictError(f"{name!r} is being made; cancel that first, or wait for its end")
        self._bin.mkdir(parents=True, exist_ok=True)
        with self._lock:
            path.replace(self._bin / f"{name}~{time.time_ns()}.yaml")

    def restore(self, name: str) -> RecipeText:
        """Take the recipe of that name that was thrown away last back from the bin."""
        with self._lock:
            thrown = sorted(self._bin.glob(f"{checked_name(name)}~*.yaml"))
            if not thrown:
                raise NotFoundError(f"there is no recipe {name!r} in the bin")
            made = self.write(name, thrown[-1].read_text(encoding="utf-8"))
            thrown[-1].unlink()
        return made

    def _there(self, name: str) -> Path:
        path = self.workspace.recipe(name)
        if not path.is_file():
            raise NotFoundError(f"there is no recipe {name!r}")
        return path


def _version(text: str) -> str:
    return digest_bytes(text.encode())[:16]


def _is_of_its_kind(name: str, data: bytes) -> bool:
    """Return whether a file begins as its suffix says; a binary STL holds what it counts."""
    suffix = PurePath(name).suffix.lower()
    if suffix == ".stl":
        triangles = int.from_bytes(data[80:84], "little")
        ascii_stl = data.lstrip().startswith(b"solid")
        return ascii_stl or 0 < triangles <= (len(data) - START_BYTES) // TRIANGLE.itemsize
    if suffix in _TEXTS:
        return b"\0" not in data[:1024]
    return data.startswith(_STARTS.get(suffix, b""))


def _pick_targets(part: Any) -> Iterator[PickTarget]:
    """Give the places that can be picked for a recipe's vessels; none where these aren't grown."""
    part = part if isinstance(part, dict) else {}
    at, inlet = "vasculature", "at_mm"
    grow, anatomy = part.get("grow"), part.get("anatomy")
    if grow == "tree" and isinstance(anatomy, dict):
        for name in INLETS.get(str(anatomy.get("template")), ()):
            yield PickTarget(name.replace("_", " "), (at, "anatomy", "inlets", name), inlet)
    elif grow == "tree":
        count = len(_each(part.get("inlets")))
        yield PickTarget("a further inlet", (at, "inlets", count), inlet)
        for k in range(count):
            yield PickTarget(f"inlet {k + 1}", (at, "inlets", k), inlet)
    elif grow == "closed_loop":
        yield PickTarget("the artery's inlet", (at, "root_mm"))
        yield PickTarget("the vein's outlet", (at, "vein_root_mm"))
    elif grow == "forest":
        for n, network in enumerate(_each(part.get("networks"))):
            trees = network.get("trees") if isinstance(network, dict) else None
            for k, tree in enumerate(_each(trees)):
                kind = tree.get("kind", "tree") if isinstance(tree, dict) else "tree"
                path = (at, "networks", n, "trees", k, "root_mm")
                yield PickTarget(f"network {n + 1}: {kind} {k + 1}", path)


def _each(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []
