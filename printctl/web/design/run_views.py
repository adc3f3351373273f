"""Figures and pictures of a run, and of two beside each other."""

from __future__ import annotations

import hashlib
import json
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from design.units import PA_PER_MMHG
from printctl.run_folder.artefacts import GCODE, LINE_MAP, NETWORK, OXYGEN, SOLID
from printctl.run_folder.manifest import Manifest
from printctl.web.errors import ConflictError, NotFoundError
from printctl.web.worker import run_worker
from printctl.web.workspace import stamp


@dataclass(frozen=True)
class Figure:
    """Key figure of a run; ``name`` is as people are told."""

    key: str
    name: str
    value: float | str
    unit: str = ""

    def __str__(self) -> str:
        shown = self.value if isinstance(self.value, str) else f"{self.value:.4g}"
        return f"{shown} {self.unit}".strip()


_FIGURES: Final = (
    ("vessels", "Vessels", "", "vasculature", "vessels", 1.0),
    ("terminals", "Terminals", "", "vasculature", "terminals", 1.0),
    ("length", "Length of all vessels", "mm", "vasculature", "length_mm", 1.0),
    ("diameter_min", "Narrowest vessel", "mm", "vasculature", "diameter_min_mm", 1.0),
    ("diameter_max", "Widest vessel", "mm", "vasculature", "diameter_max_mm", 1.0),
    ("tissue", "Tissue", "mm³", "tissue", "volume_mm3", 1.0),
    ("lumen", "Volume of the lumens", "mm³", "vasculature", "volume_mm3", 1.0),
    ("inflow", "Flow", "mL/min", "flow", "inflow_ml_min", 1.0),
    ("drop_pa", "Pressure drop", "Pa", "flow", "pressure_drop_pa", 1.0),
    ("drop_mmhg", "Pressure drop", "mmHg", "flow", "pressure_drop_mmhg", 1.0),
    ("shear_max", "Greatest wall shear at mean radius", "Pa", "flow", "wall_shear_max_pa", 1.0),
    ("shear_median", "Median wall shear at mean radius", "Pa", "flow", "wall_shear_median_pa", 1.0),
    ("print_time", "Print time", "min", "dry run", "print_time_s", 1 / 60),
    ("ink", "Ink needed", "µL", "dry run", "ink_needed_ul", 1.0),
    ("fillings", "Fillings of the syringe", "", "dry run", "fillings", 1.0),
)
"""Key, name and unit of a figure; stage, key of its summary, and factor to the unit."""


def key_figures(folder: Path) -> list[Figure]:
    """What a run's stages have said so far, in the order of their making."""
    stages = {name: record.summary for name, record in Manifest.load(folder).stages.items()}
    figures = []
    for key, name, unit, stage, word, factor in _FIGURES:
        value = stages.get(stage, {}).get(word)
        if isinstance(value, int | float) and not isinstance(value, bool):
            figures.append(Figure(key, name, value * factor, unit))
    low = any(one.key == "drop_pa" and float(one.value) < PA_PER_MMHG for one in figures)
    figures = [one for one in figures if one.key != ("drop_mmhg" if low else "drop_pa")]
    if checks := stages.get("dry run", {}).get("checks"):
        failed = [one["weight"] for one in checks if not one["passed"]]
        warnings = failed.count("warns")
        words = f"{warnings} warn, {len(failed) - warnings} refuse"
        passed = f"{len(checks) - len(failed)} passed, {words}"
        figures.append(Figure("checks", "Checks of the dry run", passed))
    lumens = stages.get("lumens", {})
    if lumens.get("checked"):
        words = "{closed} of {lumens} closed, {leaks} leaks".format(**lumens["summary"])
        state = "open" if lumens["passed"] else "not as designed"
        figures.append(Figure("lumens", "Lumens by the G-code", f"{state}: {words}"))
    return figures


@dataclass(frozen=True)
class Difference:
    """A key of the recipe, or a figure, in two runs: empty where one says nothing.

    ``change`` is a number's, in percent of the first; empty else.
    """

    name: str
    one: str
    other: str
    change: str = ""


@dataclass(frozen=True)
class Comparison:
    """Differences between two runs.

    ``recipe`` has the keys that are said otherwise, defaults counted as said; ``figures`` all.
    """

    recipe: list[Difference]
    figures: list[Difference]


def compare_runs(one: Path, other: Path) -> Comparison:
    """Compare the recipes and key figures of two run folders."""
    runs = (one, other)
    first, second = (dict(_flat(Manifest.load(run).facts.get("recipe", {}), "")) for run in runs)
    recipe = [
        _difference(key, first.get(key), second.get(key))
        for key in first | second
        if first.get(key) != second.get(key)
    ]
    a, b = ({figure.key: figure for figure in key_figures(run)} for run in runs)
    figures = [_difference(figure.name, a.get(key), b.get(key)) for key, figure in (a | b).items()]
    return Comparison(recipe, figures)


def _difference(name: str, one: Any, other: Any) -> Difference:
    a, b = (side.value if isinstance(side, Figure) else None for side in (one, other))
    change = ""
    if isinstance(a, float) and isinstance(b, float) and a not in (0, b):
        percent = 100 * (b - a) / abs(a)
        change = f"{percent if abs(percent) > 1e-9 else 0.0:+.3g} %".replace("-", "−")
    first, second = ("" if value is None else str(value) for value in (one, other))
    return Difference(name, first, second, change)


def _flat(value: Any, path: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict) and value:
        for key, inner in value.items():
            yield from _flat(inner, f"{path}.{key}" if path else str(key))
    else:
        yield path, value


LUMENS: Final = "lumens.json"
_SOURCES: Final = {
    "network": (NETWORK, "flow.csv", "tissue.stl", LUMENS, OXYGEN, "registration.json"),
    "layers": (GCODE, LINE_MAP, SOLID),
}
"""Files that a page is made from; it needs the first."""
_WRITTEN: Final = {
    "dry_run": "make the design as far as the dry run",
    "report": "print the design, then let Make continue with scan, registration and report",
}
"""Pages that a run writes by itself, and what has to be done for them."""
_MAKING: Final = threading.Lock()
"""One page is made at a time: two would take the memory of both."""
_LONGEST_S: Final = 180.0
"""That a page takes, and that it waits for another one."""


def run_page(run: Path, name: str, kept: Path) -> Path:
    """The page ``name`` of a run folder: network, layers, dry_run or report.

    What is made for it is kept in the folder ``kept``.

    Raises
    ------
    NotFoundError, ConflictError
        When the run hasn't come so far, or the page can't be made.
    """
    if name in _SOURCES:
        files = [run / one for one in _SOURCES[name]]
        if not files[0].is_file():
            what = "network" if name == "network" else "G-code"
            raise ConflictError(f"run {run.name!r} has no {what} yet; make the design first")
        return _page(run, kept, name, _state([one for one in files if one.is_file()]))
    path = run / f"{name}.html"
    if name not in _WRITTEN or not path.is_file():
        when = _WRITTEN.get(name, "there is no such page")
        raise NotFoundError(f"run {run.name!r} has no page {name[:80]!r} yet: {when}")
    return path


def tissue_page(recipe: Path, section: Any, kept: Path) -> Path:
    """The page of a recipe's tissue (its ``section``), on which places are picked.

    It is kept in the folder ``kept``.

    Raises
    ------
    ConflictError
        When the tissue can't be made.
    """
    words = json.dumps(section)
    named = [path for path in sorted(recipe.parent.iterdir()) if json.dumps(path.name) in words]
    return _page(recipe, kept, "tissue", [words, *_state(named)])


def _state(files: list[Path]) -> list[Any]:
    return [(path.name, *stamp(path)) for path in files]


def _page(run: Path, kept: Path, sort: str, state: list[Any]) -> Path:
    """The page made of files as they are; made now when they have changed."""
    digest = hashlib.sha256(json.dumps(state).encode()).hexdigest()[:16]
    page = kept / f"{run.stem}.{sort}.{digest}.html"
    if page.is_file():
        return page
    if not _MAKING.acquire(timeout=_LONGEST_S):
        raise ConflictError(
            f"the page of {run.stem!r} has waited {_LONGEST_S:g} s for another one that is still "
            "being made; try again"
        )
    try:
        if not page.is_file():  # as made by the one that was waited for
            kept.mkdir(parents=True, exist_ok=True)
            run_worker(
                "printctl.web.design.run_pages",
                sort,
                str(run),
                str(page),
                longest_s=_LONGEST_S,
                late=f"the page of {run.stem!r} wasn't made within {_LONGEST_S:g} s; look at it by "
                "`printctl view`",
                died=f"the page of {run.stem!r} couldn't be made",
            )
            for old in kept.glob(f"{run.stem}.{sort}.*.html"):
                if old != page:
                    old.unlink(missing_ok=True)
    finally:
        _MAKING.release()
    return page
