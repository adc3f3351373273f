"""`printctl doctor`: whether this machine is fit to design and to print."""

from __future__ import annotations

import importlib
import os
import platform
import shutil
import sys
from importlib import metadata
from pathlib import Path
from typing import Annotated, Any

import typer

from kernels import cache_dir
from printctl.cli.options import JsonFlag, messages, print_json, print_lines
from printctl.link.ports import list_ports

OURS = ("kernels", "firmware_profiles", "design", "sim", "registration", "printctl")


def doctor(
    warm: Annotated[
        bool, typer.Option("--warm", help="Compile all kernels now, so that no run waits for them.")
    ] = False,
    as_json: JsonFlag = False,
) -> None:
    """Show Python, packages and where they were loaded from, ports with permissions, disk."""
    if warm:
        from printctl.warm import warm_kernels  # Loads everything; only wanted here.

        messages().print("compiling kernels (once per version, a minute or two) ...")
        warm_kernels()
    facts = examine()
    if as_json:
        print_json(facts)
        return
    for section, entries in facts.items():
        print_lines(section, *(f"  {key:<20} {value}" for key, value in entries.items()))


def examine() -> dict[str, dict[str, Any]]:
    """Collect what a helper would ask for first."""
    return {
        "machine": {
            "python": f"{platform.python_version()} ({sys.executable})",
            "system": platform.platform(),
            "cores": os.cpu_count(),
            "free disk here, GB": round(shutil.disk_usage(Path.cwd()).free / 1e9, 1),
            "kernel cache": str(cache_dir()),
        },
        "our packages, loaded from": {
            name: str(Path(importlib.import_module(name).__file__ or "?").parent) for name in OURS
        },
        "libraries": {
            name: metadata.version(name)
            for name in ("numpy", "scipy", "numba", "trimesh", "manifold3d", "pyserial", "pydantic")
        },
        "ports": {port.device: _permission(port.device) for port in list_ports()},
    }


def _permission(device: str) -> str:
    if sys.platform == "win32" or os.access(device, os.R_OK | os.W_OK):
        return "readable and writable"
    return "no permission; add yourself to the group dialout (or uucp) and log in again"
