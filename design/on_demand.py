"""Lazy imports: load a package's submodules when one of its names is first used.

A process that only reads a recipe or keeps a printer's port needs a room's plain values, and not
the kernels and mesh libraries beside them, which take seconds to load.

lazy_loader would want the names of 24 packages a second time; it saves 1 ms a package.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any


def on_demand(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """A package's ``__getattr__`` and ``__dir__``: a name's module is loaded when it is asked for.

    Where names come from stands in the package's ``__init__.py`` under ``if TYPE_CHECKING:``, as
    imports that checkers and readers know; this reads them there. No name may be a module's of the
    package: loading the module would put it in the name's place.

    Parameters
    ----------
    package : str
        The package's ``__name__``; ask for it in its ``__init__.py``.
    """
    homes: dict[str, str] = {}

    def found(name: str) -> Any:
        if not homes:
            homes.update(exported_names(package))
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(homes[name]), name)
        setattr(sys.modules[package], name, value)
        return value

    return found, lambda: list(sys.modules[package].__all__)


def exported_names(package: str) -> dict[str, str]:
    """Name and module of all that a package hands on on demand."""
    tree = ast.parse(Path(str(sys.modules[package].__file__)).read_text(encoding="utf-8"))
    return dict(_names(tree))


def _names(tree: ast.Module) -> Iterator[tuple[str, str]]:
    for block in tree.body:
        if isinstance(block, ast.If) and ast.unparse(block.test) == "TYPE_CHECKING":
            for line in block.body:
                if isinstance(line, ast.ImportFrom) and line.module:
                    yield from ((alias.name, line.module) for alias in line.names)
