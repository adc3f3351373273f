"""List every compiled kernel of the product and its dependencies, found without the cache key."""

from __future__ import annotations

import ast
import builtins
import importlib
import inspect
import pkgutil
import textwrap
from collections.abc import Iterator
from functools import cache
from types import ModuleType
from typing import Any

from numba.core.dispatcher import Dispatcher

import design
import registration
import sim

OPTIONAL = {"dolfinx", "ufl", "mpi4py", "petsc4py", "ngsolve", "netgen"}


@cache
def all_kernels() -> dict[str, Dispatcher]:
    """Kernels by module and name."""
    found = {}
    for package in (design, registration, sim):
        for module in _modules(package):
            for value in vars(module).values():
                if isinstance(value, Dispatcher):
                    found[kernel_name(value)] = value
    return found


def kernel_name(kernel: Dispatcher) -> str:
    """Module and name of a kernel."""
    return f"{kernel.py_func.__module__}.{kernel.py_func.__qualname__}"


def _modules(package: ModuleType) -> Iterator[ModuleType]:
    for one in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
        if one.name.endswith("__main__"):
            continue
        try:
            yield importlib.import_module(one.name)
        except ModuleNotFoundError as error:
            if error.name not in OPTIONAL:
                raise


@cache
def names_read(kernel: Dispatcher) -> dict[str, Any]:
    """Globals that a kernel's source text reads, by the syntax tree, with their values."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(kernel.py_func)))
    function = tree.body[0]
    assert isinstance(function, ast.FunctionDef)
    bound = {one.arg for one in ast.walk(function) if isinstance(one, ast.arg)}
    read: set[str] = set()
    for statement in function.body:
        for node in ast.walk(statement):
            if isinstance(node, ast.AnnAssign):
                node.annotation = ast.Constant(None)
        for node in ast.walk(statement):
            if isinstance(node, ast.Name):
                (read if isinstance(node.ctx, ast.Load) else bound).add(node.id)
    globals_ = kernel.py_func.__globals__
    return {
        name: globals_[name]
        for name in sorted(read - bound)
        if name in globals_ and not hasattr(builtins, name)
    }
