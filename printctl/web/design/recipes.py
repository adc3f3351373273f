"""Recipes stored in the workspace: list, create, upload, check, write, rename, delete, restore."""

from __future__ import annotations

import hashlib
import re
import threading
import time
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Final

from design.files import write_bytes, write_text
from design.geometry.surface import START_BYTES, TRIANGLE
from printctl.recipe.load import STARTER
from printctl.web.design.checking import CheckedRecipe, check_text
from printctl.web.design.yaml_text import read_text, rewrite_yaml
from printctl.web.errors import BadRequestError, ConflictError, NotFoundError
from printctl.web.profile_store import ProfileStore
from printctl.web.workspace import Workspace, checked_name, is_name

EXAMPLES: Final = Path(__file__).resolve().parents[3] / "examples"
"""Beside the packages in a copy of the sources; an installed program has the starter alone."""

SUFFIXES: Final = (
    ".stl", ".obj", ".ply", ".3mf", ".xyz", ".txt", ".csv", ".swc", ".json", ".npz", ".vtp",
    ".nii", ".gz", ".nrrd", ".tif", ".tiff",
)  # fmt: skip
"""Of files that a recipe may name: tissues, networks, tables."""
_STARTS: Final = {
    ".ply": b"ply", ".3mf": b"PK", ".npz": b"PK", ".gz": b"\x1f\x8b", ".nrrd": b"NRRD",
}  # fmt: skip
_TEXTS: Final = (".obj", ".xyz", ".txt", ".csv", ".swc", ".json")


@dataclass(frozen=True)
class RecipeFile:
    """Stored recipe of the workspace.

    Attributes
    ----------
    name : str
    modified : float, s since 1970
    problems : int
        How many things are wrong with it.
    """

    name: str
    modified: float
    problems: int


@dataclass(frozen=True)
class RecipeText:
    """A recipe as it lies in its file.

    Attributes
    ----------
    name : str
    text : str
    version : str
        Changes with every change of the text.
    """

    name: str
    text: str

    @property
    def version(self) -> str:
        """Hash of the text."""
        return hashlib.sha256(self.text.encode()).hexdigest()[:16]


class Recipes:
    """The folder ``recipes`` of a workspace, and its bin.

    Attributes
    ----------
    store : ProfileStore
        Profiles that a recipe may name.
    """

    def __init__(self, workspace: Workspace) -> None:
        self._workspace, self.store = workspace, ProfileStore(workspace.root)
        self._lock = threading.Lock()

    @property
    def folder(self) -> Path:
        """Where they lie, with the files that they name."""
        return self._workspace.root / "recipes"

    @property
    def _bin(self) -> Path:
        return self._workspace.private / "bin"

    def rows(self) -> list[RecipeFile]:
        """All of them, by name."""
        files = []
        for path in map(self._workspace.recipe, self.names()):
            checked = self.check(path.read_text(encoding="utf-8", errors="replace"))
            files.append(RecipeFile(path.stem, path.stat().st_mtime, len(checked.problems)))
        return files

    def names(self) -> list[str]:
        """Their names, sorted."""
        return sorted(p.stem for p in self._workspace.found("recipes/*.yaml") if is_name(p.stem))

    def files(self) -> list[str]:
        """Files beside the recipes that these may name, sorted."""
        return sorted(p.name for p in self.folder.iterdir() if p.suffix.lower() in SUFFIXES)

    def examples(self) -> list[str]:
        """What a new recipe can begin from."""
        paths = [*EXAMPLES.glob("*.yaml"), *EXAMPLES.glob("paper/*.yaml")]
        named = (path.relative_to(EXAMPLES).with_suffix("").as_posix() for path in paths)
        return ["starter", *sorted(named)]

    def check(self, text: str) -> CheckedRecipe:
        """Read a recipe's text and hold it against the schema."""
        return check_text(text, self.folder, self.store)

    def read(self, name: str) -> RecipeText:
        """A recipe's text.

        Raises
        ------
        NotFoundError
        """
        path = self._there(name)
        return RecipeText(name, path.read_text(encoding="utf-8", errors="replace"))

    def write(self, name: str, text: str, version: str | None = None) -> RecipeText:
        """Write a recipe, right or wrong; what can't be read as YAML is refused.

        Parameters
        ----------
        name, text : str
        version : str or None
            Of the text that was changed; None for a new recipe.

        Raises
        ------
        BadRequestError
            When it can't be read.
        ConflictError
            When the recipe has changed since, or a new one is already there.
        """
        read_text(text)
        path = self._workspace.recipe(name)
        with self._lock:
            if version is None and path.exists():
                raise ConflictError(f"there is a recipe {name!r} already; give another name")
            if version is not None and self.read(name).version != version:
                raise ConflictError(
                    f"recipe {name!r} was changed elsewhere meanwhile; load it again"
                )
            write_text(path, text)
        return RecipeText(name, text)

    def new(self, name: str, source: str = "starter") -> RecipeText:
        """Begin a recipe from the starter, or from an example.

        Raises
        ------
        NotFoundError, ConflictError, BadRequestError
        """
        if source not in self.examples():
            raise NotFoundError(f"there is no example {source[:80]!r}")
        path = STARTER if source == "starter" else EXAMPLES / f"{source}.yaml"
        made = self._named(path.read_text(encoding="utf-8"), name)
        return self.write(name, made)

    def duplicate(self, name: str, copy: str) -> RecipeText:
        """Make a copy under another name."""
        return self.write(copy, self._named(self.read(name).text, copy))

    def rename(self, name: str, to: str) -> RecipeText:
        """Give a recipe another name; runs that it made keep theirs."""
        made = self.duplicate(name, to)
        self._there(name).unlink()
        return made

    def take_in(self, file_name: str, data: bytes) -> RecipeText:
        """Take in an uploaded recipe; its name is the file's, with a number where that is taken.

        Raises
        ------
        BadRequestError
        """
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError as exc:
            raise BadRequestError("a recipe is text in UTF-8; this isn't") from exc
        read_text(text)
        stem = re.sub(r"[^A-Za-z0-9_-]+", "_", PurePath(file_name).stem).strip("_-")[:48]
        base = stem or "recipe"
        taken = self.names()
        free = (n for n in (base, *(f"{base}_{k}" for k in range(2, 1000))) if n not in taken)
        return self.write(next(free), text)

    def take_file(self, file_name: str, data: bytes) -> str:
        """Take in a file that recipes name: a mesh, a network, a table.

        Raises
        ------
        BadRequestError
            For a name that can't be used, a suffix that no recipe reads, or another content.
        ConflictError
            When there is another file of that name.
        """
        name = checked_name(PurePath(file_name).name)
        if PurePath(name).suffix.lower() not in SUFFIXES:
            raise BadRequestError(f"{name}: recipes name files of {', '.join(SUFFIXES)}")
        if not _is_of_its_kind(name, data):
            raise BadRequestError(
                f"{name} isn't what its suffix says, by its first bytes ({data[:4].hex(' ')}); "
                "export it again"
            )
        path = self._workspace.inside(self.folder / name)
        if path.exists() and path.read_bytes() != data:
            raise ConflictError(f"there is another file {name!r} already; rename yours")
        write_bytes(path, data)
        return name

    def delete(self, name: str) -> None:
        """Put a recipe into the bin, from which `restore` takes it back."""
        path = self._there(name)
        self._bin.mkdir(parents=True, exist_ok=True)
        path.replace(self._bin / f"{name}~{time.time_ns()}.yaml")

    def restore(self, name: str) -> RecipeText:
        """Take the recipe of that name that was thrown away last back from the bin.

        Raises
        ------
        NotFoundError, ConflictError
        """
        thrown = sorted(self._bin.glob(f"{checked_name(name)}~*.yaml"))
        if not thrown:
            raise NotFoundError(f"there is no recipe {name!r} in the bin")
        made = self.write(name, thrown[-1].read_text(encoding="utf-8"))
        thrown[-1].unlink()
        return made

    def _there(self, name: str) -> Path:
        path = self._workspace.recipe(name)
        if not path.is_file():
            raise NotFoundError(f"there is no recipe {name!r}")
        return path

    def _named(self, text: str, name: str) -> str:
        checked_name(name)
        return rewrite_yaml(text, {**read_text(text), "name": name})


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
