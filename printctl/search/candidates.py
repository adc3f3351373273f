"""Draw a search's parameter values, and make its candidates as validated recipes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, Final

import numpy as np

from kernels.arrays import FloatArray
from printctl.errors import RecipeError
from printctl.pipeline.plate_plan import Point
from printctl.recipe import Recipe, load_recipe
from printctl.recipe.load import overridden
from printctl.search.evaluate import Task, task_of
from printctl.search.model import MOST, Range, SearchFile


def drawn(search: SearchFile) -> list[dict[str, Any]]:
    """Key to value for each candidate, in their order; the same for the same file and seed.

    Of a grid the last key's values vary fastest. What is drawn twice counts once.

    Raises
    ------
    RecipeError
        For a grid of too many.
    """
    rows = _grid(search) if search.draw == "grid" else _sampled(search)
    by_text: dict[str, dict[str, Any]] = {}
    for row in rows:
        values = dict(zip(search.vary, row, strict=True))
        by_text.setdefault(repr(values), values)
    return list(by_text.values())


def _grid(search: SearchFile) -> list[tuple[Any, ...]]:
    axes = [_steps(one) if isinstance(one, Range) else list(one) for one in search.vary.values()]
    count = math.prod(len(axis) for axis in axes)
    if count > MOST:
        raise RecipeError(
            f"vary: the grid has {count:,} candidates, {MOST:,} at most; vary less, or draw some "
            "of them (draw: latin_hypercube, count: 200)"
        )
    return list(product(*axes))


def _steps(one: Range) -> list[float | int]:
    count = one.steps or 2
    shares = (k / (count - 1) for k in range(count))
    if one.whole:
        between = [_between(one, share) for share in shares]
        return list(dict.fromkeys(round(value) for value in between))
    return [_shown(one, share) for share in shares]


def _sampled(search: SearchFile) -> list[tuple[Any, ...]]:
    cube = _unit_cube(search)
    return [
        tuple(_value(one, share) for one, share in zip(search.vary.values(), row, strict=True))
        for row in cube.tolist()
    ]


def _unit_cube(search: SearchFile) -> FloatArray:
    """Points in [0, 1), (count, keys)."""
    # Imported here: it takes longer than all the rest of a small search's drawing.
    from scipy.stats import qmc

    random, count, size = np.random.default_rng(search.seed), search.count or 1, len(search.vary)
    if search.draw == "random":
        return random.random((count, size))
    if search.draw == "sobol":
        # Points are balanced in powers of two: the next one is drawn, and cut.
        power = math.ceil(math.log2(count)) if count > 1 else 0
        points = qmc.Sobol(size, rng=random).random_base2(power)[:count]
        return np.asarray(points, dtype=np.float64)
    return np.asarray(qmc.LatinHypercube(size, rng=random).random(count), dtype=np.float64)


def _value(one: tuple[Any, ...] | Range, share: float) -> Any:
    """The value at ``share`` (0 to 1) of what a key may be."""
    if not isinstance(one, Range):
        return one[min(int(share * len(one)), len(one) - 1)]
    if one.whole:
        # Half a step wider at both ends, so that the ends come as often as the others.
        wide = Range.model_construct(low=one.low - 0.5, high=one.high + 0.5, log=one.log)
        return int(min(max(round(_between(wide, share)), one.low), one.high))
    return _shown(one, share)


def _between(one: Range, share: float) -> float:
    if one.log:
        return math.exp((1 - share) * math.log(one.low) + share * math.log(one.high))
    return (1 - share) * one.low + share * one.high


def _shown(one: Range, share: float) -> float:
    """Six digits: what a table shows is what a recipe gets."""
    value = float(f"{_between(one, share):.6g}")
    return min(max(value, one.low), one.high)


WHOLE: Final = ("seed", "print_scale")
SECTIONS: Final = ("tissue", "vasculature", "flow")
WRITING: Final = ("needle", "layer_um", "line_um")
"""Keys of the toolpath that say what can be printed."""
_OTHERS: Final = (
    f"a search varies what its measures follow from: {', '.join(WHOLE)}, "
    f"{', '.join(f'{name}.…' for name in SECTIONS)}, "
    f"{', '.join(f'toolpath.{name}' for name in WRITING)}"
)


@dataclass(frozen=True)
class Candidate:
    """Candidate of a search: its values and recipe.

    Attributes
    ----------
    number : int
        From 1, in the order of drawing.
    values : mapping of str to value
        What is varied, and what it is here.
    recipe : Recipe
    task : Task
    """

    number: int
    values: Mapping[str, Any]
    recipe: Recipe
    task: Task

    @property
    def key(self) -> str:
        """Of its result."""
        return self.task.key

    @property
    def label(self) -> str:
        """For people: what each key is about, its value and unit."""
        return Point(self.values).label


@dataclass(frozen=True)
class CandidateSet:
    """All candidates, and what they are drawn from.

    Attributes
    ----------
    search : SearchFile
    folder : Path
        Of the recipe.
    candidates : sequence of Candidate
        None twice: where two come out as the same recipe, the first is kept.
    """

    search: SearchFile
    folder: Path
    candidates: Sequence[Candidate]


def draw_candidates(search: SearchFile, folder: Path) -> CandidateSet:
    """Draw all candidates of a search.

    Parameters
    ----------
    search : SearchFile
    folder : Path
        Of the search file.

    Raises
    ------
    RecipeError
        For a key that can't be varied, or a value that the recipe's schema refuses.
    """
    for key in search.vary:
        _check_key(key)
    path = (folder / search.recipe).resolve()
    base = load_recipe(path)
    if base.plate is not None:
        raise RecipeError(
            f"{path} prints on a plate, and a search looks for one part; remove plate from it"
        )
    by_key: dict[str, Candidate] = {}
    for number, values in enumerate(drawn(search), 1):
        one = _candidate(search, base, path.parent, number, values)
        by_key.setdefault(one.key, one)
    return CandidateSet(search, path.parent, list(by_key.values()))


def _check_key(key: str) -> None:
    section, _, inside = key.partition(".")
    if key in WHOLE or (section in SECTIONS and inside):
        return
    if section == "toolpath" and inside in WRITING:
        return
    raise RecipeError(f"vary: {key} isn't among what can be varied; {_OTHERS}")


def _candidate(
    search: SearchFile, base: Recipe, folder: Path, number: int, values: dict[str, Any]
) -> Candidate:
    origin = f"vary ({Point(values).label})"
    recipe = overridden(base, values, f"{search.name}_best", origin)
    task = task_of(recipe, folder, search.samples)
    if "wall_shear_outside_percent" in search.objectives and not recipe.flow.shear_band_dyn_cm2:
        raise RecipeError(
            f"{origin}: wall_shear_outside_percent needs a band; add flow.shear_band_dyn_cm2: "
            "[least, greatest] to the recipe"
        )
    return Candidate(number, values, recipe, task)
