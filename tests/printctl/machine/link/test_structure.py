"""Code structure of link and station: short inheritance, private attributes with one owner."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[4]
FOLDERS = ("printctl/machine/link", "printctl/machine/station", "firmware_profiles/families")
MOST_CLASSES = 2
"""In a chain: a class and one base."""


@dataclass(frozen=True)
class Source:
    """A class as its file says it.

    Attributes
    ----------
    path : Path
    node : ClassDef
    bases : list of Source
        Of the project.
    """

    path: Path
    node: ast.ClassDef
    bases: list[Source] = field(default_factory=list)

    @property
    def name(self) -> str:
        return f"{self.path.relative_to(ROOT)}: {self.node.name}"

    def chain(self) -> int:
        """Classes of the project from this one up."""
        return 1 + max((base.chain() for base in self.bases), default=0)

    def is_error(self) -> bool:
        """Whether it is a kind of exception: their tree says what is caught with what."""
        names = {ast.unparse(base) for base in self.node.bases}
        return bool(names & {"Exception", "RuntimeError", "BaseException"}) or any(
            base.is_error() for base in self.bases
        )

    def above(self) -> Iterator[Source]:
        for base in self.bases:
            yield base
            yield from base.above()


def is_private(name: str) -> bool:
    return name.startswith("_") and not name.endswith("__")


def modules() -> list[str]:
    """Paths of the modules of link, station and the families' protocols."""
    return [str(path) for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.py"))]


def imported(tree: ast.Module) -> dict[str, tuple[str, str]]:
    """Names that a module imports from others, each with the module's path and its name there."""
    return {
        alias.asname or alias.name: (module_path(node.module), alias.name)
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module
        for alias in node.names
    }


def module_path(module: str) -> str:
    path = ROOT.joinpath(*module.split("."))
    return str(path / "__init__.py" if path.is_dir() else path.with_suffix(".py"))


class House:
    """Classes of these modules, with their bases wherever in the project they are written."""

    def __init__(self) -> None:
        self.trees: dict[str, ast.Module] = {}
        self.imports: dict[str, dict[str, tuple[str, str]]] = {}
        self.nodes: dict[tuple[str, str], ast.ClassDef] = {}
        self.sources: dict[tuple[str, str], Source] = {}
        for path in modules():
            self.read(path)

    def read(self, path: str) -> None:
        """Take in a module, unless it is known or another program's."""
        if path in self.trees or not Path(path).is_file():
            return
        tree = self.trees[path] = ast.parse(Path(path).read_text(encoding="utf-8"))
        self.imports[path] = imported(tree)
        self.nodes |= {
            (path, node.name): node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)
        }

    def source(self, key: tuple[str, str]) -> Source:
        """The class of that name in that file."""
        if key not in self.sources:
            node = self.nodes[key]
            found = [self.find(key[0], ast.unparse(base)) for base in node.bases]
            bases = [self.source(base) for base in found if base is not None]
            self.sources[key] = Source(Path(key[0]), node, bases)
        return self.sources[key]

    def find(self, path: str, name: str) -> tuple[str, str] | None:
        """Where a class that a file names is written; None for one of another program's."""
        name = name.partition("[")[0]
        self.read(path)
        while (path, name) not in self.nodes:
            if name not in self.imports.get(path, {}):
                return None
            path, name = self.imports[path][name]
            self.read(path)
        return path, name

    def of_folders(self) -> list[Source]:
        """Classes of link, station and the families' protocols."""
        folders = tuple(str(ROOT / folder) + "/" for folder in FOLDERS)
        return [self.source(key) for key in sorted(self.nodes) if key[0].startswith(folders)]


def own(nodes: ast.AST, written: bool = False) -> set[str]:
    """Private attributes of ``self`` that are used in a class; only those written to."""
    return {
        node.attr
        for node in ast.walk(nodes)
        if isinstance(node, ast.Attribute)
        and isinstance(node.value, ast.Name)
        and node.value.id in ("self", "cls")
        and is_private(node.attr)
        and (not written or not isinstance(node.ctx, ast.Load))
    }


def declared(node: ast.ClassDef) -> set[str]:
    """Private names that a class's body or methods make."""
    made = {one.name for one in node.body if isinstance(one, ast.FunctionDef)}
    for one in node.body:
        if isinstance(one, (ast.AnnAssign, ast.Assign)):
            targets = one.targets if isinstance(one, ast.Assign) else [one.target]
            made |= {target.id for target in targets if isinstance(target, ast.Name)}
    return {name for name in made if is_private(name)} | own(node, written=True)


@pytest.fixture(scope="module")
def house() -> House:
    return House()


def test_no_chain_of_classes_is_longer_than_a_class_and_its_base(house):
    found = house.of_folders()
    assert len(found) > 80, "link and station were looked for in the wrong place"
    long = [one.name for one in found if one.chain() > MOST_CLASSES and not one.is_error()]
    assert long == []


def test_no_private_attribute_is_written_in_two_files(house):
    shared = [
        f"{one.name} and {base.name}: {sorted(names)}"
        for one in house.of_folders()
        for base in one.above()
        if base.path != one.path
        and (names := own(one.node, written=True) & own(base.node, written=True))
    ]
    assert shared == []


def test_no_private_name_of_a_base_in_another_file_is_used(house):
    used = [
        f"{one.name} uses of {base.name}: {sorted(names)}"
        for one in house.of_folders()
        for base in one.above()
        if base.path != one.path and (names := own(one.node) & declared(base.node))
    ]
    assert used == []


def test_no_private_attribute_of_another_object_is_used_outside_of_its_file(house):
    folders = tuple(str(ROOT / folder) + "/" for folder in FOLDERS)
    strangers = [
        f"{Path(path).relative_to(ROOT)}:{node.lineno}: {ast.unparse(node)}"
        for path, tree in house.trees.items()
        if path.startswith(folders)
        for node in foreign(tree)
        if node.attr not in made_in(tree)
    ]
    assert strangers == []


def foreign(tree: ast.Module) -> list[ast.Attribute]:
    """Private attributes of anything but ``self``; functions of imported modules apart."""
    named = {
        alias.asname or alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.Import)
        for alias in node.names
    }
    return [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute)
        and is_private(node.attr)
        and ast.unparse(node.value) not in {"self", "cls", *named}
    ]


def made_in(tree: ast.Module) -> set[str]:
    """Private names that the classes of a file make."""
    classes = [node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]
    return set().union(*(declared(node) for node in classes))
