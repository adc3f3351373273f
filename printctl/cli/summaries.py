"""Extract the commands' help summaries from their source, without importing them."""

from __future__ import annotations

import ast
import inspect
from importlib.util import find_spec
from pathlib import Path


def summary(module: str, attribute: str) -> str:
    """Return the docstring of a function, or the `help` of a group, that stands in a module.

    Parameters
    ----------
    module : str
        Its whole name.
    attribute : str
        A function's name, or one that a `typer.Typer(help=...)` is assigned to.

    Raises
    ------
    LookupError
        When the module has no such source.
    """
    spec = find_spec(module)
    if spec is None or spec.origin is None:
        raise LookupError(f"no source of {module}")
    for node in ast.parse(Path(spec.origin).read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef) and node.name == attribute:
            return ast.get_docstring(node) or ""
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Call):
            names = [one.id for one in node.targets if isinstance(one, ast.Name)]
            if attribute in names:
                return _help_of(node.value)
    raise LookupError(f"{module} has no function or group {attribute}")


def _help_of(call: ast.Call) -> str:
    for keyword in call.keywords:
        if keyword.arg == "help":
            return inspect.cleandoc(str(ast.literal_eval(keyword.value)))
    return ""
