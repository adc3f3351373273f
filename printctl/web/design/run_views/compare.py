"""Compare two runs: differences of their recipes and key figures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from printctl.run_folder.manifest import Manifest
from printctl.web.design.run_views.figures import Figure, key_figures


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
