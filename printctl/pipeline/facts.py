"""Provenance facts of the run manifest: versions, seeds, profile, input hashes, frames."""

from __future__ import annotations

import os
import platform
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

from printctl.run_folder.manifest import digest_file, digest_json
from printctl.version import version

if TYPE_CHECKING:  # a scan registered alone has neither
    from printctl.pipeline.context import RunContext
    from printctl.recipe import Recipe

LIBRARIES = ("printctl", "numpy", "scipy", "numba", "manifold3d", "shapely", "trimesh")


def input_digests(context: RunContext) -> dict[str, str]:
    """SHA-256 of each file that the recipe names; of a scan that is a folder of its files' list."""
    recipe = context.recipe
    named = [name for name in (*recipe.files(), getattr(recipe.scan, "file", None)) if name]
    folders = {name: context.recipe_folder / name for name in named}
    listed = {
        name: digest_json({one.name: digest_file(one) for one in path.iterdir() if one.is_file()})
        for name, path in folders.items()
        if path.is_dir()
    }
    return context.digests(named) | listed


def versions() -> dict[str, str]:
    """Of what numbers rest on."""
    return {name: metadata.version(name) for name in LIBRARIES} | {"printctl": version()}


def scan_origin(scan: Path, network: Path) -> dict[str, Any]:
    """Versions and digests of a scan registered alone; of a scan that is a folder no digest."""
    files = [path for path in (scan, network) if path.is_file()]
    return {
        "versions": versions(),
        "inputs": {path.name: digest_file(path) for path in files},
    }


def run_facts(context: RunContext) -> dict[str, Any]:
    """Versions, machine, recipe with all defaults, profiles and frames."""
    recipe = context.recipe
    return {
        "recipe": recipe_facts(recipe),
        "seed": recipe.seed,
        "inputs": input_digests(context),
        "versions": versions(),
        "machine": {
            "python": platform.python_version(),
            "system": platform.platform(),
            "architecture": platform.machine(),
            "cores": os.cpu_count(),
        },
        "profiles": {
            "printer": context.printer.model_dump(mode="json"),
            "needle": context.needle.model_dump(mode="json"),
            "syringe": context.syringe.model_dump(mode="json"),
            "ink": context.ink.model_dump(mode="json"),
            **heads_facts(context),
            "bath": context.bath.model_dump(mode="json"),
        },
    }


def recipe_facts(recipe: Recipe) -> dict[str, Any]:
    """The recipe with all defaults; a stage that isn't asked for isn't named."""
    unasked = {"oxygen"} if recipe.oxygen is None else set()
    return recipe.model_dump(mode="json", by_alias=True, exclude=unasked)


def heads_facts(context: RunContext) -> dict[str, Any]:
    """What each of several heads holds; nothing for a printer with one."""
    return {"heads": heads_dump(context)} if context.printer.heads else {}


def heads_dump(context: RunContext) -> list[dict[str, Any]]:
    """Profiles of each of several heads' syringe, ink and needle; empty for a printer with one."""
    if not context.printer.heads:
        return []
    return [
        {
            "syringe": one.syringe.model_dump(mode="json"),
            "ink": one.ink.model_dump(mode="json"),
            "needle": one.needle.model_dump(mode="json"),
        }
        for one in context.loads
    ]
