"""Recipes of the workspace: their text, checks and files."""

from __future__ import annotations

import hashlib
import re
import threading
import time
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any, Final

import yaml
from pydantic import ValidationError

from design.files import write_bytes, write_text
from design.geometry.surface import START_BYTES, TRIANGLE
from firmware_profiles import Bath, Dish, Ink, Needle, Plate, Printer, ProfileError, Syringe, load
from firmware_profiles.strict_model import Facts
from firmware_profiles.yaml_file import read_yaml
from printctl.recipe import Recipe
from printctl.recipe.load import STARTER, sentence
from printctl.web.design import form as forms
from printctl.web.design.schema import recipe_form
from printctl.web.errors import BadRequestError, ConflictError, NotFoundError
from printctl.web.profile_store import ProfileStore
from printctl.web.workspace import Workspace, checked_name, is_name

# Parse and edit a recipe's YAML text in place, so that comments stay.
#
# ruamel.yaml drops the comments behind a key that is removed: 7 of the starter recipe's 62.

MOST_BYTES: Final = 256_000
MOST_DEPTH: Final = 30


def read_text(text: str) -> dict[str, Any]:
    """Keys and values of a recipe's text.

    Raises
    ------
    BadRequestError
        When it isn't YAML, is too large or too deep, holds no keys, or uses aliases or tags, which
        a recipe never needs and a trap may.
    """
    try:
        size = len(text.encode())
    except UnicodeEncodeError as exc:
        raise BadRequestError("a recipe is text in UTF-8; this holds signs that aren't") from exc
    if size > MOST_BYTES:
        raise BadRequestError(f"a recipe is at most {MOST_BYTES // 1000} kB; this has more")
    try:
        _check_events(text)
        data = read_yaml(text)
    except (yaml.YAMLError, ValueError, RecursionError) as exc:
        raise BadRequestError(f"this isn't YAML: {exc}") from exc
    if not isinstance(data, dict) or any(not isinstance(key, str) for key in data):
        raise BadRequestError("this holds no keys; begin with `schema: 1` and `name: ...`")
    return data


def _check_events(text: str) -> None:
    depth = 0
    for event in yaml.parse(text, Loader=yaml.SafeLoader):
        line = event.start_mark.line + 1 if event.start_mark else 0
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
            raise BadRequestError(f"line {line}: aliases (& and *) aren't taken; write it out")
        if getattr(event, "tag", None):
            raise BadRequestError(f"line {line}: tags (!) aren't taken; write the plain value")
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > MOST_DEPTH:
            raise BadRequestError(f"line {line}: more than {MOST_DEPTH} levels deep; no recipe is")


def rewrite_yaml(text: str, new: dict[str, Any]) -> str:
    """The text with the data ``new``; what hasn't changed stays as it is, comments with it.

    Where that can't be done the whole is written anew, without comments.
    """
    try:
        draft = _spliced(text, new)
        if draft is not None and read_yaml(draft) == new:
            return draft
    except (yaml.YAMLError, ValueError):
        pass
    return dumped(new)


def dumped(data: Any) -> str:
    """Data as a recipe's text: sections in lines, short lists in one."""
    return yaml.dump(data, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=100, indent=2)


class _Dumper(yaml.SafeDumper):
    """Lists of plain values in one line, all else in lines of their own."""


def _list(dumper: yaml.SafeDumper, value: list[Any]) -> yaml.Node:
    plain = not any(isinstance(one, dict | list) for one in value)
    return dumper.represent_sequence("tag:yaml.org,2002:seq", value, flow_style=plain)


_Dumper.add_representer(list, _list)


_Dumper.ignore_aliases = lambda self, data: True  # type: ignore[method-assign]


def _spliced(text: str, new: dict[str, Any]) -> str | None:
    for _ in range(200):
        old = read_yaml(text)
        if old == new:
            return text
        root = yaml.compose(text, Loader=yaml.SafeLoader)
        changed = _change(text, root, old, new) if isinstance(root, yaml.MappingNode) else None
        if changed is None:
            return None
        text = changed
    return None


def _change(text: str, node: yaml.MappingNode, old: Any, new: Any) -> str | None:
    """The text with one difference mended."""
    if node.flow_style or not node.value:
        return None
    pairs = {key.value: (key, value) for key, value in node.value}
    for name, (key, value) in pairs.items():
        if name not in new:
            return _cut(text, key, value) if len(pairs) > 1 else None
        if old[name] == new[name] and isinstance(old[name], bool) == isinstance(new[name], bool):
            continue
        both = isinstance(old[name], dict) and isinstance(new[name], dict) and new[name]
        if both and isinstance(value, yaml.MappingNode) and not _in_line(value):
            return _change(text, value, old[name], new[name])
        return _replaced(text, key, value, new[name])
    added = next((name for name in new if name not in old), None)
    if added is None:
        return None
    key, value = node.value[-1]
    entry = _lines(added, new[added], key.start_mark.column)
    return _with_lines(text, _last_line(value) + 1, _last_line(value) + 1, entry)


def _replaced(text: str, key: yaml.Node, value: yaml.Node, new: Any) -> str:
    plain = not isinstance(new, dict) and not any(isinstance(v, dict | list) for v in _each(new))
    if _in_line(value) or (plain and isinstance(value, yaml.ScalarNode)):
        shown = yaml.safe_dump(
            new, default_flow_style=True, allow_unicode=True, width=10**6, sort_keys=False
        )
        shown = shown.removesuffix("\n").removesuffix("\n...")
        return text[: value.start_mark.index] + shown + text[value.end_mark.index :]
    entry = _lines(str(key.value), new, key.start_mark.column)
    return _with_lines(text, key.start_mark.line, _last_line(value) + 1, entry)


def _in_line(node: yaml.Node) -> bool:
    """Whether a list or mapping is written with brackets."""
    return bool(getattr(node, "flow_style", False))


def _each(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []


def _cut(text: str, key: yaml.Node, value: yaml.Node) -> str:
    return _with_lines(text, key.start_mark.line, _last_line(value) + 1, "")


def _lines(key: str, value: Any, column: int) -> str:
    pad = " " * column
    return "".join(f"{pad}{line}\n" for line in dumped({key: value}).splitlines())


def _last_line(node: yaml.Node) -> int:
    """The line of a node's last sign; a block's own end mark lies behind its comments."""
    if isinstance(node, yaml.ScalarNode) or _in_line(node) or not node.value:
        return int(node.end_mark.line)
    last = node.value[-1]
    return _last_line(last[1] if isinstance(last, tuple) else last)


def _with_lines(text: str, first: int, after: int, entry: str) -> str:
    lines = text.splitlines(keepends=True)
    if lines and not lines[-1].endswith("\n"):
        lines[-1] += "\n"
    return "".join([*lines[:first], entry, *lines[after:]])


# Check a recipe for the editor: schema, named profiles and files; each error at its field.

PROFILES: Final[dict[str, type[Facts]]] = {
    "printers": Printer,
    "needles": Needle,
    "syringes": Syringe,
    "inks": Ink,
    "baths": Bath,
    "dishes": Dish,
    "plates": Plate,
}


@dataclass(frozen=True)
class RecipeProblem:
    """Error in a recipe, with its place.

    Attributes
    ----------
    path : tuple of str or int
        Keys to the field; empty for the whole.
    message : str
    """

    path: forms.Path
    message: str

    @property
    def place(self) -> str:
        """The path in one word, as messages name it."""
        return ".".join(map(str, self.path))


@dataclass(frozen=True)
class CheckedRecipe:
    """A recipe's text, read and held against the schema.

    Attributes
    ----------
    data : dict or None
        None when the text can't be read.
    recipe : Recipe or None
        None when it can't be used.
    problems : tuple of RecipeProblem
    """

    data: dict[str, Any] | None
    recipe: Recipe | None
    problems: tuple[RecipeProblem, ...]


def check_text(text: str, folder: Path, store: ProfileStore) -> CheckedRecipe:
    """Read and check a recipe.

    Parameters
    ----------
    text : str
    folder : Path
        That the recipe's paths are relative to, and stay in.
    store : ProfileStore
        Profiles that it may name.
    """
    try:
        data = read_text(text)
    except BadRequestError as exc:
        return CheckedRecipe(None, None, (RecipeProblem((), str(exc)),))
    return check_data(data, folder, store)


def check_data(data: dict[str, Any], folder: Path, store: ProfileStore) -> CheckedRecipe:
    """As `check_text`, of data."""
    named = tuple(_named(data, folder, store))
    try:
        recipe = Recipe.model_validate(data)
    except ValidationError as exc:
        problems = tuple(_problem(dict(one), data) for one in exc.errors())
        return CheckedRecipe(data, None, problems + named)
    return CheckedRecipe(data, None if named else recipe, named)


def _problem(raw: dict[str, Any], data: dict[str, Any]) -> RecipeProblem:
    path = forms.user_path(recipe_form(), data, raw["loc"])
    return RecipeProblem(path, sentence(raw, path).strip())


def _named(data: dict[str, Any], folder: Path, store: ProfileStore) -> list[RecipeProblem]:
    """Profiles that aren't there, and files that aren't or lie outside the recipe's folder."""
    problems = []
    # Unknown keys are refused by the schema itself.
    for path, value in forms.form_values(recipe_form(), data, strict=False):
        field = forms.field_at(recipe_form(), data, path)
        if field is None or not isinstance(value, str):
            continue
        message = ""
        if field.node.sort == "profile":
            message = _profile(PROFILES[field.node.profile], value, store)
        elif field.node.sort == "file":
            message = _file(value, folder)
        if message:
            problems.append(RecipeProblem(path, f"{'.'.join(map(str, path))}: {message}"))
    return problems


def _profile(model: type[Facts], name: str, store: ProfileStore) -> str:
    if name.endswith((".yaml", ".yml")) and name not in store.choices(model):
        return (
            f"on the page a shipped profile is named, or one of your own in {store.folder(model)}; "
            "any other file is used from a terminal"
        )
    try:
        load(model, name)
    except ProfileError as exc:
        return str(exc)
    return ""


def _file(name: str, folder: Path) -> str:
    inside = PurePath(name)
    if inside.is_absolute() or ".." in inside.parts or "\\" in name or not name:
        return (
            f"{name!r} isn't the name of a file beside the recipe; upload the file to the "
            "recipes and give its name"
        )
    try:
        there = (folder / inside).exists()
    except OSError:  # no file system takes such a name
        there = False
    if not there:
        return f"there is no file {name!r} beside the recipe; upload it"
    return ""


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
        files = [path for path in self._workspace.found("recipes/*.yaml") if path.is_file()]
        return sorted(path.stem for path in files if is_name(path.stem))

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
