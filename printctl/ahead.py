"""Modules imported while something else is computed."""

from __future__ import annotations

from contextlib import suppress
from importlib import import_module
from threading import Thread


def import_ahead(module: str) -> None:
    """Import `module` beside what goes on.

    Kernels don't hold the interpreter's lock, so plotting libraries load while they run. What is
    wrong with the module shows where it is imported for use.
    """
    Thread(target=_import, args=(module,), daemon=True).start()


def _import(module: str) -> None:
    with suppress(Exception):
        import_module(module)
