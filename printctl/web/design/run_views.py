"""Figures and pictures of a run, and of two beside each other."""

from __future__ import annotations

import hashlib
import json
import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from design.units import PA_PER_MMHG
from printctl.run_folder.artefacts import GCODE, LINE_MAP, NETWORK, OXYGEN, SOLID
from printctl.run_folder.manifest import Manifest
from printctl.web.errors import ConflictError
from printctl.web.worker import run_worker

# Key figures of a run, read from the results of its stages.

Stages = Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True)
class Figure:
    """Key figure of a run.

    Attributes
    ----------
    key : str
    name : str
        As people are told.
    value : float or str
    unit : str
    """

    key: str
    name: str
    value: float | str
    unit: str = ""

    @property
    def text(self) -> str:
        """Value and unit, to be read."""
        shown = self.value if isinstance(self.value, str) else f"{self.value:.4g}"
        return f"{shown} {self.unit}".strip()


def _of(stage: str, key: str, factor: float = 1.0) -> Callable[[Stages], float | str | None]:
    def found(stages: Stages) -> float | str | None:
        value = stages.get(stage, {}).get(key)
        if isinstance(value, bool) or not isinstance(value, int | float):
            return None
        return float(value) * factor

    return found


def _pressure_pa(stages: Stages) -> float | str | None:
    pressure = _of("flow", "pressure_drop_pa")(stages)
    return pressure if isinstance(pressure, float) and pressure < PA_PER_MMHG else None


def _pressure_mmhg(stages: Stages) -> float | str | None:
    return None if _pressure_pa(stages) is not None else _of("flow", "pressure_drop_mmhg")(stages)


def _lumens(stages: Stages) -> float | str | None:
    lumens = stages.get("lumens")
    if not lumens or not lumens.get("checked"):
        return None
    summary = lumens.get("summary", {})
    counted = f"{summary.get('closed', 0)} of {summary.get('lumens', 0)} closed"
    leaks = f"{summary.get('leaks', 0)} leaks"
    return f"{'open' if lumens.get('passed') else 'not as designed'}: {counted}, {leaks}"


def _checks(stages: Stages) -> float | str | None:
    checks = stages.get("dry run", {}).get("checks")
    if not isinstance(checks, list):
        return None
    failed = [one for one in checks if isinstance(one, dict) and one.get("passed") is False]
    warnings = sum(1 for one in failed if one.get("weight") == "warns")
    refused = len(failed) - warnings
    return f"{len(checks) - len(failed)} passed, {warnings} warn, {refused} refuse"


_FIGURES: Final[tuple[tuple[str, str, str, Callable[[Stages], float | str | None]], ...]] = (
    ("vessels", "Vessels", "", _of("vasculature", "vessels")),
    ("terminals", "Terminals", "", _of("vasculature", "terminals")),
    ("length", "Length of all vessels", "mm", _of("vasculature", "length_mm")),
    ("diameter_min", "Narrowest vessel", "mm", _of("vasculature", "diameter_min_mm")),
    ("diameter_max", "Widest vessel", "mm", _of("vasculature", "diameter_max_mm")),
    ("tissue", "Tissue", "mm³", _of("tissue", "volume_mm3")),
    ("lumen", "Volume of the lumens", "mm³", _of("vasculature", "volume_mm3")),
    ("inflow", "Flow", "mL/min", _of("flow", "inflow_ml_min")),
    ("drop_pa", "Pressure drop", "Pa", _pressure_pa),
    ("drop_mmhg", "Pressure drop", "mmHg", _pressure_mmhg),
    ("shear_max", "Greatest wall shear at mean radius", "Pa", _of("flow", "wall_shear_max_pa")),
    ("shear_median", "Median wall shear at mean radius", "Pa", _of("flow", "wall_shear_median_pa")),
    ("print_time", "Print time", "min", _of("dry run", "print_time_s", 1 / 60)),
    ("ink", "Ink needed", "µL", _of("dry run", "ink_needed_ul")),
    ("fillings", "Fillings of the syringe", "", _of("dry run", "fillings")),
    ("checks", "Checks of the dry run", "", _checks),
    ("lumens", "Lumens by the G-code", "", _lumens),
)


def key_figures(folder: Path) -> list[Figure]:
    """What a run's stages have said so far, in the order of their making."""
    manifest = Manifest.load(folder)
    stages = {name: record.summary for name, record in manifest.stages.items()}
    figures = ((key, name, of(stages), unit) for key, name, unit, of in _FIGURES)
    return [
        Figure(key, name, value, unit) for key, name, value, unit in figures if value is not None
    ]


# Compare two runs: differences of their recipes and key figures.


@dataclass(frozen=True)
class Difference:
    """A row of a comparison.

    Attributes
    ----------
    name : str
        The recipe's key, or the figure's name.
    one, other : str
        Empty where a run says nothing.
    change : str
        Of a number, in percent of the first; empty else.
    """

    name: str
    one: str
    other: str
    change: str = ""


@dataclass(frozen=True)
class Comparison:
    """Differences between two runs.

    Attributes
    ----------
    recipe : tuple of Difference
        Keys that are said otherwise, defaults counted as said.
    figures : tuple of Difference
        All key figures.
    """

    recipe: tuple[Difference, ...]
    figures: tuple[Difference, ...]


def compare_runs(one: Path, other: Path) -> Comparison:
    """Compare two runs' recipes and key figures.

    Parameters
    ----------
    one, other : Path
        Run folders.
    """
    return Comparison(tuple(_recipes(one, other)), tuple(_figures(one, other)))


def _recipes(one: Path, other: Path) -> Iterator[Difference]:
    first, second = (
        dict(_flat(Manifest.load(folder).facts.get("recipe", {}), "")) for folder in (one, other)
    )
    for key in dict.fromkeys([*first, *second]):
        if first.get(key) != second.get(key):
            yield Difference(key, _shown(first.get(key)), _shown(second.get(key)))


def _flat(value: Any, path: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict) and value:
        for key, inner in value.items():
            yield from _flat(inner, f"{path}.{key}" if path else str(key))
    else:
        yield path, value


def _shown(value: Any) -> str:
    return "" if value is None else str(value)


def _figures(one: Path, other: Path) -> Iterator[Difference]:
    first = {figure.key: figure for figure in key_figures(one)}
    second = {figure.key: figure for figure in key_figures(other)}
    for key in dict.fromkeys([*first, *second]):
        a, b = first.get(key), second.get(key)
        name = (a or b or Figure(key, key, "")).name
        yield Difference(name, a.text if a else "", b.text if b else "", _change(a, b))


def _change(one: Figure | None, other: Figure | None) -> str:
    a, b = (figure.value if figure else None for figure in (one, other))
    if not isinstance(a, float) or not isinstance(b, float) or a == 0 or a == b:
        return ""
    return f"{100 * (b - a) / abs(a):+.3g} %".replace("-", "−")


# HTML views of a run's network and layers and of a recipe's tissue, cached until files change.

LUMENS: Final = "lumens.json"
_OF_NETWORK: Final = (NETWORK, "flow.csv", "tissue.stl", LUMENS, OXYGEN, "registration.json")
_OF_GCODE: Final = (GCODE, LINE_MAP, SOLID)
_MAKING: Final = threading.Lock()
"""One page is made at a time: two would take the memory of both."""
_LONGEST_S: Final = 180.0
"""That a page takes, and that it waits for another one."""


def network_page(run: Path, kept: Path) -> Path:
    """The page of a run's network in its tissue.

    Parameters
    ----------
    run : Path
        Run folder.
    kept : Path
        Folder for pages.

    Raises
    ------
    ConflictError
        When the run has no network yet.
    """
    if not (run / NETWORK).is_file():
        raise ConflictError(f"run {run.name!r} has no network yet; make the design first")

    return _kept(run, kept, "network", _OF_NETWORK)


def gcode_page(run: Path, kept: Path) -> Path:
    """The page of a run's layers or passes, with a slider.

    Raises
    ------
    ConflictError
        When the run has no G-code yet.
    """
    if not (run / GCODE).is_file():
        raise ConflictError(f"run {run.name!r} has no G-code yet; make the design first")

    return _kept(run, kept, "gcode", _OF_GCODE)


def tissue_page(recipe: Path, section: Any, kept: Path) -> Path:
    """The page of a recipe's tissue, on which places are picked.

    Parameters
    ----------
    recipe : Path
    section : JSON value
        What it says of the tissue.
    kept : Path
        Folder for pages.

    Raises
    ------
    ConflictError
        When the tissue can't be made.
    """
    words = json.dumps(section)
    named = [path for path in sorted(recipe.parent.iterdir()) if json.dumps(path.name) in words]
    return _page(recipe, kept, "tissue", [words, *_state(named)])


def _kept(run: Path, kept: Path, sort: str, names: tuple[str, ...]) -> Path:
    """The page made of these files as they are; made now when they have changed."""
    files = [run / name for name in names if (run / name).is_file()]
    return _page(run, kept, sort, _state(files))


def _state(files: list[Path]) -> list[Any]:
    return [(path.name, path.stat().st_mtime_ns, path.stat().st_size) for path in files]


def _page(run: Path, kept: Path, sort: str, state: list[Any]) -> Path:
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
            _make(sort, run, page)
            for old in kept.glob(f"{run.stem}.{sort}.*.html"):
                if old != page:
                    old.unlink(missing_ok=True)
    finally:
        _MAKING.release()
    return page


def _make(sort: str, run: Path, page: Path) -> None:
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
