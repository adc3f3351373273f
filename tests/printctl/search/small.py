"""Small test search: a few thin trees in a small block, milliseconds each."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import yaml
from rich.console import Console

from printctl.search import SearchResult, load_search, run_search
from printctl.search.results import write_results
from printctl.search.workers import Workers

BASE: dict[str, Any] = {
    "schema": 1,
    "name": "base",
    "tissue": {"shape": "block", "size_mm": [6, 5, 4]},
    "vasculature": {"grow": "tree", "terminals": 3, "smallest_diameter_mm": 0.3},
    "toolpath": {"method": "embedded"},
    "printer": {"ink": "gelatin_sacrificial", "bath": "cell_matrix"},
}
SEARCH: dict[str, Any] = {
    "schema": 1,
    "name": "small",
    "recipe": "base.yaml",
    "vary": {"seed": [1, 2], "vasculature.terminals": [3, 5]},
    "objectives": {"distance_p95_mm": "minimise", "volume_mm3": "minimise"},
    "samples": 1000,
}
HERE = Workers(0)
WRITTEN = ("ranked.csv", "pareto.png", "search.html", "best.yaml")


def write(folder: Path, search: dict[str, Any], base: dict[str, Any] = BASE) -> Path:
    """Recipe and search file in ``folder``; the latter's path."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "base.yaml").write_text(yaml.safe_dump(base), encoding="utf-8")
    path = folder / "search.yaml"
    path.write_text(yaml.safe_dump(search, sort_keys=False), encoding="utf-8")
    return path


def run(path: Path, out: Path, workers: Workers = HERE, limit: int | None = None) -> SearchResult:
    """Search, and write all there is for people."""
    console = Console(file=io.StringIO())
    found = run_search(load_search(path), path.parent, out, console, workers, limit)
    write_results(found, out)
    return found


def left_behind(out: Path) -> dict[str, bytes]:
    """What a search wrote for people, as bytes."""
    return {name: (out / name).read_bytes() for name in WRITTEN}
